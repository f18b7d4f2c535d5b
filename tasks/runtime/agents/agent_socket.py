"""Unix socket over which a robot program drives the simulation.

Every wait checks at least 20 times a second whether the run has to stop.
"""

import hashlib
import os
import select
import socket
import stat
import struct
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from ....schemas.runs.plan import RunPlan
from ....schemas.runs.programs import RunStop
from ....schemas.wire.errors import LaunchError
from ..episode.progress import Stop as Stop
from .agent_client import ERROR, FrameBuffer, ProtocolError, json_message

_SYSTEM_FOLDER = Path("/tmp")  # noqa: S108  (not TMPDIR: applications may set it; what is made there is private)
_FOLDER = ".robomaker"
_SHARED_FOLDER = "agent"
AGENT_SOCKET = "agent.sock"
"""File name of the socket for robot programs that speak the agent protocol."""
ROS1_SOCKET = "ros1.sock"
"""File name of the socket for the bridge to ROS 1 nodes."""
_MAX_PATH_BYTES = 107  # `sun_path` has 108, with the zero at the end
_PATIENCE_S = 0.05
_BACKLOG = 8
_GOODBYE_S = 0.5
_CREDENTIALS = "3i"
"""Format of a socket peer's credentials (`struct ucred`): process id, user id, group id."""

Clock = Callable[[], float]
Message = tuple[int, memoryview]


class Stopped(Exception):
    """Raised when the run has to stop while the simulation waits for the robot program."""


class Closed(Exception):
    """Raised when the robot program closed the connection."""


def agent_socket_path(plan: RunPlan, name: str = AGENT_SOCKET) -> Path:
    """Returns the path of the Unix socket to which a run's robot program connects.

    Args:
        plan: Plan of the run.
        name: File name of the socket.

    Its folder holds nothing but such sockets, so that it can be mounted into a container; every user who can read the
    folder may connect. The folder above it is for this user alone. Both are in the plan's work folder, or in the
    system's temporary folder when that path would be too long for a socket.
    """
    work_dir = plan.work_dir.absolute()
    path = work_dir / _FOLDER / _SHARED_FOLDER / name
    if len(os.fsencode(path)) <= _MAX_PATH_BYTES:
        return path
    identity = "\0".join((plan.job_id, plan.run_id, str(work_dir)))
    digest = hashlib.sha256(identity.encode("utf-8", "surrogateescape")).hexdigest()[:20]
    return _SYSTEM_FOLDER / f"robomaker-{os.getuid()}-{digest}" / _SHARED_FOLDER / name


def remove_agent_socket(plan: RunPlan) -> None:
    """Deletes the sockets of a run and their folders, if the run was killed before it could."""
    for name in (AGENT_SOCKET, ROS1_SOCKET):
        _remove(agent_socket_path(plan, name))


def _remove(path: Path) -> None:
    with suppress(OSError):
        path.unlink()
    for folder in (path.parent, path.parent.parent):
        with suppress(OSError):
            folder.rmdir()


class AgentSocket:
    """Unix socket on which a simulation waits for its robot program; its file is deleted by `close`."""

    def __init__(self, plan: RunPlan, name: str = AGENT_SOCKET) -> None:
        """Creates a run's Unix socket for its robot program, and listens on it; replaces an earlier socket there.

        Args:
            plan: Plan of the run.
            name: File name of the socket.

        Raises:
            LaunchError: The socket cannot be opened.
        """
        self.path = agent_socket_path(plan, name)
        self._is_for_any_user = any(program.role == "robot" and program.image_id for program in plan.programs)
        """Whether processes of other users may connect, as those of a container; only the container has the socket's
        folder then.
        """
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        try:
            make_private(self.path.parent.parent)
            self.path.parent.mkdir(exist_ok=True)
            self.path.parent.chmod(0o755)  # a container's user may be another one
            self.path.unlink(missing_ok=True)
            self._socket.bind(str(self.path))
            self.path.chmod(0o666)
            self._socket.listen(_BACKLOG)
        except OSError as error:
            self._socket.close()
            raise LaunchError(
                f"the socket for the robot application cannot be made at {self.path}: {error}", "InternalServiceError"
            ) from error

    def accept(
        self, deadline_s: float, stop: Stop, clock: Clock = time.monotonic, until: Callable[[], bool] = lambda: False
    ) -> socket.socket | None:
        """Waits for a connection; connections of other users of this machine are closed.

        Args:
            deadline_s: Time limit, as a time of `clock`.
            stop: Function that returns whether the run has to stop.
            clock: Monotonic clock, in seconds.
            until: Checked while waiting; when it returns true, waiting ends and the result is `None`.

        Raises:
            TimeoutError: No client connected before the deadline.
            Stopped: The run was told to stop.
        """
        while True:
            if stop.reason:
                raise Stopped
            remaining_s = deadline_s - clock()
            if remaining_s <= 0:
                raise TimeoutError
            self._socket.settimeout(min(_PATIENCE_S, remaining_s))
            with suppress(TimeoutError):
                connection = self._socket.accept()[0]
                if self._may_connect(connection):
                    return connection
                connection.close()
            if until() and not self.has_waiting_client():  # one that came meanwhile goes first
                return None

    def accept_waiting(self) -> socket.socket | None:
        """Returns a robot program's waiting connection, or `None` if none waits; closes connections of other users."""
        self._socket.setblocking(False)
        while True:
            try:
                connection = self._socket.accept()[0]
            except BlockingIOError:
                return None
            except ConnectionAbortedError:
                continue
            if self._may_connect(connection):
                return connection
            connection.close()

    def fileno(self) -> int:
        """Returns the socket's file descriptor, for `select`."""
        return self._socket.fileno()

    def has_waiting_client(self) -> bool:
        """Whether another connection waits to be accepted."""
        return bool(select.select([self._socket], [], [], 0.0)[0])

    def close(self) -> None:
        """Stops listening for robot programs, and deletes the socket file."""
        self._socket.close()
        _remove(self.path)

    def _may_connect(self, connection: socket.socket) -> bool:
        return self._is_for_any_user or _user_of(connection) in (os.geteuid(), 0)


class AgentLink:
    """Connection from a simulation to its robot program, which sends and receives whole messages of the agent protocol.

    Waiting ends with `Stopped` if the run has to stop, and with `Closed` if the program has closed the connection.
    """

    def __init__(
        self, connection: socket.socket, limits: dict[int, int], stop: Stop, clock: Clock = time.monotonic
    ) -> None:
        """Takes over an accepted connection of a robot program.

        Args:
            connection: Socket of the accepted connection.
            limits: Maximum size in bytes of each message type that the robot may send.
            stop: Function that returns whether the run has to stop.
            clock: Monotonic clock, in seconds.
        """
        self.limits = limits
        self.waits_at_limit = False
        """Whether a wait continues when the duration limit is reached, until it is interrupted."""
        self._socket = connection
        self._frames = FrameBuffer(limits)
        self._stop = stop
        self._clock = clock
        self._unsent = memoryview(b"")
        self._said_last = False
        connection.setblocking(True)
        # Cheaper than Python's own timeouts, which ask the kernel twice.
        patience = struct.pack("ll", 0, int(_PATIENCE_S * 1e6))
        for option in (socket.SO_RCVTIMEO, socket.SO_SNDTIMEO):
            connection.setsockopt(socket.SOL_SOCKET, option, patience)

    def send(self, message: bytes | bytearray, timeout_s: float) -> None:
        """Sends a complete message to the robot program.

        Raises:
            TimeoutError: The robot did not take it in time.
            Stopped: The run was told to stop.
            BrokenPipeError: The robot has closed the connection; there may be something from it to receive.
        """
        deadline_s = self._clock() + timeout_s
        left = memoryview(message)
        while True:
            try:
                count = self._socket.send(left)
            except BlockingIOError:
                count = 0
            if count == len(left):
                return
            left = left[count:]
            self._check(deadline_s)

    def receive(self, timeout_s: float) -> Message:
        """Waits for a message from the robot program, and returns it; its content is valid until the next call.

        Raises:
            TimeoutError: No complete message arrived in time.
            Stopped: The run was told to stop.
            Closed: The robot closed the connection.
            ProtocolError: The received bytes are not a message of the protocol.
        """
        message = self._frames.next()
        if message is not None:
            return message
        deadline_s = self._clock() + timeout_s
        while True:
            with suppress(BlockingIOError):
                self._fill(0)
            message = self._frames.next()
            if message is not None:
                return message
            self._check(deadline_s)

    def receive_until(self, due_s: float) -> Message | None:
        """Waits for a message from the robot program until a time of the clock; returns `None` if none arrives.

        Raises:
            Stopped, Closed, ProtocolError: As `receive`.
        """
        while True:
            message = self._frames.next()
            if message is not None:
                return message
            if self._stop.reason:
                raise Stopped
            try:
                self._fill(socket.MSG_DONTWAIT)
            except BlockingIOError:
                wait_s = due_s - self._clock()
                if wait_s <= 0:
                    return None
                writable = [self._socket] if self._unsent else []
                select.select([self._socket], writable, [], min(wait_s, _PATIENCE_S))
                if writable:
                    self._flush()

    def offer(self, message: bytearray) -> bool:
        """Sends a message to the robot program if it can receive now; returns whether the message will arrive.

        If only a part can be sent now, the rest is sent before any other message.
        """
        self._flush()
        if self._unsent:
            return False
        # A copy only of what is left: the message's memory is used again.
        try:
            count = self._socket.send(message, socket.MSG_DONTWAIT)
        except BlockingIOError:
            return False
        except BrokenPipeError:
            return False  # receiving tells more
        if count < len(message):
            self._unsent = memoryview(bytes(memoryview(message)[count:]))
        return True

    def say_last(self, kind: int, content: dict[str, object]) -> None:
        """Sends a final message to the robot program, unless one was sent before or the robot has disconnected.

        Waits for a limited time until it is sent; raises nothing.
        """
        if self._said_last:
            return
        self._said_last = True
        try:
            self.send(bytes(self._unsent) + json_message(kind, content), _GOODBYE_S)
        except (OSError, Stopped):
            return

    def refuse(self, text: str) -> None:
        """Sends the robot program an error about its messages as the last message, unless one was sent before."""
        self.say_last(ERROR, {"error": text})

    def close(self) -> None:
        """Closes the simulation's connection to the robot program."""
        self._socket.close()

    def _fill(self, flags: int) -> None:
        try:
            count = self._socket.recv_into(self._frames.space(), 0, flags)
        except ConnectionResetError:
            count = 0
        if count == 0:
            if self._frames.pending:
                raise ProtocolError("the connection was closed in the middle of a message")
            raise Closed
        self._frames.received(count)

    def _flush(self) -> None:
        with suppress(BlockingIOError, BrokenPipeError):
            while self._unsent:
                self._unsent = self._unsent[self._socket.send(self._unsent, socket.MSG_DONTWAIT) :]

    def _check(self, deadline_s: float) -> None:
        if self._stop.reason and not (self.waits_at_limit and self._stop.reason == RunStop.DURATION_LIMIT):
            raise Stopped
        if self._clock() >= deadline_s:
            raise TimeoutError


def _user_of(connection: socket.socket) -> int:
    size = struct.calcsize(_CREDENTIALS)
    return struct.unpack(_CREDENTIALS, connection.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, size))[1]


def make_private(folder: Path) -> None:
    """Creates a folder that only this user can access; safe in shared folders such as `/tmp`.

    Raises:
        OSError: A file of this name, or a folder of another user, is there.
    """
    with suppress(FileExistsError):
        folder.mkdir(0o700)
    status = folder.lstat()
    if not stat.S_ISDIR(status.st_mode) or status.st_uid != os.getuid():
        raise PermissionError(f"{folder} is not a folder of this user")
    folder.chmod(0o700)
