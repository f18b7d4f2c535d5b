"""Program that records all topics which ROS 2 nodes of a run publish.

`python -P -m prefect_robomaker.tasks.runtime.ros.topic_recorder REQUEST`, where REQUEST is a `RecorderRequest` as JSON.
It writes `ros-topics.N.mcap`, where N counts its starts, and a report next to it. SIGTERM ends it.

Messages of the simulation are left out, as they are in its own recording. On topics with several publishers, such as
`/tf`, they are recognised by their DDS participant.
"""

import bisect
import os
import shutil
import signal
import sys
import time
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from types import FrameType
from typing import NamedTuple

from ...files.untrusted_files import write_anew
from ..limits.processes import die_with_parent
from ..recording.companions import Offer, channel_metadata
from ..recording.mcap_file import McapFile, Unbuffered
from .dds import Reach, Received, ros_type_name
from .dds_listening import Announced, Call, Listener, ListenError, Subscription
from .topic_report import RecorderReport, RecorderRequest, TopicReport, part_path, report_path
from .type_definitions import (
    SERVICE,
    SERVICE_TYPE,
    PackageFiles,
    confirmed_hash,
    definition_in,
    known_definition,
    request_of,
)

DOMAIN_VARIABLE = "ROS_DOMAIN_ID"

_CHUNK_BYTES = 768 * 1024
"""Uncompressed size of a chunk in bytes."""
_FLUSH_INTERVAL_S = 2.0
"""Wall-clock seconds after which a chunk is written even if it is not full; a killed recorder loses that much."""
_GATHER_S = 0.05
"""Seconds between two polls while messages arrive: polling a topic costs as much as a message."""
_IDLE_S = 0.2
"""Seconds between two polls without messages, and the longest delay until a stop signal is seen: a run waits one
second.
"""
_DEPTH = 100
"""Number of messages of a topic that are kept between two polls; allows 2,000 a second."""
_LARGE_DEPTH = 10
"""Number of messages that are kept of topics with large messages; allows 200 a second, so that a slow disk does not
fill the memory with images.
"""
_LARGE_TYPES = ("Image", "CompressedImage", "PointCloud", "PointCloud2", "OccupancyGrid", "Costmap", "VoxelGrid")
_TOPIC_SHARE = 0.5
"""Share of the size limit that one topic may use, so that one camera does not displace all other topics."""
_FREE_SHARE = 8
"""Divisor of the free disk space at the start that gives the recorder's size limit; a run may use two fifths of the
space.
"""
_MOST_TOPICS = 1000
_ASK_TIMEOUT_S = 15.0
"""Seconds for a node to answer with the definition of its type; it took 0.2 s, and several on a busy machine."""
_HELD_BYTES = 64 * 1024 * 1024
"""Size limit in bytes of messages that are held back while type definitions are requested."""
_CLOCKS = 4096
"""Number of remembered `/clock` messages: messages are at most seconds late, and the clock has at most 1,000 Hz."""
_CLOCK_TOPIC, _CLOCK_TYPE = "rt/clock", "rosgraph_msgs/msg/Clock"
_CLOCK_BYTES = 12
_NOT_OF_TOPICS = ("rq/", "rr/", "ros_discovery_info")
"""Prefixes of DDS topic names that are not ROS topics: services and discovery."""
_NANOSECONDS = 1_000_000_000


class SimulatedClock:
    """Converts the sending time of ROS messages to simulated time, from messages of `/clock`."""

    def __init__(self) -> None:
        self._sent_ns: deque[int] = deque(maxlen=_CLOCKS)
        self._times_ns: deque[int] = deque(maxlen=_CLOCKS)

    def add(self, message: Received) -> None:
        """Adds the time of a received `/clock` message to the known ones; damaged and late messages are ignored."""
        if len(message.data) < _CLOCK_BYTES or (self._sent_ns and message.sent_ns < self._sent_ns[-1]):
            return
        seconds = int.from_bytes(message.data[4:8], "little", signed=True)
        nanoseconds = int.from_bytes(message.data[8:12], "little")
        self._sent_ns.append(message.sent_ns)
        self._times_ns.append(max(0, seconds * _NANOSECONDS + nanoseconds))

    def time_ns(self, sent_ns: int) -> int:
        """Returns the simulated time (ns) at which a message was sent; 0 before the first clock message."""
        if not self._sent_ns:
            return 0
        return self._times_ns[max(0, bisect.bisect_right(self._sent_ns, sent_ns) - 1)]


@dataclass
class Recorded:
    """A topic that is recorded: subscriptions, counts, channel, and messages that wait until its type is known."""

    name: str
    type: str
    type_hash: str
    offer: Offer
    subscriptions: dict[bool, Subscription] = field(default_factory=dict)
    """Subscriptions by whether they are latched: a latched one gets earlier messages, but only from latched publishers.
    """

    is_defined: bool = True
    messages: int = 0
    left_out: int = 0
    """Number of messages left out because of the size limit."""

    channel: int | None = None
    """Channel number in the MCAP file; `None` while its type definition is requested."""

    written_bytes: int = 0
    asked: "Question | None" = None
    held: list[tuple[int, bytes]] = field(default_factory=list)
    """Times and messages that are held back until the type definition is known."""

    def report(self) -> TopicReport:
        """Returns the topic's entry for the recorder's report."""
        return TopicReport(
            name=self.name,
            type=self.type,
            messages=self.messages,
            is_defined=self.is_defined,
            left_out=self.left_out,
            lost=sum(each.lost for each in self.subscriptions.values()),
        )


class Publisher(NamedTuple):
    """Publisher of a recorded topic: whether it is the simulation, and by which subscription it is heard."""

    is_simulation: bool
    topic: Recorded | None = None
    is_latched: bool = False


@dataclass
class Question:
    """Pending question to nodes for the definition of a message type."""

    participant: str
    until: float
    calls: dict[str, Call] = field(default_factory=dict)


class TopicRecorder:
    """Records all ROS 2 topics of a domain to an MCAP file until a signal to stop.

    Args:
        listener: DDS participant that subscribes the topics.
        request: Limits and topics to record.
        domain: ROS 2 domain id, for the report.
        path: Path of the MCAP file.
        clock: Monotonic clock, in seconds.
    """

    def __init__(
        self,
        listener: Listener,
        request: RecorderRequest,
        domain: int,
        path: Path,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._listener = listener
        self._path = path
        self._clock = clock
        self._domain = domain
        self._stream = Unbuffered(path)
        self._file = McapFile(self._stream, "ros2", "prefect-robomaker", _CHUNK_BYTES)
        self._flush_at = clock() + _FLUSH_INTERVAL_S
        self._topics: dict[tuple[str, str, str], Recorded] = {}
        self._refused: dict[str, TopicReport] = {}
        self._writers: dict[int, Publisher] = {}
        """Publishers by handle, including those that have left: their last messages may arrive later."""
        self._files = PackageFiles(request.packages)
        self._services: dict[str, set[str]] = {}
        """Names of services that return type definitions, by participant."""
        self._simulated = SimulatedClock()
        self._clock_reader = (
            listener.subscribe(_CLOCK_TOPIC, _CLOCK_TYPE, _CLOCKS, is_latched=False)
            if request.times == "clock"
            else None
        )
        self._began_ns = time.time_ns() if request.times == "elapsed" else 0
        free_bytes = shutil.disk_usage(request.output_dir).free
        self._most_bytes = min(request.max_bytes, free_bytes // _FREE_SHARE)
        self._total_bytes = 0
        self._held_bytes = 0
        self._said: RecorderReport | None = None

    def run(self, is_stopped: Callable[[], bool]) -> None:
        """Records all topics of the ROS 2 domain until it is stopped.

        Raises:
            OSError: The file cannot be written.
        """
        self._report()
        while not is_stopped():
            self._listener.wait(_IDLE_S)
            time.sleep(_GATHER_S)
            self.look()

    def close(self) -> None:
        """Writes pending messages, and completes the recording and its report.

        Raises:
            OSError: The file cannot be written.
        """
        self.look()
        for topic in self._topics.values():
            if topic.channel is None:
                self._open_channel(topic, "")
        self._file.finish()
        self._stream.close()
        self._report()

    def look(self) -> None:
        """Takes new messages and publishers, and writes the messages whose type definition is known.

        Asks for missing definitions, and now and then writes pending data and the report.
        """
        # Publishers are known before their messages, and the clock of their time when they come.
        taken = self._taken()
        for publication in self._listener.changes():
            self._on_publication(publication)
        if self._clock_reader is not None:
            for message in self._clock_reader.take():
                publisher = self._writers.get(message.writer)
                if publisher is None or publisher.is_simulation or not self._listener.simulations:
                    self._simulated.add(message)
        for topic, message in taken:
            self._add(topic, message)
        for topic in self._topics.values():
            if topic.asked is not None:
                self._ask(topic, topic.asked)
        if self._clock() >= self._flush_at:
            self._flush_at = self._clock() + _FLUSH_INTERVAL_S
            self._file.flush()
            self._report()

    # Topics

    def _on_publication(self, found: Announced) -> None:
        if found.participant in self._listener.simulations:
            self._writers[found.writer] = Publisher(is_simulation=True)
            return
        if found.topic.startswith("rr/") and found.topic.endswith(f"/{SERVICE}Reply"):
            service = found.topic[len("rr/") : -len("Reply")]
            self._services.setdefault(found.participant, set()).add(service)
        if found.topic.startswith(_NOT_OF_TOPICS):
            return
        ros_type = ros_type_name(found.type)
        if not found.topic.startswith("rt/") or ros_type is None:
            self._refuse(found.topic, found.type, "no topic of ROS")
            return
        key = (found.topic, found.type, found.type_hash)
        topic = self._topics.get(key)
        try:
            if topic is None:
                if len(self._topics) >= _MOST_TOPICS:
                    raise ListenError(f"there are more than {_MOST_TOPICS} topics")
                topic = Recorded(found.topic[len("rt") :], ros_type, found.type_hash, _offer(found))
                self._subscribe(topic, found)
                self._topics[key] = topic
                self._define(topic, found)
            else:
                self._subscribe(topic, found)
        except ListenError as error:
            self._refuse(found.topic[len("rt") :], ros_type, f"it cannot be subscribed: {error}")
        self._writers[found.writer] = Publisher(False, topic, _offer(found).is_latched)

    def _subscribe(self, topic: Recorded, found: Announced) -> None:
        is_latched = _offer(found).is_latched
        if is_latched not in topic.subscriptions:
            depth = _LARGE_DEPTH if topic.type.rpartition("/")[2] in _LARGE_TYPES else _DEPTH
            subscription = self._listener.subscribe(found.topic, topic.type, depth, is_latched=is_latched)
            topic.subscriptions[is_latched] = subscription

    def _define(self, topic: Recorded, found: Announced) -> None:
        definition = known_definition(topic.type, topic.type_hash)
        if definition is None:
            definition = self._files.definition(topic.type, topic.type_hash)
        if definition is None and topic.type_hash:
            topic.asked = Question(found.participant, self._clock() + _ASK_TIMEOUT_S)
        else:
            self._open_channel(topic, definition or "")

    def _refuse(self, name: str, type_name: str, problem: str) -> None:
        if name not in self._refused and len(self._refused) < _MOST_TOPICS:
            self._refused[name] = TopicReport(name=name, type=type_name, problem=problem)

    # Definitions

    def _ask(self, topic: Recorded, question: Question) -> None:
        """Requests a type's definition from all nodes in the publisher's process, and opens the channel on a reply.

        If no definition comes in time, or held messages need too much memory, the channel is opened without one.
        """
        for service in self._services.get(question.participant, set()):
            if service not in question.calls:
                with suppress(ListenError):
                    request = request_of(topic.type, topic.type_hash)
                    question.calls[service] = self._listener.call(service, SERVICE_TYPE, request)
        for call in question.calls.values():
            for reply in call.replies():
                if (definition := definition_in(reply, topic.type)) is not None:
                    self._open_channel(topic, definition)
                    return
        if self._clock() >= question.until or self._held_bytes > _HELD_BYTES:
            self._open_channel(topic, "")

    def _open_channel(self, topic: Recorded, definition: str) -> None:
        topic.is_defined = bool(definition)
        said = confirmed_hash(topic.type, definition, topic.type_hash)
        metadata = channel_metadata(topic.name, said, topic.offer)
        topic.channel = self._file.add_channel(topic.name, topic.type, definition, metadata)
        topic.asked = None
        held, topic.held = topic.held, []
        for time_ns, data in held:
            self._held_bytes -= len(data)
            self._write(topic, time_ns, data)

    # Messages

    def _taken(self) -> list[tuple[Recorded, Received]]:
        """Takes the messages received since the last call, each with its topic, in the order of their sending."""
        taken = [
            (topic, is_latched, message)
            for topic in self._topics.values()
            for is_latched, subscription in topic.subscriptions.items()
            for message in subscription.take()
        ]
        taken.sort(key=lambda item: item[2].sent_ns)
        return [(topic, message) for topic, is_latched, message in taken if self._is_its(topic, is_latched, message)]

    def _is_its(self, topic: Recorded, is_latched: bool, message: Received) -> bool:
        """Returns whether a message is to be recorded: not the simulation's, and not one that two subscriptions got."""
        publisher = self._writers.get(message.writer)
        if publisher is None:
            return True
        if publisher.is_simulation:
            return False
        return publisher.topic in (topic, None) and publisher.is_latched == is_latched

    def _add(self, topic: Recorded, message: Received) -> None:
        if self._clock_reader is not None:
            time_ns = self._simulated.time_ns(message.sent_ns)
        else:
            time_ns = max(0, message.sent_ns - self._began_ns)
        if topic.channel is None:
            self._held_bytes += len(message.data)
            topic.held.append((time_ns, message.data))
        else:
            self._write(topic, time_ns, message.data)

    def _write(self, topic: Recorded, time_ns: int, data: bytes) -> None:
        assert topic.channel is not None
        size, most = len(data), self._most_bytes
        if topic.written_bytes + size > most * _TOPIC_SHARE or self._total_bytes + size > most:
            topic.left_out += 1
            return
        topic.written_bytes += size
        self._total_bytes += size
        topic.messages += 1
        self._file.add_message(topic.channel, time_ns, data)

    # The report

    def _report(self) -> None:
        """Writes the report file beside the recording, atomically, if the report has changed."""
        reports = [topic.report() for topic in self._topics.values()]
        report = RecorderReport(domain=self._domain, topics=[*reports, *self._refused.values()])
        if report == self._said:
            return
        self._said = report
        write_anew(report_path(self._path), report.model_dump_json().encode())


def _offer(found: Announced) -> Offer:
    """Returns the QoS of a topic's publishers; only reliable ones send earlier messages to new subscribers."""
    return Offer(found.is_latched and found.is_reliable, found.is_reliable, found.depth)


def main(text: str) -> int:
    """Entry point of the process that records all ROS 2 topics of a run until it gets the signal SIGTERM; returns 0.

    Writes a recording and a report into the output folder; ends with its parent.

    Args:
        text: Request as JSON.
    """
    die_with_parent()
    request = RecorderRequest.model_validate_json(text)
    stopped: list[int] = []

    def stop(number: int, frame: FrameType | None) -> None:
        del frame
        stopped.append(number)

    signal.signal(signal.SIGTERM, stop)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    domain = int(os.environ.get(DOMAIN_VARIABLE) or 0)
    number = next(number for number in range(1, 10**6) if not os.path.lexists(part_path(request.output_dir, number)))
    listener = Listener(domain, Reach(tuple(request.peers), request.interface))
    recorder = TopicRecorder(listener, request, domain, part_path(request.output_dir, number))
    recorder.run(lambda: bool(stopped))
    recorder.close()
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
