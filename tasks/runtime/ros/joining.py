"""Program that merges the recording of a run with those of other programs of the run.

`python -P -m prefect_robomaker.tasks.runtime.ros.joining FOLDER NAME...` merges the files of these names (some may be
missing) into `recording.mcap` in the folder, rewrites the files next to it, and deletes the merged ones. It prints a
JSON object: the number of `messages` of the other files, and which of them were `cut` off, as those of killed programs
are; they are read up to their last whole chunk. If the exit code is not 0, nothing was changed.

Programs of the run could write to all of these files, so nothing in them is trusted: no link is followed, and memory is
limited.
"""

import heapq
import io
import json
import os
import resource
import struct
import sys
import zlib
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from operator import itemgetter
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Schema

from ...files.untrusted_files import open_left, unfinished_of, write_anew
from ..limits.processes import die_with_parent
from ..recording.companions import LAYOUT_FILE, METADATA_FILE, RecordedTopic, layout, metadata, offer_in
from ..recording.mcap_file import McapFile, Unbuffered

RECORDING_FILE = "recording.mcap"

_CHUNK_BYTES = 768 * 1024
_HEAD = struct.Struct("<BQ")
_MESSAGE = struct.Struct("<HIQQ")
_MAGIC_BYTES = 8
_MOST_CHUNK_BYTES = 512 * 1024 * 1024
"""Size limit of a chunk in bytes, compressed or not: one message more than the recorder gathers."""
_MEMORY_BYTES = 4 * 1024 * 1024 * 1024
"""Limit of the program's address space in bytes: four chunks of the largest size, and what libraries reserve."""
_HASH = "topic_type_hash"


class Message(NamedTuple):
    """A message of one of the recordings that are merged, with its log time in ns and its topic."""

    time_ns: int
    part: str
    """Name of the file that contains the message."""

    channel: "Source"
    data: bytes


class Source(NamedTuple):
    """A topic in one of the recordings that are merged, with type, definition and metadata."""

    topic: str
    type: str
    definition: str
    noted: tuple[tuple[str, str], ...]
    """Metadata of the topic, which may differ between two files."""


class Part:
    """Reader of a recording that is merged with others; it may be cut off, and its whole messages are read then."""

    def __init__(self, name: str, file: BinaryIO) -> None:
        self.name = name
        self._file = file
        self._schemas: dict[int, Schema] = {}
        self._channels: dict[int, Source] = {}
        self.is_whole = False
        """Whether the recording is complete; known after it was read."""

    def __iter__(self) -> Iterator[Message]:
        """Yields the recording's messages in the order of their times.

        Raises:
            ValueError: The file is not a recording that this package wrote.
        """
        self._file.seek(_MAGIC_BYTES)
        while (record := self._next()) is not None:
            opcode, content = record
            if opcode == Opcode.DATA_END:
                self.is_whole = True
                return
            if opcode == Opcode.CHUNK:
                yield from self._of_chunk(content)

    def _next(self) -> tuple[int, bytes] | None:
        """Reads kind and content of a recording's next record; None at the file's end, or if the record is incomplete.

        Raises `ValueError` if the record is of a kind or size that this package does not write.
        """
        head = self._file.read(_HEAD.size)
        if len(head) < _HEAD.size:
            return None
        opcode, size = _HEAD.unpack(head)
        if opcode == 0 or size > _MOST_CHUNK_BYTES:
            raise ValueError(f"a record of kind {opcode} with {size} bytes is none of ours")
        content = self._file.read(size)
        return (opcode, content) if len(content) == size else None

    def _of_chunk(self, content: bytes) -> list[Message]:
        chunk = Chunk.read(ReadDataStream(io.BytesIO(content)))
        # The frame says itself how large it becomes, which the decoder believes.
        if chunk.compression != "zstd" or zstandard.frame_content_size(chunk.data) != chunk.uncompressed_size:
            raise ValueError("a chunk is not compressed as ours are")
        if chunk.uncompressed_size > _MOST_CHUNK_BYTES:
            raise ValueError(f"a chunk of {chunk.uncompressed_size} bytes is too large")
        raw = zstandard.ZstdDecompressor().decompress(chunk.data)
        if zlib.crc32(raw) != chunk.uncompressed_crc:
            raise ValueError("a chunk is damaged")
        messages: list[Message] = []
        place = 0
        while place < len(raw):
            opcode, size = _HEAD.unpack_from(raw, place)
            place += _HEAD.size
            if opcode == Opcode.MESSAGE:
                channel, _, time_ns, _ = _MESSAGE.unpack_from(raw, place)
                data = raw[place + _MESSAGE.size : place + size]
                messages.append(Message(time_ns, self.name, self._channels[channel], data))
            elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                self._introduce(opcode, raw[place : place + size])
            place += size
        messages.sort(key=itemgetter(0))
        return messages

    def _introduce(self, opcode: int, content: bytes) -> None:
        stream = ReadDataStream(io.BytesIO(content))
        if opcode == Opcode.SCHEMA:
            schema = Schema.read(stream)
            self._schemas[schema.id] = schema
        else:
            channel = Channel.read(stream)
            schema = self._schemas[channel.schema_id]
            noted = tuple(channel.metadata.items())
            self._channels[channel.id] = Source(channel.topic, schema.name, schema.data.decode(), noted)


class Target:
    """Writer of the merged recording, which gets one channel for topics that are the same in several recordings."""

    def __init__(self, path: Path) -> None:
        self._stream = Unbuffered(path)
        self._file = McapFile(self._stream, "ros2", "prefect-robomaker", _CHUNK_BYTES)
        self._known: dict[Source, int] = {}
        self._channels: dict[tuple[str, str, str], tuple[int, Source]] = {}

    def add(self, message: Message) -> None:
        """Adds a message to the merged recording; topics with the same name, type and definition become one channel."""
        source = message.channel
        channel = self._known.get(source)
        if channel is None:
            key = source[:3]
            if key not in self._channels:
                number = self._file.add_channel(source.topic, source.type, source.definition, dict(source.noted))
                self._channels[key] = number, source
            channel = self._known[source] = self._channels[key][0]
        self._file.add_message(channel, message.time_ns, message.data)

    def close(self) -> tuple[list[RecordedTopic], int, int]:
        """Completes and closes the merged recording.

        Returns:
            The topics with their numbers of messages, and the log times of the first and last message in nanoseconds.
        """
        self._file.finish()
        self._stream.close()
        counts, start_ns, end_ns = self._file.contents()
        topics = [
            RecordedTopic(
                source.topic,
                source.type,
                dict(source.noted).get(_HASH, ""),
                counts.get(number, 0),
                offer_in(dict(source.noted)),
            )
            for number, source in self._channels.values()
        ]
        return topics, start_ns, end_ns


def join(folder: Path, names: Sequence[str]) -> dict[str, Any]:
    """Merges the recordings of a run (its own and those of ROS topics) into its own file, and deletes the others.

    Returns the number of messages added, and the names of files that are cut off.

    Args:
        folder: Output folder of a run whose processes have all ended.
        names: File names besides that of the run's own recording.

    Raises:
        OSError: A file cannot be read or written.
        ValueError: A file is no recording of ours.
    """
    own = folder / RECORDING_FILE
    others = [folder / name for name in names]
    unfinished = unfinished_of(own)
    unfinished.unlink(missing_ok=True)  # a program may have left a link there
    target = Target(unfinished)
    try:
        with ExitStack() as stack:
            parts = [
                Part(path.name, stack.enter_context(open_left(path)))
                for path in (own, *others)
                if os.path.lexists(path)
            ]
            added = 0
            # At the same time the run's own messages come first: the clock before what nodes made of it.
            for message in heapq.merge(*parts, key=itemgetter(0)):
                added += message.part != own.name
                target.add(message)
        topics, start_ns, end_ns = target.close()
        if added:
            unfinished.replace(own)
            write_anew(folder / METADATA_FILE, metadata(own.name, topics, start_ns, end_ns).encode())
            shown = layout({topic.name: topic.type for topic in topics})
            write_anew(folder / LAYOUT_FILE, json.dumps(shown, indent=2).encode() + b"\n")
    finally:
        unfinished.unlink(missing_ok=True)
    for path in others:
        path.unlink(missing_ok=True)
    return {"messages": added, "cut": [part.name for part in parts if not part.is_whole]}


def main(folder: str, *names: str) -> int:
    """Entry point of a child process that merges a run's recordings; ends with its parent, and limits its own memory.

    Writes the result as JSON to standard output. Returns the exit code: 1 if merging failed, with the reason on
    standard error, else 0.

    Args:
        folder: Folder of the recordings.
        names: Names of the files to merge.
    """
    die_with_parent()
    resource.setrlimit(resource.RLIMIT_AS, (_MEMORY_BYTES, _MEMORY_BYTES))
    try:
        sys.stdout.write(json.dumps(join(Path(folder), names)))
    except (OSError, ValueError, KeyError, struct.error, MemoryError, zstandard.ZstdError, McapError) as error:
        sys.stderr.write(f"{type(error).__name__}: {error}\n")
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
