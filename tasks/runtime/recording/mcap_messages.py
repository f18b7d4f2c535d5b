"""Messages as records of an MCAP file, alone and in rows, and their order in a chunk."""

import struct
from collections.abc import Iterator, Mapping, Sequence
from itertools import chain
from typing import NamedTuple

import numpy as np
from mcap.opcode import Opcode
from numpy.typing import NDArray

_MESSAGE = struct.Struct("<BQHIQQ")
_MESSAGE_OPCODE = int(Opcode.MESSAGE)
_MESSAGE_FIELDS_BYTES = _MESSAGE.size - struct.calcsize("<BQ")
TIMES_OFFSET = struct.calcsize("<BQHI")
"""Where in a message's record its log time and publish time are, unsigned integers of 8 bytes."""
RECORD_HEAD_BYTES = _MESSAGE.size
"""What a message's record has before the message itself."""


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


def in_order(
    introductions: bytes, rows: Sequence[Rows], messages: Sequence[tuple[int, int, bytes]]
) -> tuple[Iterator[bytes | memoryview], int, dict[int, NDArray[np.uint64]]]:
    """Puts messages and rows in the order of their times.

    Returns:
        The content of a chunk in pieces, its size, and by channel the times of its messages
        and their places in the chunk.
    """
    sizes = [np.full(len(item.times_ns), len(item.records) // len(item.times_ns)) for item in rows]
    lengths = np.concatenate([*sizes, np.fromiter((len(record) for _, _, record in messages), np.int64, len(messages))])
    time_ns = np.concatenate(
        [*(item.times_ns for item in rows), np.array([time_ns for time_ns, _, _ in messages], np.int64)]
    )
    order = np.argsort(time_ns, kind="stable")
    places = np.empty(len(order), np.int64)
    places[order] = len(introductions) + np.cumsum(lengths[order]) - lengths[order]
    pieces = chain((introductions,), _pieces(order, rows, [record for _, _, record in messages]))
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
    return pieces, len(introductions) + int(lengths.sum()), _by_channel(channels)


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
