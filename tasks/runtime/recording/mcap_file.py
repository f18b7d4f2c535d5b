"""Writer of MCAP files: records, chunks, indexes, and the output stream."""

import errno
import os
import struct
import zlib
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from operator import itemgetter
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import numpy as np
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Schema,
    Statistics,
    SummaryOffset,
)
from numpy.typing import NDArray

_MESSAGE = struct.Struct("<BQHIQQ")
_MESSAGE_OPCODE = int(Opcode.MESSAGE)
_MESSAGE_FIELDS_BYTES = _MESSAGE.size - struct.calcsize("<BQ")
TIMES_OFFSET = struct.calcsize("<BQHI")
"""Position of log time and publish time in a message's record, in bytes; both are unsigned integers of 8 bytes."""
RECORD_HEAD_BYTES = _MESSAGE.size
"""Size of the header of a message record, before the message data, in bytes."""


class Rows(NamedTuple):
    """Messages of several topics with the same log times, as rows: a row has one message of each topic."""

    times_ns: NDArray[np.int64]
    """Log times of the messages, in order."""

    records: bytes | memoryview
    """Bytes of all rows; each row has the records of its messages (see `message_record`)."""

    starts: Mapping[int, int]
    """Byte offset of each channel's record within a row, by channel."""


def message_record(channel_id: int, time_ns: int, data: bytes) -> bytes:
    """Returns a message as an MCAP record.

    Args:
        channel_id: From `McapFile.add_channel`.
        time_ns: Log time and publish time in nanoseconds.
        data: Encoded message.
    """
    return _MESSAGE.pack(_MESSAGE_OPCODE, _MESSAGE_FIELDS_BYTES + len(data), channel_id, 0, time_ns, time_ns) + data


def in_order(
    introductions: bytes, rows: Sequence[Rows], messages: Sequence[tuple[int, int, bytes]]
) -> tuple[bytes, dict[int, list[int]]]:
    """Sorts messages and rows of an MCAP chunk by time; rows come first at equal times.

    Args:
        introductions: Bytes at the beginning of the chunk.
        rows: Messages in rows.
        messages: Time, channel and record of the other messages.

    Returns:
        Content of the chunk; and by channel the time and byte offset of each message, one after the other.
    """
    pieces: list[tuple[int, bytes | memoryview, Mapping[int, int]]] = []
    for item in rows:
        raw, size = memoryview(item.records), len(item.records) // len(item.times_ns)
        pieces += [
            (time_ns, raw[row * size : (row + 1) * size], item.starts)
            for row, time_ns in enumerate(item.times_ns.tolist())
        ]
    pieces += [(time_ns, record, {channel: 0}) for time_ns, channel, record in messages]
    pieces.sort(key=itemgetter(0))
    entries: defaultdict[int, list[int]] = defaultdict(list)
    place = len(introductions)
    for time_ns, piece, starts in pieces:
        for channel, start in starts.items():
            entries[channel] += (time_ns, place + start)
        place += len(piece)
    return b"".join((introductions, *(piece for _, piece, _ in pieces))), entries


_MAGIC = b"\x89MCAP0\r\n"
_MESSAGE_INDEX = struct.Struct("<BQHI")
_PLACE_BYTES = 8
_FOOTER_START = struct.Struct("<BQQQ")
_FOOTER_BYTES = 8 + 8 + 4
_COMPRESSION = "zstd"
_COMPRESSION_LEVEL = -2
"""zstd compression level: takes a third of the default level's time; files are a tenth larger."""


class Stream(Protocol):
    """Interface of the output stream that an MCAP file is written to."""

    def write(self, data: bytes, /) -> object:
        """Writes all of the bytes to the output stream."""
        ...

    def tell(self) -> int:
        """Returns the number of bytes written to the output stream."""
        ...


class McapFile:
    """Writer of an MCAP file (robot recording): zstd chunks with checksums, indexes and statistics."""

    def __init__(
        self,
        stream: Stream,
        profile: str,
        library: str,
        chunk_bytes: int,
        take_rows: Callable[[], Iterable[Rows]] = tuple,
    ) -> None:
        """Writes the beginning of an MCAP file to a stream.

        Args:
            stream: Stream to write to.
            profile: Name of the MCAP profile, `ros2`.
            library: Name of the writing library.
            chunk_bytes: Size of pending messages, without rows, at which a chunk is written.
            take_rows: Called at every chunk for further rows; returned rows count as written.
        """
        self._stream = stream
        self._take_rows = take_rows
        self._chunk_bytes = chunk_bytes
        self._compressor = zstandard.ZstdCompressor(_COMPRESSION_LEVEL)
        self._introductions = bytearray()
        """Schema and channel records at the beginning of the next chunk."""
        self._schemas: dict[tuple[str, str], Schema] = {}
        """Schemas by type and definition: nodes may have different definitions of one type."""
        self._channels: list[Channel] = []
        self._messages: list[tuple[int, int, bytes]] = []
        """Time, channel and record of the messages that wait for their chunk."""
        self._waiting_bytes = 0
        self._counts: dict[int, int] = {}
        self._chunk_indexes: list[ChunkIndex] = []
        stream.write(_MAGIC + _bytes_of(Header(profile, library)))

    def add_channel(self, topic: str, message_type: str, definition: str, metadata: dict[str, str]) -> int:
        """Adds a topic of CDR messages to the file.

        Args:
            topic: Topic name, such as `/odom`.
            message_type: ROS type, `nav_msgs/msg/Odometry`.
            definition: Definition of the type as concatenated `.msg` files; empty if unknown.
            metadata: Other information about the topic for players.

        Returns:
            The channel's number, for `add_message`.
        """
        schema = self._schemas.get((message_type, definition))
        if schema is None:
            encoding = "ros2msg" if definition else ""  # as `rosbag2_storage_mcap` says that it does not know
            schema = Schema(len(self._schemas) + 1, definition.encode(), encoding, message_type)
            self._schemas[message_type, definition] = schema
            self._introductions += _bytes_of(schema)
        channel = Channel(len(self._channels) + 1, topic, "cdr", metadata, schema.id)
        self._channels.append(channel)
        self._introductions += _bytes_of(channel)
        return channel.id

    def add_message(self, channel_id: int, time_ns: int, data: bytes) -> None:
        """Adds a message, which is written with its chunk.

        Args:
            channel_id: From `add_channel`.
            time_ns: Log time and publish time in nanoseconds.
            data: Encoded message.
        """
        record = message_record(channel_id, time_ns, data)
        self._messages.append((time_ns, channel_id, record))
        self._waiting_bytes += len(record)
        if self._waiting_bytes >= self._chunk_bytes:
            self.flush()

    def flush(self) -> None:
        """Writes all pending messages as a chunk, in the order of their times.

        Messages of the same time are in the order in which they were added, rows first.
        """
        # What was taken is not written twice, wherever a signal interrupts this.
        messages, self._messages, self._waiting_bytes = self._messages, [], 0
        rows = [item for item in self._take_rows() if len(item.times_ns)]
        if not messages and not rows:
            return
        raw, entries = in_order(bytes(self._introductions), rows, messages)
        self._introductions.clear()
        self._write_chunk(raw, entries)
        for channel, column in entries.items():
            self._counts[channel] = self._counts.get(channel, 0) + len(column) // 2

    def state(self) -> dict[str, Any]:
        """Writes pending messages to the file, and returns the state from which another process can continue it."""
        self.flush()
        return {
            "introductions": bytes(self._introductions),
            "schemas": dict(self._schemas),
            "channels": list(self._channels),
            "counts": dict(self._counts),
            "chunk_indexes": list(self._chunk_indexes),
            "position": self._stream.tell(),
        }

    def restore(self, state: Mapping[str, Any], stream: Stream) -> None:
        """Continues a file from a state that `state` returned; messages pending here are dropped.

        Args:
            state: Result of `state`.
            stream: Stream of the file, which ends at the `position` in the state.
        """
        for _ in self._take_rows():
            pass  # what came before belongs to another beginning
        self._stream = stream
        self._messages, self._waiting_bytes = [], 0
        self._introductions = bytearray(state["introductions"])
        self._schemas, self._channels = dict(state["schemas"]), list(state["channels"])
        self._counts, self._chunk_indexes = dict(state["counts"]), list(state["chunk_indexes"])

    def contents(self) -> tuple[dict[int, int], int, int]:
        """Returns what the file has so far: number of messages by channel number, first and last log time in ns.

        Messages that wait for their chunk are not counted; both times are 0 if nothing was written.
        """
        start_ns = min((index.message_start_time for index in self._chunk_indexes), default=0)
        end_ns = max((index.message_end_time for index in self._chunk_indexes), default=0)
        return dict(self._counts), start_ns, end_ns

    def finish(self) -> None:
        """Writes pending messages and the index section at the end of the MCAP file; the stream stays open."""
        self.flush()
        self._stream.write(_bytes_of(DataEnd(0)))
        start = self._stream.tell()
        summary, offsets = b"", b""
        groups: list[tuple[Opcode, list[McapRecord]]] = [
            (Opcode.SCHEMA, [*self._schemas.values()]),
            (Opcode.CHANNEL, [*self._channels]),
            (Opcode.STATISTICS, [self._statistics()]),
            (Opcode.CHUNK_INDEX, [*self._chunk_indexes]),
        ]
        for opcode, records in groups:
            group = b"".join(map(_bytes_of, records))
            if group:
                offsets += _bytes_of(SummaryOffset(opcode, group_start=start + len(summary), group_length=len(group)))
            summary += group
        offset_start = start + len(summary)
        summary += offsets
        checked = summary + _FOOTER_START.pack(Opcode.FOOTER, _FOOTER_BYTES, start, offset_start)
        footer = Footer(summary_start=start, summary_offset_start=offset_start, summary_crc=zlib.crc32(checked))
        self._stream.write(summary + _bytes_of(footer) + _MAGIC)

    def _write_chunk(self, raw: bytes, messages: Mapping[int, Sequence[int]]) -> None:
        first_ns = min(entries[0] for entries in messages.values())
        last_ns = max(entries[-2] for entries in messages.values())
        data = self._compressor.compress(raw)
        chunk = _bytes_of(Chunk(_COMPRESSION, data, last_ns, first_ns, zlib.crc32(raw), len(raw)))
        start, indexes, places = self._stream.tell(), b"", {}
        for channel, entries in messages.items():
            places[channel] = start + len(chunk) + len(indexes)
            size = _PLACE_BYTES * len(entries)
            indexes += _MESSAGE_INDEX.pack(Opcode.MESSAGE_INDEX, 6 + size, channel, size)
            indexes += np.array(entries, "<u8").tobytes()
        self._stream.write(chunk + indexes)
        self._chunk_indexes.append(
            ChunkIndex(
                chunk_length=len(chunk),
                chunk_start_offset=start,
                compression=_COMPRESSION,
                compressed_size=len(data),
                message_end_time=last_ns,
                message_index_length=len(indexes),
                message_index_offsets=places,
                message_start_time=first_ns,
                uncompressed_size=len(raw),
            )
        )

    def _statistics(self) -> Statistics:
        counts, start_ns, end_ns = self.contents()
        return Statistics(
            attachment_count=0,
            channel_count=len(self._channels),
            channel_message_counts=counts,
            chunk_count=len(self._chunk_indexes),
            message_count=sum(counts.values()),
            message_end_time=end_ns,
            message_start_time=start_ns,
            metadata_count=0,
            schema_count=len(self._schemas),
        )


def _bytes_of(record: McapRecord) -> bytes:
    builder = RecordBuilder()
    record.write(builder)
    return builder.end()


class Unbuffered:
    """Binary output stream without a buffer, so that finished chunks survive a killed process."""

    def __init__(self, path: Path, keep_bytes: int = 0) -> None:
        """Opens a recording file for writing, and cuts it after `keep_bytes` bytes; creates or empties it if that is 0.

        Raises:
            OSError: The file is shorter than `keep_bytes`, or cannot be opened.
        """
        fresh = 0 if keep_bytes else os.O_TRUNC
        self._descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_CLOEXEC | fresh, 0o644)
        self._position = keep_bytes
        if fresh:
            return
        if os.fstat(self._descriptor).st_size < keep_bytes:
            os.close(self._descriptor)
            raise OSError(errno.ENODATA, f"it has less than the {keep_bytes} bytes that it had at the checkpoint")
        os.ftruncate(self._descriptor, keep_bytes)
        os.lseek(self._descriptor, keep_bytes, os.SEEK_SET)

    def write(self, data: bytes) -> int:
        """Writes all of the bytes to the file, repeating partial writes, and returns their number."""
        view = memoryview(data)
        while view:
            written = os.write(self._descriptor, view)
            self._position += written
            view = view[written:]
        return len(data)

    def tell(self) -> int:
        """Returns the number of bytes that the file has, with those just written."""
        return self._position

    def close(self) -> None:
        """Closes the recording file; nothing is buffered that could be lost."""
        os.close(self._descriptor)


class Nowhere:
    """Output stream that discards its bytes."""

    def write(self, data: bytes) -> int:
        """Discards the bytes, and returns their number."""
        return len(data)

    def tell(self) -> int:
        """Returns 0 as the position, however much was written."""
        return 0

    def close(self) -> None:
        """Does nothing."""
