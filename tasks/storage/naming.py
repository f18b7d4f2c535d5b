"""Names of buckets and objects: one rule for every store, so that data can move between stores.

Keys are S3's, less what some store cannot hold: a key is a relative path whose components are
neither empty nor `.` nor `..`, at most 255 bytes each and 1024 bytes in all. Every character is
allowed but NUL, lone surrogates, and the backslash: some S3 servers take it for a slash.
"""

import re

from ...schemas.wire.errors import StorageError

_BUCKET = re.compile(r"[a-z0-9][a-z0-9.\-]{1,61}[a-z0-9]")
_ADDRESS = re.compile(r"[0-9]+(\.[0-9]+){3}")
_MAX_KEY_BYTES = 1024
_MAX_COMPONENT_BYTES = 255


def check_bucket(bucket: str) -> None:
    """Refuses what S3 does not take as a bucket's name.

    Raises:
        StorageError: with the rule it breaks.
    """
    if not _BUCKET.fullmatch(bucket) or ".." in bucket or _ADDRESS.fullmatch(bucket):
        raise StorageError(
            f"bucket {bucket!r}: a name has 3 to 63 of a-z, 0-9, '.' and '-', starts and ends with a letter or digit, "
            "has no '..' and is no IP address"
        )


def check_key(key: str) -> None:
    """Refuses keys that not every store can hold.

    Raises:
        StorageError: with the component and what is wrong with it.
    """
    encoded = _encoded(key)
    if not encoded:
        raise StorageError("the key is empty; an object needs a name")
    if len(encoded) > _MAX_KEY_BYTES:
        raise StorageError(f"key {key[:60]!r}…: {len(encoded)} bytes; at most {_MAX_KEY_BYTES} are allowed")
    for part in encoded.split(b"/"):
        _check_component(key, part)


def check_prefix(prefix: str) -> None:
    """Refuses prefixes that no valid key starts with; the empty one and those that end with `/` are fine.

    Raises:
        StorageError: with the component and what is wrong with it.
    """
    *folders, last = _encoded(prefix).split(b"/")
    for part in folders:
        _check_component(prefix, part)
    if last not in (b"", b".", b".."):  # these can begin a component
        _check_component(prefix, last)


def join_key(prefix: str, *parts: str) -> str:
    """Puts a key together; an empty prefix adds nothing, slashes at the prefix's ends do not double."""
    return "/".join([stripped, *parts]) if (stripped := prefix.strip("/")) else "/".join(parts)


def _encoded(key: str) -> bytes:
    try:
        return key.encode()
    except UnicodeEncodeError:
        raise StorageError(f"key {key!r} cannot be written as UTF-8") from None


def _check_component(key: str, part: bytes) -> None:
    if part in (b"", b".", b".."):
        raise StorageError(f"key {key!r}: the component {part.decode()!r} is not allowed")
    if b"\0" in part or b"\\" in part:
        raise StorageError(f"key {key!r}: NUL and backslash are not allowed")
    if len(part) > _MAX_COMPONENT_BYTES:
        raise StorageError(
            f"key {key[:60]!r}…: a component has {len(part)} bytes; at most {_MAX_COMPONENT_BYTES} are allowed"
        )
