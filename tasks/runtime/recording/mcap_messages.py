"""Messages as records of an MCAP file, alone and in rows, and their order in a chunk."""

import struct
from collections import defaultdict
from collections.abc import Mapping, Sequence
from operator import itemgetter
from typing import NamedTuple

import numpy as np
from mcap.opcode import Opcode
from numpy.typing import NDArray

_MESSAGE = struct.Struct("<BQHIQQ")
_MESSAGE_OPCODE = int(Opcode.MESSAGE)
_MESSAGE_FIELDS_BYTES = _MESSAGE.size - struct.calcsize("<BQ")
TIMES_OFFSET = struct.calcsize("<BQHI")
"""Position of log time and publish time in a message's record, in bytes; both are unsigned integers of 8 bytes."""
RECORD_HEAD_BYTES = _MESSAGE.size
"""Size of a record's part before the message itself, in bytes."""


class Rows(NamedTuple):
    """Messages of several topics that were logged at the same times: a row has one of each."""

    times_ns: NDArray[np.int64]
    """When they were logged, in order."""

    records: bytes | memoryview
    """The rows one after the other, each the records of its messages (see `message_record`)."""

    starts: Mapping[int, int]
    """Position of each channel's record in a row, in bytes, by channel."""


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
) -> tuple[bytes, dict[int, list[int]]]:
    """Puts messages and rows in the order of their times; at the same time rows come first.

    Args:
        introductions: What the chunk begins with.
        rows: Messages in rows.
        messages: Time, channel and record of the others.

    Returns:
        The content of a chunk, and by channel the time and the place in the chunk of each message, one after the other.
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
