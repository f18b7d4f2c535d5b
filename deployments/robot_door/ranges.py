"""The part of a file that a request asks for: `Range` and `If-Range` (RFC 9110), one range at most."""

import re
from dataclasses import dataclass

from .answers import DoorRefusal

_RANGE = re.compile(rb"bytes=(\d{0,18})-(\d{0,18})")


@dataclass(frozen=True)
class Part:
    """Bytes of a file, from `start` to before `stop`."""

    start: int
    stop: int
    is_whole: bool
    """Nothing was asked for but the file: the answer is 200 and not 206."""


def part_of(size_bytes: int, etag: bytes, range_: bytes | None, if_range: bytes | None) -> Part:
    """Selects the part of a file that a request asks for.

    Several ranges, other units, and what cannot be read count as asking for the whole file.

    Args:
        size_bytes: length of the file.
        etag: the file's, with its quotes.
        range_: the header `Range`.
        if_range: the header `If-Range`: another file than that has to be read from its beginning.

    Raises:
        DoorRefusal: the file has no such part (416).
    """
    whole = Part(0, size_bytes, True)
    found = _RANGE.fullmatch((range_ or b"").strip())
    if found is None or found.groups() == (b"", b"") or (if_range is not None and if_range.strip() != etag):
        return whole
    first, last = found.groups()
    if first:
        start, stop = int(first), int(last) + 1 if last else size_bytes
        if last and stop <= start:
            return whole
    else:
        start, stop = max(0, size_bytes - int(last)), size_bytes
    if start >= size_bytes:
        raise DoorRefusal(416, f"the file has {size_bytes} bytes", [(b"content-range", b"bytes */%d" % size_bytes)])
    return Part(start, min(stop, size_bytes), False)
