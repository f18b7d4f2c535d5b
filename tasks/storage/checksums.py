"""CRC32 as S3 writes it, of what is sent and of what has arrived."""

import base64
import zlib
from collections.abc import Mapping
from typing import Any, BinaryIO

from ...schemas.wire.errors import ChecksumMismatchError

_CHUNK_BYTES = 1 << 20


def crc32_of(data: bytes) -> str:
    """The CRC32 of bytes, in base64."""
    return _written(zlib.crc32(data))


def measure(file: BinaryIO) -> tuple[int, str]:
    """Size and CRC32 of what is left to read of a file."""
    size = crc = 0
    while chunk := file.read(_CHUNK_BYTES):
        size += len(chunk)
        crc = zlib.crc32(chunk, crc)
    return size, _written(crc)


def compare(answer: Mapping[str, Any], size: int, crc: str, what: str) -> None:
    """Compares a server's answer about an object with what is here.

    Args:
        answer: of HeadObject or GetObject; not every object has a CRC32 of the whole.
        size: bytes here.
        crc: CRC32 of the bytes here, in base64.
        what: the object, for the message.

    Raises:
        ChecksumMismatchError: they differ.
    """
    whole = answer.get("ChecksumType", "FULL_OBJECT") == "FULL_OBJECT"
    stored = answer.get("ChecksumCRC32") if whole else None
    if answer["ContentLength"] != size:
        raise ChecksumMismatchError(f"{what}: {answer['ContentLength']} bytes there, {size} here")
    if stored and stored != crc:
        raise ChecksumMismatchError(f"{what}: CRC32 {stored} there, {crc} here")


def _written(crc: int) -> str:
    return base64.b64encode(crc.to_bytes(4, "big")).decode()
