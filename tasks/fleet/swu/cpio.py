"""Archives in cpio's "new ASCII" format (`070701`), as SWUpdate reads them: plain files, one after the other."""

from collections.abc import Iterable
from typing import BinaryIO

MAX_BYTES = 2**32 - 1
"""The format has 32 bits for a file's length."""

_MAGIC = b"070701"
_PLAIN_FILE = 0o100644
_END = "TRAILER!!!"
_ALIGN = 4


def write_member(target: BinaryIO, number: int, name: str, parts: Iterable[bytes], size_bytes: int) -> None:
    """Appends a file.

    Args:
        target: the archive.
        number: of the file in the archive, from 1.
        name: the file's name.
        parts: its content, in parts.
        size_bytes: the length of all parts together.

    Raises:
        ValueError: the parts have another length.
    """
    target.write(_head(number, _PLAIN_FILE, name, size_bytes))
    written = 0
    for part in parts:
        target.write(part)
        written += len(part)
    if written != size_bytes:
        raise ValueError(f"{name} has {written} bytes and not {size_bytes}")
    target.write(bytes(-size_bytes % _ALIGN))


def write_end(target: BinaryIO) -> None:
    """Ends an archive."""
    target.write(_head(0, 0, _END, 0))


def _head(number: int, mode: int, name: str, size_bytes: int) -> bytes:
    links = 1
    fields = [number, mode, 0, 0, links, 0, size_bytes, 0, 0, 0, 0, len(name) + 1, 0]
    head = _MAGIC + b"".join(b"%08X" % field for field in fields) + name.encode("ascii") + b"\0"
    return head + bytes(-len(head) % _ALIGN)
