"""Reads files without their holes: what a sparse file has no blocks for is known to be zeros, and is not read.

A file of 256 GB without any block is made in a moment, by anybody. What is computed of it still costs its size, so
every reader here asks between two pieces whether to go on.
"""

import errno
import hashlib
import os
from collections.abc import Callable, Iterator
from contextlib import suppress
from typing import BinaryIO, NamedTuple

from ...schemas.wire.errors import TransferStoppedError
from .base import Stopped, never

_PIECE_BYTES = 1 << 20
_ZEROS = memoryview(bytes(_PIECE_BYTES))


class Piece(NamedTuple):
    """A part of a file's content."""

    data: memoryview
    is_hole: bool
    """Whether the file has no block for it; the data are zeros then."""


def pieces(descriptor: int, stopped: Stopped = never, what: str = "the file") -> Iterator[Piece]:
    """Yields the content of an open file in pieces, from its beginning; its read position may move.

    Args:
        descriptor: the file.
        stopped: asked at the beginning, and before each piece, of which none has more than 1 MiB.
        what: the file, for messages.

    Raises:
        TransferStoppedError: `stopped` said so.
        OSError: it cannot be read.
    """
    _go_on(stopped, what)  # also before an empty file: there may be very many
    offset = 0
    while True:
        data = _data_from(descriptor, offset)
        end = os.fstat(descriptor).st_size
        while offset < (end if data is None else data):
            size = min(_PIECE_BYTES, (end if data is None else data) - offset)
            _go_on(stopped, what)
            yield Piece(_ZEROS[:size], is_hole=True)
            offset += size
        if data is None:
            return
        hole = _hole_from(descriptor, offset)
        while offset < hole:
            _go_on(stopped, what)
            read = os.pread(descriptor, min(_PIECE_BYTES, hole - offset), offset)
            if not read:
                return  # it was cut off
            yield Piece(memoryview(read), is_hole=False)
            offset += len(read)


def digest_of(descriptor: int, algorithm: str, stopped: Stopped = never) -> tuple[str, int]:
    """Returns the hexadecimal digest of an open file's content, and its size.

    Raises:
        TransferStoppedError: `stopped` said so.
        OSError: it cannot be read.
    """
    digest, size = hashlib.new(algorithm, usedforsecurity=False), 0
    for piece in pieces(descriptor, stopped):
        digest.update(piece.data)
        size += len(piece.data)
    return digest.hexdigest(), size


def copy_with_holes(
    source: int,
    target: BinaryIO,
    stopped: Stopped = never,
    tell: Callable[[memoryview], object] = len,
    what: str = "the file",
) -> int:
    """Copies an open file's content to an empty file, which has the same holes; returns its size.

    Args:
        source: the file.
        target: the copy, at its beginning.
        stopped: see `pieces`.
        tell: told of each piece, such as to compute a checksum.
        what: the file, for messages.

    Raises:
        TransferStoppedError: `stopped` said so.
        OSError: it cannot be read or written.
    """
    size = 0
    for piece in pieces(source, stopped, what):
        if piece.is_hole:
            target.seek(len(piece.data), os.SEEK_CUR)
        else:
            target.write(piece.data)
        tell(piece.data)
        size += len(piece.data)
    target.truncate(size)
    return size


def _go_on(stopped: Stopped, what: str) -> None:
    if stopped():
        raise TransferStoppedError(f"{what} is not wanted any more")


def _data_from(descriptor: int, offset: int) -> int | None:
    """Offset of the next data; `None`: there is only a hole, or nothing."""
    try:
        return os.lseek(descriptor, offset, os.SEEK_DATA)
    except OSError as error:
        return None if error.errno == errno.ENXIO else offset  # a file system without holes has data everywhere


def _hole_from(descriptor: int, offset: int) -> int:
    """Offset of the next hole; a file ends with one."""
    with suppress(OSError):
        return os.lseek(descriptor, offset, os.SEEK_HOLE)
    return os.fstat(descriptor).st_size
