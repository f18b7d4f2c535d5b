"""Recorder that also publishes: ROS nodes get the same bytes as the recording."""

from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any

import numpy as np

from ..recording.cdr import AnyNumbers, Message, Numbers, RowEncoder, Series, encode
from ..recording.mcap_file import RECORD_HEAD_BYTES, Rows
from ..recording.messages import TransformStamped
from ..recording.recording import STATIC_TOPIC, Frames, Recorder, StaticTransforms
from ..recording.state_series import StateSeries
from .wire import Topic, Wire

TOPICS: Mapping[str, Topic] = {
    topic.name: topic
    for topic in (
        # Clients of rclcpp subscribe the clock best effort, which a reliable publisher serves, too.
        Topic("/clock", "rosgraph_msgs/msg/Clock"),
        Topic("/tf", "tf2_msgs/msg/TFMessage", depth=100),
        Topic("/tf_static", "tf2_msgs/msg/TFMessage", is_latched=True, depth=1),
        Topic("/odom", "nav_msgs/msg/Odometry"),
        Topic("/joint_states", "sensor_msgs/msg/JointState"),
        Topic("/scan", "sensor_msgs/msg/LaserScan"),
        Topic("/imu", "sensor_msgs/msg/Imu"),
        Topic("/robot_description", "std_msgs/msg/String", is_latched=True, depth=1),
        Topic("/map", "nav_msgs/msg/OccupancyGrid", is_latched=True, depth=1),
        Topic("/goal_pose", "geometry_msgs/msg/PoseStamped"),
        Topic("/initialpose", "geometry_msgs/msg/PoseWithCovarianceStamped"),
        # A picture of 320 x 240 has 230 kB, a cloud of its points 920 kB: a slow node gets the newest ones.
        Topic("/camera/image_raw/compressed", "sensor_msgs/msg/CompressedImage", depth=2, is_on_demand=True),
        Topic("/camera/image_raw", "sensor_msgs/msg/Image", depth=2, is_on_demand=True),
        Topic("/camera/camera_info", "sensor_msgs/msg/CameraInfo", depth=2, is_on_demand=True),
        Topic("/camera/depth/image_raw", "sensor_msgs/msg/Image", depth=2, is_on_demand=True),
        Topic("/camera/depth/camera_info", "sensor_msgs/msg/CameraInfo", depth=2, is_on_demand=True),
        Topic("/camera/depth/points", "sensor_msgs/msg/PointCloud2", depth=2, is_on_demand=True),
    )
}
"""Topics that are published to nodes if the simulation records them, by name."""

_EACH_STEP = ("/tf", "/odom", "/joint_states", "/imu")
_MAY_BE_SILENT = ("/goal_pose", "/initialpose")
_ON_DEMAND = frozenset(topic.name for topic in TOPICS.values() if topic.is_on_demand)


class BridgeRecorder(Recorder):
    """Recorder that passes a simulation's ROS messages to the run's recording and to live ROS nodes.

    Single messages are published when they are written. Series are published by `publish`, together with the state at
    that time: a recording has states 50 times a second, and a node that gets a scan needs the transform at the scan's
    own stamp.
    """

    enabled = True

    def __init__(self, inner: Recorder) -> None:
        """Wraps the run's recorder, which may be one that drops all messages; nothing is published before `attach`."""
        self._inner = inner
        self._wire: Wire | None = None
        self._names: Mapping[str, str] = {}
        self._hidden_frames: Collection[str] = ()
        self._static = StaticTransforms()
        self._series: list[_Relayed] = []
        self.sent: dict[str, int] = {}
        """Number of messages published to nodes, by topic."""
        self._heard: Collection[str] = ()
        """Topics to which nodes subscribe, by the names that nodes use."""
        self._unheard: frozenset[str] = frozenset()
        self._after_states: list[tuple[str, bytes]] = []
        """Encoded messages that are published after the states: nodes need the transforms at their stamp first."""

    @property
    def inner(self) -> Recorder:
        """The run's own recorder, which writes the recording file."""
        return self._inner

    @property
    def topics(self) -> frozenset[str]:  # pyright: ignore[reportIncompatibleVariableOverride]
        """Names of the topics in the recording."""
        return self._inner.topics

    def attach(self, wire: Wire, names: Mapping[str, str], frames: Frames, hidden_frames: Collection[str]) -> None:
        """Begins to publish the recorder's messages to ROS nodes.

        Args:
            wire: Connection to the nodes.
            names: Names of the published topics for nodes, by their names in the recording.
            frames: Frame names, used from now on.
            hidden_frames: Child frames that are not published, since nodes estimate them themselves.
        """
        self._wire, self._names, self.frames, self._hidden_frames = wire, names, frames, hidden_frames

    def detach(self) -> None:
        """Stops publishing messages to ROS nodes."""
        self._wire = None
        self._after_states.clear()

    def note_heard(self, heard: Collection[str], *, spares: bool) -> None:
        """Sets the topics that ROS nodes subscribe to, as they were found.

        Args:
            heard: Topics, by the names that nodes use.
            spares: Whether states are published only on these topics: each message wakes its subscribers, which takes
                10 to 100 us.
        """
        self._heard = heard
        self._unheard = frozenset(topic for topic in _EACH_STEP if spares and self._names.get(topic) not in heard)

    def is_heard(self, topic: str) -> bool:
        """Whether ROS nodes subscribe to a topic."""
        return self._wire is not None and self._names.get(topic) in self._heard

    def without_messages(self, heard: Collection[str]) -> list[str]:
        """Returns topics with subscribers on which nothing was published; goals are left out.

        Args:
            heard: Topics, by the names that nodes use.
        """
        silent = [topic for topic in self._names if topic not in self.sent and topic not in _MAY_BE_SILENT]
        return sorted(name for topic in silent if (name := self._names[topic]) in heard)

    def tell(self, topic: str, message: Any) -> None:
        """Publishes a message to subscribed nodes, and records nothing."""
        if self.is_heard(topic):
            self._send(topic, encode(message))

    def announce(self, topic: str, kind: type[Message]) -> None:
        """Notes in the recording that a topic exists even without messages; see `McapRecorder.announce`."""
        self._inner.announce(topic, kind)

    def write(self, topic: str, message: Any, time_s: float) -> None:
        """Records and publishes a ROS message; see `McapRecorder.write`."""
        data = encode(message)
        self._inner.add(topic, type(message), data, time_s)
        self._send(topic, data)

    def add(self, topic: str, kind: type[Message], data: bytes, time_s: float) -> None:
        """Records and publishes an already encoded ROS message."""
        self._inner.add(topic, kind, data, time_s)
        self._send(topic, data)

    def add_static_transforms(self, transforms: Sequence[TransformStamped], time_s: float) -> None:
        """Records and publishes the poses of frames that do not move."""
        if self._static.add(transforms):
            self._inner.write(STATIC_TOPIC, self._static.message(), time_s)
            self._send(STATIC_TOPIC, encode(self._static.message(self._hidden_frames)))

    def add_series(self, series: Series) -> None:
        """Registers a source of ROS messages, so that its messages are recorded and published."""
        relayed = _Relayed(series, keeps=self._inner.enabled, publishes=lambda: self._wire is not None)
        self._inner.add_series(relayed)
        self._series.append(relayed)
        self._series.sort(key=lambda each: not each.has_states)

    def remove_series(self, series: Series) -> None:
        """Records the messages that a source still holds, and stops recording and publishing it."""
        for relayed in [each for each in self._series if each.series is series]:
            self._inner.remove_series(relayed)
            self._series.remove(relayed)

    def flush_when_due(self, full: bool = False) -> None:
        """Writes due messages to the recording file; `full` takes the collected messages of all sources first."""
        if full:
            for relayed in self._series:
                relayed.gather()
        self._inner.flush_when_due(full)

    def publish(self) -> set[str]:
        """Publishes the current state and all collected messages to ROS nodes; returns the topics that nodes got.

        Topics to which no node subscribes are left out.
        """
        published: set[str] = set()
        for relayed in self._series:
            wanted = [topic for topic, _ in relayed.topics if topic not in self._unheard]
            if not wanted:
                relayed.skip()
                continue
            for topic, data in relayed.news(wanted):
                self._send(topic, data)
                if topic in self._names:
                    published.add(topic)
        later, self._after_states = self._after_states, []
        for topic, data in later:
            self._hand_over(topic, data)
        return published

    def state(self) -> Any:
        """Returns the state of the wrapped recorder for a checkpoint."""
        return self._inner.state()

    def restore(self, state: Any) -> None:
        """Continues the wrapped recorder's file from the state of a checkpoint."""
        self._inner.restore(state)

    def close(self) -> None:
        """Finishes the recording file of the wrapped recorder; the ROS nodes stay connected."""
        self._inner.close()

    def _send(self, topic: str, data: bytes) -> None:
        if topic not in _ON_DEMAND:
            self._hand_over(topic, data)
        elif self.is_heard(topic):
            self._after_states.append((topic, data))

    def _hand_over(self, topic: str, data: bytes) -> None:
        if self._wire is not None and topic not in self._unheard and (name := self._names.get(topic)) is not None:
            self._wire.send(name, data)
            self.sent[topic] = self.sent.get(topic, 0) + 1


_Gathered = tuple[Numbers, Sequence[Sequence[AnyNumbers]]]


def _joined(parts: Sequence[_Gathered]) -> tuple[Numbers, list[list[AnyNumbers]]]:
    """Joins recorded numbers that were gathered in several parts, and returns their times and values as one part."""
    if not parts:
        return np.zeros(0), []
    if len(parts) == 1:
        return parts[0][0], [list(columns) for columns in parts[0][1]]
    times = np.concatenate([times for times, _ in parts])
    values = [
        [np.concatenate(rows) for rows in zip(*columns, strict=True)]
        for columns in zip(*(values for _, values in parts), strict=True)
    ]
    return times, values


class _Relayed:
    """A source of ROS messages that is read twice: by the recording when it writes, and for nodes at every step."""

    def __init__(self, series: Series, *, keeps: bool, publishes: Callable[[], bool]) -> None:
        self.series = series
        self._states = series if isinstance(series, StateSeries) else None
        self.has_states = self._states is not None
        self._is_skipped = False
        self._keeps, self._publishes = keeps, publishes
        self._encoder = RowEncoder([(number, columns) for number, (_, columns) in enumerate(series.topics)])
        self._kept: list[_Gathered] = []
        """Rows of messages that the recording has not taken yet."""
        self._unsent: list[_Gathered] = []
        """Rows that were not published yet; kept separately, as the recording may write between two steps."""

    @property
    def topics(self) -> Any:
        """Topics of the source of messages, each with its message template."""
        return self.series.topics

    def take(self) -> tuple[Numbers, list[list[AnyNumbers]]]:
        """Returns the messages that the recording has not received yet, new ones of the source included."""
        self.gather()
        kept, self._kept = self._kept, []
        return _joined(kept)

    def gather(self) -> None:
        """Takes the new messages from the source, and keeps them for the recording and for nodes."""
        found = self.series.take()
        if not len(found[0]):
            return
        if self._keeps:
            self._kept.append(found)
        if not (self.has_states or self._is_skipped) and self._publishes():
            self._unsent.append(found)

    def skip(self) -> None:
        """Drops the messages for nodes, because no node listens."""
        self._is_skipped = True
        self._unsent.clear()

    def news(self, wanted: Collection[str]) -> list[tuple[str, bytes]]:
        """Returns the encoded messages for nodes: of a source of states the present one, else all new readings.

        Args:
            wanted: Topics of the series to publish.
        """
        if self._states is not None:
            time_s, now = self._states.present(wanted)
            chosen = [number for number, (topic, _) in enumerate(self.topics) if topic in wanted]
            return list(zip(wanted, self._encoder.encode_one(time_s, now, chosen), strict=True))
        self.gather()
        self._is_skipped = False
        if not self._unsent:
            return []
        unsent, self._unsent = self._unsent, []
        times, values = _joined(unsent)
        return list(self._messages(self._encoder.encode(times, values)))

    def _messages(self, rows: Rows) -> list[tuple[str, bytes]]:
        count = len(rows.times_ns)
        size = len(rows.records) // count
        found: list[tuple[str, bytes]] = []
        for row in range(count):
            for number, (topic, columns) in enumerate(self.topics):
                start = row * size + rows.starts[number] + RECORD_HEAD_BYTES
                found.append((topic, bytes(rows.records[start : start + len(columns.template)])))
        return found
