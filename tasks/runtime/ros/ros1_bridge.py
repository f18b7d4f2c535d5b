"""The bridge between a simulation and nodes of ROS 1: a node that the run starts beside a launch.

    python3 ros1_bridge.py

ROS's own Python (3.8 and newer) runs this file by itself, in the environment of the launch: it imports nothing of this
package, and of ROS only rospy and what belongs to it. The simulation's messages come over a Unix socket, ready to be
sent to nodes of ROS 1; velocity commands of nodes go back. The constants below are the simulation's too.

Every frame on the socket is `HEADER` and a content. The simulation begins with `HELLO`, JSON with all topics, and
sends `MESSAGE`: the number of a topic and a message. The bridge sends `STATE`, JSON that says which nodes there are or
what it waits for, and `COMMAND`. Either side leaves by closing the connection.
"""

from __future__ import annotations  # ROS 1's Python is 3.8, too

import json
import math
import os
import re
import select
import socket
import struct
import sys
import threading
import time
import xmlrpc.client
from collections import deque
from collections.abc import Iterable
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from typing import Any

SOCKET_VARIABLE = "ROBOMAKER_ROS1_SOCKET"
"""Name of the environment variable with the path of the simulation's socket for the bridge."""

BRIDGE = Path(__file__)
"""Path of the ROS 1 bridge's program."""

PROTOCOL = "robomaker-ros1"
VERSION = 1
NODE = "robomaker_bridge"

HELLO, MESSAGE, COMMAND, STATE = 1, 2, 3, 4  # types of frames

HEADER = struct.Struct("<II")
"""Header of every frame on the socket: content size in bytes, and type."""
TOPIC = struct.Struct("<I")
"""Start of a message's content: index of its topic in the greeting."""
VELOCITY = struct.Struct("<7d")
"""Content of a command: linear x, y, z in m/s, angular x, y, z in rad/s, and the stamp in seconds (NaN without one)."""

MOST_BYTES = {HELLO: 1 << 20, MESSAGE: 64 << 20, COMMAND: VELOCITY.size, STATE: 64 << 10}
"""Maximum content size in bytes of each frame type. A raw 4K image has 25 MB."""

COMMAND_TYPES = {
    "geometry_msgs/Twist": "9f195f881246fdfa2798d1d3eebca84a",
    "geometry_msgs/TwistStamped": "98d34b0043a2093cf9d9345ab6eef12e",
}
"""ROS 1 types that are accepted as velocity commands, with the MD5 sums of their definitions."""

_OWN_NODES = re.compile(r"/(robomaker_\w+|rosout|record(_\d+)?)")
"""Names of nodes that exist without a robot: those of the run and of roslaunch, and `rosbag record`."""

_TWIST = struct.Struct("<6d")
_STAMPED = struct.Struct("<IIII")
"""ROS 1 header without its frame id: sequence number, seconds, nanoseconds, length of the frame id."""

_LOOK_S, _LATER_LOOK_S = 0.02, 0.5
"""Seconds between two polls while waiting, at first and later: C++ nodes connect 50 ms after the master."""
_HASTE_S = 30.0
"""Seconds of waiting after which polls become rarer: the program may need no ROS, and run for hours."""
_STATE_S = 0.1
_LINGER_S = 600.0
"""Wall-clock seconds within which a run finishes its outputs."""
_PATIENCE_S = 5.0
"""Time limit in seconds for an answer of the ROS master, which is on this machine."""
_KEPT_COMMANDS = 256
"""Maximum number of commands that wait for a busy simulation; the newest are kept."""


class Gone(Exception):
    """Raised when the simulation has closed the connection to the ROS 1 bridge."""


class Link:
    """Connection from the ROS 1 bridge process to the simulation; `Gone` is raised once the simulation closes it."""

    def __init__(self, path: str) -> None:
        """Connects the ROS 1 bridge process to the simulation's socket.

        Raises:
            OSError: The simulation does not listen on the socket.
        """
        self._socket = socket.socket(socket.AF_UNIX)
        try:
            self._socket.connect(path)
        except OSError:
            self._socket.close()
            raise
        self._poll = select.poll()
        self._poll.register(self._socket, select.POLLIN)
        self._commands: deque[bytes] = deque(maxlen=_KEPT_COMMANDS)
        self._state = b""
        self._wakes = threading.Event()
        threading.Thread(target=self._send_all, name="to-simulation", daemon=True).start()

    def tell(self, state: dict[str, Any]) -> None:
        """Queues the bridge's state for the simulation.

        A newer state replaces an unsent one. A too long one is dropped.
        """
        content = json.dumps(state, separators=(",", ":"), sort_keys=True).encode("ascii")
        if len(content) <= MOST_BYTES[STATE]:
            self._state = HEADER.pack(len(content), STATE) + content
            self._wakes.set()

    def command(self, velocity: tuple[float, ...]) -> None:
        """Queues a velocity command for the simulation; nothing is waited for."""
        self._commands.append(HEADER.pack(VELOCITY.size, COMMAND) + VELOCITY.pack(*velocity))
        self._wakes.set()

    def receive(self, timeout_s: float) -> tuple[int, memoryview] | None:
        """Returns kind and content of the next message from the simulation; `None` if none arrives in time.

        Raises:
            Gone: The simulation has closed the connection, or sent something else.
        """
        if not self._poll.poll(1000 * timeout_s):
            return None
        length, kind = HEADER.unpack(self._whole(HEADER.size))
        if kind not in (HELLO, MESSAGE) or length > MOST_BYTES[kind]:
            raise Gone("it sent what is no frame of version 1")
        return kind, memoryview(self._whole(length))

    def check(self) -> None:
        """Checks that the simulation is still connected, without reading its messages.

        Raises:
            Gone: The simulation has closed the connection.
        """
        if self._poll.poll(0) and not self._socket.recv(1, socket.MSG_PEEK):
            raise Gone("it closed the connection")

    def _whole(self, count: int) -> bytearray:
        content = bytearray(count)
        left = memoryview(content)
        while left:
            try:
                got = self._socket.recv_into(left)
            except OSError as error:
                raise Gone(str(error)) from error
            if not got:
                raise Gone("it closed the connection")
            left = left[got:]
        return content

    def _send_all(self) -> None:
        with suppress(OSError):  # the thread that receives sees the end
            while True:
                self._wakes.wait()
                self._wakes.clear()
                state, self._state = self._state, b""
                if state:
                    self._socket.sendall(state)
                while self._commands:
                    self._socket.sendall(self._commands.popleft())


def log(text: str) -> None:
    """Writes a line to the ROS 1 bridge's log."""
    sys.stderr.write(f"ros1_bridge: {text}\n")
    sys.stderr.flush()


def use_sim_time(uri: str) -> bool | None:
    """Sets the ROS 1 parameter `/use_sim_time`, unless the launch file has set it.

    Args:
        uri: URI of the ROS master, which has the parameters, too.

    Returns:
        Whether nodes take the simulation's time; None while there is no master.
    """
    before = socket.getdefaulttimeout()
    socket.setdefaulttimeout(_PATIENCE_S)
    try:
        master = xmlrpc.client.ServerProxy(uri)
        code, _, value = master.getParam(f"/{NODE}", "/use_sim_time")  # type: ignore[misc]
        if code == 1:
            return bool(value)
        return master.setParam(f"/{NODE}", "/use_sim_time", True)[0] == 1 or None  # type: ignore[index]
    except (OSError, xmlrpc.client.Error, ValueError, TypeError):
        return None
    finally:
        socket.setdefaulttimeout(before)


class Meeting:
    """Waits for both the simulation and the ROS 1 master, and reports which is missing."""

    def __init__(self, path: str, uri: str) -> None:
        """Stores the addresses of the simulation and of the ROS 1 master, which are waited for later.

        Args:
            path: Path of the simulation's socket.
            uri: URI of the ROS master.
        """
        self._path, self._uri = path, uri
        self._link: Link | None = None
        self._greeting: dict[str, Any] | None = None
        self._has_master = False
        self._said = ""

    def wait(self) -> tuple[Link, dict[str, Any]]:
        """Waits, and returns the connection to the simulation with its first message.

        Raises:
            Gone: The simulation has closed the connection.
        """
        hurries_until_s = time.monotonic() + _HASTE_S
        while True:
            # First: nodes that begin before have read the parameter already.
            self._has_master = self._has_master or use_sim_time(self._uri) is not None
            self._look_for_simulation()
            if self._link is not None and self._greeting is not None and self._has_master:
                return self._link, self._greeting
            self._say()
            time.sleep(_LOOK_S if time.monotonic() < hurries_until_s else _LATER_LOOK_S)

    def _look_for_simulation(self) -> None:
        if self._link is None:
            with suppress(OSError):
                self._link = Link(self._path)
        elif self._greeting is not None:
            self._link.check()
        elif (frame := self._link.receive(0.0)) is not None:
            greeting = json.loads(bytes(frame[1]))
            if frame[0] != HELLO or (greeting["protocol"], greeting["version"]) != (PROTOCOL, VERSION):
                raise Gone("it did not greet as version 1")
            self._greeting = greeting

    def _say(self) -> None:
        if self._link is None:
            what = f"the simulation, which listens at {self._path}"
        elif not self._has_master:
            what = f"the ROS master at {self._uri}"
        else:
            what = "the simulation to begin"
        if what != self._said:
            self._said = what
            log(f"waits for {what}")
            if self._link is not None:
                self._link.tell({"waits_for": what})


def velocity_in(ros_type: str, content: bytes) -> tuple[float, ...]:
    """Returns the velocity command in a ROS 1 message: six velocities and the time stamp in seconds.

    Numbers that the message does not have are NaN, as are all of a damaged message.
    """
    try:
        if ros_type == "geometry_msgs/Twist":
            return (*_TWIST.unpack(content), math.nan)
        _, seconds, nanoseconds, length = _STAMPED.unpack_from(content)
        return (*_TWIST.unpack(content[_STAMPED.size + length :]), seconds + 1e-9 * nanoseconds)
    except struct.error:
        return (math.nan,) * 7


def commanders_in(connections: Iterable[Any]) -> tuple[int, list[str]]:
    """Counts the publishers of velocity commands, and lists unsupported types.

    Args:
        connections: Connections of rospy, each with a type and an MD5 sum; both are None until the publisher has
            announced its type.
    """
    count, wrong = 0, set()
    for each in connections:
        if each.type in COMMAND_TYPES and each.md5sum == COMMAND_TYPES[each.type]:
            count += 1
        elif each.type in COMMAND_TYPES:
            wrong.add(f"{each.type} of another definition, whose MD5 sum is {each.md5sum}")
        elif each.type is not None:
            wrong.add(str(each.type))
    return count, sorted(wrong)


class Bridge:
    """ROS 1 node that publishes the simulation's topics and subscribes velocity commands."""

    def __init__(self, link: Link, greeting: dict[str, Any]) -> None:
        """Creates publishers and subscribers of ROS 1 for the topics in the greeting; the ROS node already exists.

        Args:
            link: Connection to the simulation.
            greeting: First message of the simulation, with its topics.
        """
        self._rospy = rospy = import_module("rospy")
        self._link = link
        self._topics = greeting["topics"]
        self._command_topic = greeting["command_topic"]
        self._kinds = [self._kind(topic) for topic in self._topics]
        self._publishers = [
            rospy.Publisher(topic["name"], kind, latch=topic["latched"], queue_size=topic["depth"], tcp_nodelay=True)
            for topic, kind in zip(self._topics, self._kinds)
        ]
        self._commands = rospy.Subscriber(
            self._command_topic, rospy.AnyMsg, self._hear, queue_size=_KEPT_COMMANDS, tcp_nodelay=True
        )

    def publish(self, content: memoryview) -> None:
        """Publishes a message of the simulation on the ROS 1 topic whose index precedes it."""
        number = TOPIC.unpack_from(content)[0]
        message = self._kinds[number]()
        message._buff = content[TOPIC.size :]
        self._publishers[number].publish(message)

    def state(self) -> dict[str, Any]:
        """Returns which topics ROS 1 nodes hear, how many nodes send commands, and commands of a wrong type."""
        heard = []
        for topic, publisher in zip(self._topics, self._publishers):
            names = [str(connection[1]) for connection in publisher.impl.get_stats_info()]
            if any(not _OWN_NODES.fullmatch(name) for name in names):
                heard.append(topic["name"])
        count, wrong = commanders_in(self._commands.impl.connections)
        return {
            "heard": heard,
            "commanders": count,
            "mistyped": {self._command_topic: ", ".join(wrong)} if wrong else {},
        }

    def tell_states(self, uri: str) -> None:
        """Tells the simulation which ROS 1 nodes are connected, whenever that changes, until ROS shuts down.

        Args:
            uri: Address of the ROS master, which is asked whether nodes use simulated time.
        """
        last: dict[str, Any] = {}
        while not self._rospy.is_shutdown():
            state = self.state()
            if state["commanders"] and not last.get("commanders") and use_sim_time(uri) is False:
                log("the launch sets /use_sim_time to false: nodes take the machine's time, not the simulation's")
            if state != last:
                self._link.tell(state)
                log(
                    f"nodes: {state['commanders']} send {self._command_topic}; heard: {' '.join(state['heard']) or '-'}"
                )
            last = state
            time.sleep(_STATE_S)

    def _hear(self, message: Any) -> None:
        ros_type = message._connection_header.get("type")
        if ros_type in COMMAND_TYPES and message._connection_header.get("md5sum") == COMMAND_TYPES[ros_type]:
            self._link.command(velocity_in(ros_type, message._buff))

    def _kind(self, topic: dict[str, Any]) -> type:
        """Makes a rospy message class whose content is already encoded, with the type's name and MD5 sum."""
        about = {"_type": topic["type"], "_md5sum": topic["md5sum"], "_full_text": topic["definition"]}
        return type("Ready", (self._rospy.AnyMsg,), {**about, "__slots__": []})


def main() -> int:
    """Entry point of the ROS 1 bridge process; runs until the simulation closes the connection.

    Returns the exit code, which is 1 if the ROS master, or another node of this name, ended it.
    """
    rospy = import_module("rospy")  # before it waits: it takes half a second
    uri, path = os.environ.get("ROS_MASTER_URI") or "http://localhost:11311", os.environ[SOCKET_VARIABLE]
    try:
        link, greeting = Meeting(path, uri).wait()
        # Its own clock is the machine's: it would be a subscriber of /clock like a robot's nodes.
        rospy.init_node(NODE, argv=[], disable_rostime=True, disable_rosout=True, disable_signals=True)
        bridge = Bridge(link, greeting)
        log(f"bridges {len(greeting['topics'])} topics and {greeting['command_topic']} to the ROS master at {uri}")
        threading.Thread(target=bridge.tell_states, args=(uri,), name="states", daemon=True).start()
        while not rospy.is_shutdown():
            frame = link.receive(_STATE_S)
            if frame is not None:
                bridge.publish(frame[1])
    except Gone as gone:
        return leave(path, str(gone))
    log("the ROS master, or another node of its name, told it to end")
    return 1


def leave(path: str, why: str) -> int:
    """Shuts the ROS 1 node down when the simulation has closed the connection; returns the exit code.

    If the run is over, the process waits without a node until the run ends it: a tool that exits would be restarted,
    and restarts are counted in the result. If the simulation is still running, the process exits soon to reconnect.
    """
    log(f"leaves the nodes, since the simulation is gone: {why}")
    import_module("rospy").signal_shutdown("the simulation is gone")
    if Path(path).exists():
        return 1
    time.sleep(_LINGER_S)
    return 0


if __name__ == "__main__":
    sys.exit(main())
