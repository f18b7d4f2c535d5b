"""Recorders of ROS 2 messages: to an MCAP file for Foxglove and `ros2 bag`, or without output."""

import json
import time
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import Any

from .cdr import Message, RowEncoder, Series, definition, encode, type_hash
from .companions import LAYOUT_FILE, METADATA_FILE, RecordedTopic, channel_metadata, layout, metadata
from .frames import DEFAULT_FRAMES, Frames
from .mcap_file import McapFile, Nowhere, Rows, Unbuffered
from .messages import TFMessage, TransformStamped


class Recorder:
    """Recorder that drops all ROS 2 messages, for runs that are not recorded; base class of real recorders."""

    enabled: bool = False
    """Whether anything is recorded; publishers skip making messages if not."""
    frames: Frames = DEFAULT_FRAMES
    """Names of the ROS frames, which publishers read when a run begins."""
    topics: frozenset[str] = frozenset()
    """Topics with messages; complete after the recorder is closed."""

    def announce(self, topic: str, kind: type) -> None:
        """Records that a topic exists even if it never has a message; this base class records nothing."""

    def write(self, topic: str, message: Any, time_s: float) -> None:
        """Records a ROS message at a simulated time in seconds; this base class records nothing."""

    def add(self, topic: str, kind: type, data: bytes, time_s: float) -> None:
        """Records an already encoded ROS message (CDR) at a simulated time in seconds.

        This base class records nothing.
        """

    def is_heard(self, topic: str) -> bool:
        """Returns whether ROS nodes subscribe to a topic; false here, as only a bridge has nodes."""
        del topic
        return False

    def tell(self, topic: str, message: Any) -> None:
        """Publishes a message to subscribed ROS nodes, without recording it; does nothing here, without a bridge."""

    def add_static_transforms(self, transforms: Sequence[TransformStamped], time_s: float) -> None:
        """Records the poses of frames that do not move, on `/tf_static`."""

    def add_series(self, series: Series) -> None:
        """Registers a source of ROS messages, whose messages are recorded from now on."""

    def remove_series(self, series: Series) -> None:
        """Writes the messages that a source still holds, and stops recording it."""

    def flush_when_due(self, full: bool = False) -> None:
        """Writes collected messages if two seconds have passed, or (`full`) if a source can hold no more."""

    def state(self) -> Any:
        """Writes pending messages, and returns the state for a checkpoint."""

    def restore(self, state: Any) -> None:
        """Continues the recording from the state in a checkpoint."""

    def close(self) -> None:
        """Finishes the recording file; this base class has none."""


_CHUNK_BYTES = 768 * 1024
"""Uncompressed size of a chunk in bytes: what a killed run can lose, and what the recorder keeps in memory."""
_FLUSH_INTERVAL_S = 2.0
"""Wall-clock seconds after which a chunk is written even if it is not full."""
_NANOSECONDS = 1_000_000_000
STATIC_TOPIC = "/tf_static"


class RecordingError(OSError):
    """Raised when the recording cannot be written, for example because the disk is full."""


class McapRecorder(Recorder):
    """Recorder that writes ROS 2 messages to an MCAP file.

    Memory use is bounded. Every finished chunk is written at once, at the latest after two seconds, so that the file of
    a killed process can be read up to its last chunk. On close, `metadata.yaml` and a layout for Foxglove are written
    next to the file. It must be used by one thread only.
    """

    enabled: bool = True

    def __init__(self, path: Path, *, resume: bool = False) -> None:
        """Opens the MCAP file that the run's messages are recorded to.

        Args:
            path: Path of the file; an existing one is replaced.
            resume: Keeps the existing file and records nothing until `restore` is called.

        Raises:
            RecordingError: The file cannot be opened.
        """
        self._channels: dict[str, tuple[int, type]] = {}
        self._series: list[tuple[Series, RowEncoder]] = []
        self._static = StaticTransforms()
        self._path = path
        with self._explained():
            self._stream = Nowhere() if resume else Unbuffered(path)
            self._file = McapFile(self._stream, "ros2", "prefect-robomaker", _CHUNK_BYTES, self._take_rows)
        self._closed = False
        self._flush_at = time.monotonic() + _FLUSH_INTERVAL_S

    def announce(self, topic: str, kind: type[Message]) -> None:
        """Records that a topic exists even if it never has a message, so that silence means no events.

        Raises:
            TypeError: The topic carries another type.
        """
        self._channel(topic, kind)

    def write(self, topic: str, message: Message, time_s: float) -> None:
        """Records a ROS message.

        Args:
            topic: ROS topic, `/odom`.
            message: The message; all messages of a topic have one type.
            time_s: Simulated time, which is the log time in the file.

        Raises:
            RecordingError: The file cannot be written.
            TypeError: The object is no message, or the topic carries another type.
        """
        self._channel(topic, type(message))
        self.add(topic, type(message), encode(message), time_s)

    def add(self, topic: str, kind: type[Message], data: bytes, time_s: float) -> None:
        """Records an already encoded ROS message (CDR) at a simulated time in seconds; see `write`.

        Raises the error of a recording that cannot be written, such as on a full disk.
        """
        channel = self._channel(topic, kind)
        time_ns = max(0, round(time_s * _NANOSECONDS))
        try:
            self._file.add_message(channel, time_ns, data)
        except OSError as error:
            raise self._explanation(error) from error
        self.flush_when_due()

    def add_static_transforms(self, transforms: Sequence[TransformStamped], time_s: float) -> None:
        """Records the poses of frames that do not move.

        All known static frames are written as one message on `/tf_static`, as tf2's broadcaster does: players and
        viewers may keep only the last message of a topic. Nothing is written if nothing has changed.

        Args:
            transforms: One for each child frame.
            time_s: Simulated time.

        Raises:
            RecordingError: The file cannot be written.
        """
        if self._static.add(transforms):
            self.write(STATIC_TOPIC, self._static.message(), time_s)

    def add_series(self, series: Series) -> None:
        """Registers a source of ROS messages, whose messages are recorded from now on.

        Args:
            series: Source of messages, read whenever a chunk is written.

        Raises:
            TypeError: A topic of the series is already recorded with another message type.
        """
        columns = [(self._channel(topic, columns.kind), columns) for topic, columns in series.topics]
        self._series.append((series, RowEncoder(columns)))

    def remove_series(self, series: Series) -> None:
        """Writes the messages that a source still holds, and stops recording it.

        Raises:
            RecordingError: The file cannot be written.
        """
        self.flush_when_due(full=True)
        self._series = [item for item in self._series if item[0] is not series]

    def flush_when_due(self, full: bool = False) -> None:
        """Writes a chunk if the last one was two seconds ago (wall-clock time).

        Args:
            full: Whether a source can hold no more, so that the chunk is written in any case.

        Raises:
            RecordingError: The file cannot be written.
        """
        now = time.monotonic()
        if full or now >= self._flush_at:
            self._flush_at = now + _FLUSH_INTERVAL_S
            with self._explained():
                self._file.flush()

    def state(self) -> dict[str, Any]:
        """Writes pending messages, and returns the state for a checkpoint.

        Raises:
            RecordingError: The file cannot be written.
        """
        with self._explained():
            kinds = {topic: kind for topic, (_, kind) in self._channels.items()}
            return {"file": self._file.state(), "kinds": kinds, "static": self._static.known}

    def restore(self, state: dict[str, Any]) -> None:
        """Continues from a checkpoint's state; later content of the file is cut off.

        Series that were added since are recorded from now on.

        Raises:
            RecordingError: The file is shorter than it was then, or cannot be written.
        """
        file = state["file"]
        with self._explained():
            self._stream = Unbuffered(self._path, file["position"])
            self._file.restore(file, self._stream)
        numbers = {channel.topic: channel.id for channel in file["channels"]}
        self._channels = {topic: (numbers[topic], kind) for topic, kind in state["kinds"].items()}
        self._static = StaticTransforms(state["static"])
        series, self._series = self._series, []
        for each, _ in series:
            self.add_series(each)
        self._flush_at = time.monotonic() + _FLUSH_INTERVAL_S

    def close(self) -> None:
        """Finishes the file with its index, and writes the files next to it; a second call does nothing.

        Raises:
            RecordingError: The file cannot be written.
        """
        if self._closed:
            return
        self._closed = True
        try:
            with self._explained():
                self._file.finish()
                self._write_companions()
        finally:
            self._stream.close()

    def __enter__(self) -> "McapRecorder":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _take_rows(self) -> Iterator[Rows]:
        for series, encoder in self._series:
            times_s, values = series.take()
            if len(times_s):
                yield encoder.encode(times_s, values)

    def _channel(self, topic: str, kind: type[Message]) -> int:
        channel = self._channels.get(topic)
        if channel is None:
            channel = self._channels[topic] = self._add_channel(topic, kind)
        elif channel[1] is not kind:
            raise TypeError(f"topic {topic} carries {channel[1].__name__}, so {kind.__name__} cannot be written to it")
        return channel[0]

    def _add_channel(self, topic: str, kind: type[Message]) -> tuple[int, type]:
        if not hasattr(kind, "ROS_TYPE"):
            raise TypeError(f"{kind.__name__} is not a message that can be recorded on a topic ({topic})")
        metadata = channel_metadata(topic, type_hash(kind.ROS_TYPE))
        return self._file.add_channel(topic, kind.ROS_TYPE, definition(kind.ROS_TYPE), metadata), kind

    def _write_companions(self) -> None:
        """Writes two files beside the recording: `metadata.yaml`, which makes a rosbag2, and a layout for Foxglove."""
        counts, start_ns, end_ns = self._file.contents()
        self.topics = frozenset(topic for topic, (number, _) in self._channels.items() if counts.get(number, 0))
        topics = [
            RecordedTopic(topic, kind.ROS_TYPE, type_hash(kind.ROS_TYPE), counts.get(number, 0))
            for topic, (number, kind) in self._channels.items()
        ]
        folder = self._path.parent
        (folder / METADATA_FILE).write_text(metadata(self._path.name, topics, start_ns, end_ns))
        shown = layout({topic.name: topic.type for topic in topics})
        (folder / LAYOUT_FILE).write_text(json.dumps(shown, indent=2) + "\n")

    @contextmanager
    def _explained(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            raise self._explanation(error) from error

    def _explanation(self, error: OSError) -> RecordingError:
        return RecordingError(error.errno, f"the recording cannot be written: {error.strerror}", str(self._path))


class StaticTransforms:
    """Poses of ROS frames that do not move, by child frame, of which `/tf_static` messages are made."""

    def __init__(self, known: Mapping[str, TransformStamped] | None = None) -> None:
        self.known = dict(known or {})

    def add(self, transforms: Sequence[TransformStamped]) -> bool:
        """Adds poses of frames that do not move, by the frame's name; returns whether any is new or has changed."""
        fresh = {item.child_frame_id: item for item in transforms}
        if all(_same_place(self.known.get(child), item) for child, item in fresh.items()):
            return False
        self.known = self.known | fresh  # a new one: checkpoints keep the old one
        return True

    def message(self, without: Collection[str] = ()) -> TFMessage:
        """Returns a `/tf_static` message with all known frames except those in `without`."""
        return TFMessage(tuple(item for child, item in self.known.items() if child not in without))


def _same_place(known: TransformStamped | None, item: TransformStamped) -> bool:
    """Returns whether a frame still has the known pose, regardless of the time stamp; false if none is known."""
    if known is None or known.header.frame_id != item.header.frame_id:
        return False
    return known.transform == item.transform
