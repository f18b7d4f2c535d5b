"""Checksums as in S3's API, of sent and received data and of files, without reading the holes of sparse files."""

import base64
import errno
import hashlib
import os
import time
import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from functools import lru_cache
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

from ...schemas.wire.errors import ChecksumMismatchError, TransferStoppedError
from .object_store import Stopped, never

_PIECE_BYTES = 1 << 20
_ZEROS = memoryview(bytes(_PIECE_BYTES))


class Piece(NamedTuple):
    """A piece of a file's content: its data, and whether it is a hole of a sparse file (zeros)."""

    data: memoryview
    is_hole: bool
    """Whether a piece of a sparse file is a hole, without a disk block; its data are zeros then."""


def pieces(descriptor: int, stopped: Stopped = never, what: str = "the file") -> Iterator[Piece]:
    """Yields the content of an open file in pieces, from its beginning.

    Args:
        descriptor: The file.
        stopped: Called at the beginning, and before each piece of at most 1 MiB; true stops.
        what: The file, for messages.

    Raises:
        TransferStoppedError: `stopped` said so.
        OSError: The file cannot be read.
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
    """Returns the hexadecimal digest of an open file, and its size.

    Raises:
        TransferStoppedError: `stopped` said so.
        OSError: The file cannot be read.
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
    """Copies a sparse file with its holes; returns its size.

    Args:
        source: The file.
        target: The copy, at its beginning.
        stopped: Called before each piece of at most 1 MiB; true stops.
        tell: Called with each piece, such as to compute a checksum.
        what: The file, for messages.

    Raises:
        TransferStoppedError: `stopped` said so.
        OSError: The file cannot be read or written.
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
    """Returns the offset of a sparse file's next data from an offset on; `None` if only a hole or nothing follows."""
    try:
        return os.lseek(descriptor, offset, os.SEEK_DATA)
    except OSError as error:
        return None if error.errno == errno.ENXIO else offset  # a file system without holes has data everywhere


def _hole_from(descriptor: int, offset: int) -> int:
    """Returns the offset of a sparse file's next hole; the end of the file counts as one."""
    with suppress(OSError):
        return os.lseek(descriptor, offset, os.SEEK_HOLE)
    return os.fstat(descriptor).st_size


_CHUNK_BYTES = 1 << 20
_ATTRIBUTE = "user.robomaker.etag"
_REMEMBERED = 16_384
_STORING_NS = 20_000_000
"""Longest time from reading the clock to storing an ETag in a file's attributes, in nanoseconds.

File systems stamp changes by a clock that ticks every 1 to 10 ms.
"""
_TRIES = 5
"""Number of attempts to store an ETag within that time; on a busy machine it may take longer."""
_CRC32_POLYNOMIAL = 0xEDB88320  # of zlib, PNG and S3; the highest power is the lowest bit
_ONE = 1 << 31
_X_TO_THE_8 = 1 << 23

_computed: dict[tuple[int, str, int], str] = {}


def crc32_of(data: bytes) -> str:
    """Returns the CRC32 of bytes, in base64."""
    return crc32_text(zlib.crc32(data))


def crc32_text(crc: int) -> str:
    """Formats a CRC32 as S3 does, in base64."""
    return base64.b64encode(crc.to_bytes(4, "big")).decode()


def crc32_of_parts(parts: Iterable[tuple[int, int]]) -> str:
    """Returns the CRC32 of a whole in base64, combined from the CRC32 values of its parts.

    Each part adds its own CRC32; the CRC32 of the parts before it is shifted by the part's size, which in the
    arithmetic of CRCs is a product with a power of x (as in zlib's `crc32_combine`, which Python does not offer).
    """
    whole = 0
    for crc, size in parts:
        whole = _product(_shift(size), whole) ^ crc
    return crc32_text(whole)


@lru_cache(maxsize=64)  # the parts of a file have one size, and the last one another
def _shift(size: int) -> int:
    """Returns the power of x for a shift by that many bytes, modulo the CRC32 polynomial."""
    shift, power = _ONE, _X_TO_THE_8
    while size:
        if size & 1:
            shift = _product(power, shift)
        power = _product(power, power)
        size >>= 1
    return shift


def _product(a: int, b: int) -> int:
    """Returns the product of two polynomials over GF(2), modulo the CRC32 polynomial."""
    product = 0
    for place in range(31, -1, -1):
        if a >> place & 1:
            product ^= b
        b = b >> 1 ^ _CRC32_POLYNOMIAL if b & 1 else b >> 1
    return product


def measure(file: BinaryIO) -> tuple[int, str]:
    """Returns the size in bytes and the CRC32 (in base64) of a file from its present position to its end."""
    size = crc = 0
    while chunk := file.read(_CHUNK_BYTES):
        size += len(chunk)
        crc = zlib.crc32(chunk, crc)
    return size, crc32_text(crc)


def compare(answer: Mapping[str, Any], size: int, crc: str, what: str) -> None:
    """Raises an error if a server's size or CRC32 of an object differs from the expected ones.

    Args:
        answer: Response of HeadObject or GetObject; not every object has a CRC32 of the whole.
        size: Bytes here.
        crc: CRC32 of the bytes here, in base64.
        what: The object, for the message.

    Raises:
        ChecksumMismatchError: Size or CRC32 differ.
    """
    whole = answer.get("ChecksumType", "FULL_OBJECT") == "FULL_OBJECT"
    stored = answer.get("ChecksumCRC32") if whole else None
    if answer["ContentLength"] != size:
        raise ChecksumMismatchError(f"{what}: {answer['ContentLength']} bytes there, {size} here")
    if stored and stored != crc:
        raise ChecksumMismatchError(f"{what}: CRC32 {stored} there, {crc} here")


def has_content(answer: Mapping[str, Any], path: Path, stopped: Stopped = never) -> bool:
    """Whether a stored object has the same content as a file, as far as its checksums prove it.

    Args:
        answer: Response of HeadObject.
        path: The file.
        stopped: Polled while the file is read; true stops that.

    Raises:
        TransferStoppedError: `stopped` said so.
        OSError: The file cannot be read.
    """
    with path.open("rb") as file:
        if os.fstat(file.fileno()).st_size != answer["ContentLength"]:
            return False
        if answer.get("ChecksumCRC32") and answer.get("ChecksumType", "FULL_OBJECT") == "FULL_OBJECT":
            crc = 0
            for piece in pieces(file.fileno(), stopped):
                crc = zlib.crc32(piece.data, crc)
            return crc32_text(crc) == answer["ChecksumCRC32"]
        # Of an object in one piece it is the MD5, but not where the server encrypts; then they differ.
        return digest_of(file.fileno(), "md5", stopped)[0] == answer["ETag"].strip('"')


def store_etag(descriptor: int, etag: str) -> None:
    """Caches a file's ETag in its extended attributes, where the file system can.

    Args:
        descriptor: The file, open, after its last write, and after it got its name, which changes the change time.
        etag: Hexadecimal MD5 of its content.
    """
    # Not every file system and platform has user attributes; then it is computed when asked for.
    with suppress(OSError, AttributeError):
        # Setting an attribute is itself a change, so that the change time cannot be written into it; the time now can.
        for _ in range(_TRIES):
            now_ns = time.time_ns()
            os.setxattr(descriptor, _ATTRIBUTE, f"{_version(descriptor)} {now_ns} {etag}".encode())
            if abs(os.fstat(descriptor).st_ctime_ns - now_ns) <= _STORING_NS:
                return


def etag_of(descriptor: int, stopped: Stopped = never) -> str:
    """Returns the ETag (MD5) of an open file, cached if possible.

    Args:
        descriptor: The file.
        stopped: Polled while the file is read; true stops that.

    Raises:
        TransferStoppedError: `stopped` said so.
        OSError: The file cannot be read.
    """
    if (etag := _kept_etag(descriptor)) is not None:
        return etag
    key = _change(descriptor)
    if key in _computed:
        return _computed[key]
    position = os.lseek(descriptor, 0, os.SEEK_CUR)
    etag, _ = digest_of(descriptor, "md5", stopped)
    os.lseek(descriptor, position, os.SEEK_SET)
    if _change(descriptor) == key:  # it was not written to meanwhile
        store_etag(descriptor, etag)
        if len(_computed) >= _REMEMBERED:
            _computed.clear()
        _computed[_change(descriptor)] = etag
    return etag


def _kept_etag(descriptor: int) -> str | None:
    """Returns the ETag cached in a file's attributes, if the file has not changed since; else `None`."""
    with suppress(OSError, AttributeError, ValueError):
        version, stored_ns, etag = os.getxattr(descriptor, _ATTRIBUTE).decode().rsplit(" ", 2)
        is_last_change = abs(os.fstat(descriptor).st_ctime_ns - int(stored_ns)) <= _STORING_NS
        if version == _version(descriptor) and is_last_change:
            return etag
    return None


def _version(descriptor: int) -> str:
    found = os.fstat(descriptor)
    return f"{found.st_size} {found.st_mtime_ns} {found.st_ino}"


def _change(descriptor: int) -> tuple[int, str, int]:
    """Returns device, version and change time of a file; some of them differ after any change."""
    found = os.fstat(descriptor)
    return found.st_dev, _version(descriptor), found.st_ctime_ns
