"""Writes MCAP files, several times faster per message than the `mcap` package's own writer.

Messages, of which there are thousands, are packed here, or come as rows of ready records; everything that is rare
(schemas, channels, chunks, indexes) is written with the package's record types.
"""

import struct
import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
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

_MAGIC = b"\x89MCAP0\r\n"
_MESSAGE = struct.Struct("<BQHIQQ")
_MESSAGE_OPCODE = int(Opcode.MESSAGE)
_MESSAGE_FIELDS_BYTES = _MESSAGE.size - struct.calcsize("<BQ")
_MESSAGE_INDEX = struct.Struct("<BQHI")
_FOOTER_START = struct.Struct("<BQQQ")
_FOOTER_BYTES = 8 + 8 + 4
TIMES_OFFSET = struct.calcsize("<BQHI")
"""Where in a message's record its log time and publish time are, unsigned integers of 8 bytes."""
RECORD_HEAD_BYTES = _MESSAGE.size
"""What a message's record has before the message itself."""
_COMPRESSION_LEVEL = -2
"""A third of the time of the default; files become a tenth larger."""


class Stream(Protocol):
    """Where the bytes go."""

    def write(self, data: bytes, /) -> object:
        """Takes all of the bytes."""
        ...

    def tell(self) -> int:
        """Returns how many bytes were written so far."""
        ...


class Rows(NamedTuple):
    """Messages of several topics that were logged at the same times: a row has one of each."""

    times_ns: NDArray[np.int64]
    """When they were logged, in order."""

    records: bytes | memoryview
    """The rows one after the other, each the records of its messages (see `message_record`)."""

    starts: Mapping[int, int]
    """Where in a row the record of each channel begins."""


def message_record(channel_id: int, time_ns: int, data: bytes) -> bytes:
    """Returns a message as a record of the file; log time and publish time are `TIMES_OFFSET` bytes from its beginning.

    Args:
        channel_id: From `McapFile.add_channel`.
        time_ns: When it was logged and published.
        data: The message.
    """
    return _MESSAGE.pack(_MESSAGE_OPCODE, _MESSAGE_FIELDS_BYTES + len(data), channel_id, 0, time_ns, time_ns) + data


class McapFile:
    """An MCAP file that is being written: zstd chunks with checksums, indexes and statistics."""

    def __init__(
        self,
        stream: Stream,
        profile: str,
        library: str,
        chunk_bytes: int,
        take_rows: Callable[[], Iterable[Rows]] = tuple,
    ) -> None:
        """Writes the beginning of the file.

        Args:
            stream: Where to.
            profile: What kind of messages these are, `ros2`.
            library: Who writes.
            chunk_bytes: Size of the messages from which on a chunk is written, rows not counted.
            take_rows: Asked at every chunk for what else is to be in it; what it returned counts as written.
        """
        self._stream = stream
        self._take_rows = take_rows
        self._chunk_bytes = chunk_bytes
        self._compressor = zstandard.ZstdCompressor(_COMPRESSION_LEVEL)
        self._introductions = bytearray()
        """Schemas and channels that the next chunk begins with."""
        self._schemas: dict[str, Schema] = {}
        self._channels: list[Channel] = []
        self._messages: list[tuple[int, int, bytes]] = []
        """Time, channel and record of the messages that wait for their chunk."""
        self._waiting_bytes = 0
        self._counts: dict[int, int] = {}
        self._chunk_indexes: list[ChunkIndex] = []
        stream.write(_MAGIC + _bytes_of(Header(profile, library)))

    def add_channel(self, topic: str, message_type: str, definition: str, metadata: dict[str, str]) -> int:
        """Adds a topic of CDR messages.

        Args:
            topic: `/odom`.
            message_type: ROS type, `nav_msgs/msg/Odometry`.
            definition: What the type looks like, as concatenated `.msg` files.
            metadata: What else a player has to know of the topic.

        Returns:
            The channel's number, for `add_message`.
        """
        schema = self._schemas.get(message_type)
        if schema is None:
            schema = Schema(len(self._schemas) + 1, definition.encode(), "ros2msg", message_type)
            self._schemas[message_type] = schema
            self._introductions += _bytes_of(schema)
        channel = Channel(len(self._channels) + 1, topic, "cdr", metadata, schema.id)
        self._channels.append(channel)
        self._introductions += _bytes_of(channel)
        return channel.id

    def add_message(self, channel_id: int, time_ns: int, data: bytes) -> None:
        """Adds a message, which is written with its chunk.

        Args:
            channel_id: From `add_channel`.
            time_ns: When it was logged and published.
            data: The message.
        """
        record = message_record(channel_id, time_ns, data)
        self._messages.append((time_ns, channel_id, record))
        self._waiting_bytes += len(record)
        if self._waiting_bytes >= self._chunk_bytes:
            self.flush()

    def flush(self) -> None:
        """Writes the messages and the rows so far as a chunk in the order of their times, if there are any.

        Messages of the same time are in the order in which they were added, rows first.
        """
        # What was taken is not written twice, wherever a signal interrupts this.
        messages, self._messages, self._waiting_bytes = self._messages, [], 0
        rows = [item for item in self._take_rows() if len(item.times_ns)]
        if not messages and not rows:
            return
        raw, entries = _in_order(bytes(self._introductions), rows, messages)
        self._introductions.clear()
        times = [column[:, 0] for column in entries.values()]
        chunk = Chunk(
            compression="zstd",
            data=self._compressor.compress(raw),
            message_start_time=min(int(column.min()) for column in times),
            message_end_time=max(int(column.max()) for column in times),
            uncompressed_crc=zlib.crc32(raw),
            uncompressed_size=len(raw),
        )
        self._write_chunk(chunk, entries)
        for channel, column in entries.items():
            self._counts[channel] = self._counts.get(channel, 0) + len(column)

    def state(self) -> dict[str, Any]:
        """Writes what is pending; returns what `restore` needs to go on after it."""
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
        """Goes on in a file as it was when `state` was called; what is pending here is dropped.

        Args:
            state: From `state`.
            stream: The file, which ends at the `position` of the state.
        """
        for _ in self._take_rows():
            pass  # what came before belongs to another beginning
        self._stream = stream
        self._messages, self._waiting_bytes = [], 0
        self._introductions = bytearray(state["introductions"])
        self._schemas, self._channels = dict(state["schemas"]), list(state["channels"])
        self._counts, self._chunk_indexes = dict(state["counts"]), list(state["chunk_indexes"])

    def contents(self) -> tuple[dict[int, int], int, int]:
        """Returns what is in the chunks so far: messages by channel, and log times of the first and the last one."""
        start_ns = min((index.message_start_time for index in self._chunk_indexes), default=0)
        end_ns = max((index.message_end_time for index in self._chunk_indexes), default=0)
        return dict(self._counts), start_ns, end_ns

    def finish(self) -> None:
        """Writes what is pending, and the indexes that end the file; the stream stays open."""
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

    def _write_chunk(self, chunk: Chunk, messages: dict[int, NDArray[np.uint64]]) -> None:
        record = _bytes_of(chunk)
        start = self._stream.tell()
        indexes, places = b"", {}
        for channel, entries in messages.items():
            places[channel] = start + len(record) + len(indexes)
            size = entries.nbytes
            indexes += _MESSAGE_INDEX.pack(Opcode.MESSAGE_INDEX, 6 + size, channel, size) + entries.tobytes()
        self._stream.write(record + indexes)
        self._chunk_indexes.append(
            ChunkIndex(
                chunk_length=len(record),
                chunk_start_offset=start,
                compression=chunk.compression,
                compressed_size=len(chunk.data),
                message_end_time=chunk.message_end_time,
                message_index_length=len(indexes),
                message_index_offsets=places,
                message_start_time=chunk.message_start_time,
                uncompressed_size=chunk.uncompressed_size,
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


def _in_order(
    introductions: bytes, rows: Sequence[Rows], messages: Sequence[tuple[int, int, bytes]]
) -> tuple[bytes, dict[int, NDArray[np.uint64]]]:
    """Puts messages and rows in the order of their times.

    Returns:
        The content of a chunk, and by channel the times of its messages and their places in the chunk.
    """
    sizes = [np.full(len(item.times_ns), len(item.records) // len(item.times_ns)) for item in rows]
    lengths = np.concatenate([*sizes, np.fromiter((len(record) for _, _, record in messages), np.int64, len(messages))])
    time_ns = np.concatenate(
        [*(item.times_ns for item in rows), np.array([time_ns for time_ns, _, _ in messages], np.int64)]
    )
    order = np.argsort(time_ns, kind="stable")
    places = np.empty(len(order), np.int64)
    places[order] = len(introductions) + np.cumsum(lengths[order]) - lengths[order]
    pieces = _pieces(order, rows, [record for _, _, record in messages])
    channels: list[tuple[int, NDArray[np.int64], NDArray[np.int64]]] = []
    first = 0
    for item in rows:
        stop = first + len(item.times_ns)
        channels += [(channel, time_ns[first:stop], places[first:stop] + at) for channel, at in item.starts.items()]
        first = stop
    of_messages = np.fromiter((channel for _, channel, _ in messages), np.int64, len(messages))
    for channel in np.unique(of_messages).tolist():
        chosen = first + np.flatnonzero(of_messages == channel)
        channels.append((channel, time_ns[chosen], places[chosen]))
    return b"".join([introductions, *pieces]), _by_channel(channels)


def _pieces(order: NDArray[np.intp], rows: Sequence[Rows], records: Sequence[bytes]) -> Iterator[bytes | memoryview]:
    """Cuts rows where something else comes in between.

    Args:
        order: Numbers of the rows, one item after the other, and then of the other records.
        rows: The rows.
        records: What else there is.
    """
    sources: list[bytes | memoryview] = [memoryview(item.records) for item in rows]
    counts = np.array([*(len(item.times_ns) for item in rows), *(1 for _ in records)])
    sources += records
    firsts = np.cumsum(counts) - counts
    source_of = np.repeat(np.arange(len(sources)), counts)[order]
    # A piece goes on while the next number is the next row of the same source.
    begins = np.flatnonzero(np.concatenate(([True], (np.diff(order) != 1) | (np.diff(source_of) != 0))))
    ends = np.append(begins[1:], len(order)) - 1
    chosen = source_of[begins]
    first_rows, last_rows = order[begins] - firsts[chosen], order[ends] - firsts[chosen]
    for number, first, last in zip(chosen.tolist(), first_rows.tolist(), last_rows.tolist(), strict=True):
        source = sources[number]
        size = len(source) // int(counts[number])
        yield source[first * size : (last + 1) * size]


def _by_channel(
    parts: Sequence[tuple[int, NDArray[np.int64], NDArray[np.int64]]],
) -> dict[int, NDArray[np.uint64]]:
    """Times and places side by side; the messages of a channel may come in several parts."""
    entries: dict[int, NDArray[np.uint64]] = {}
    for channel, times, places in parts:
        columns = np.stack((times, places), axis=1).astype("<u8")
        entries[channel] = np.concatenate((entries[channel], columns)) if channel in entries else columns
    return entries


def _bytes_of(record: McapRecord) -> bytes:
    builder = RecordBuilder()
    record.write(builder)
    return builder.end()
