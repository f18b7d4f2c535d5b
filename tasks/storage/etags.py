"""ETags of files: their MD5, as S3 has it, kept with the file so that large files are read only once.

The MD5 is kept in an extended attribute together with the size, modification time and inode it
belongs to. Where any of them has changed, or where the file system keeps no such attributes, it is
computed again (and remembered in this process). Everything works on descriptors: the answer belongs
to the very file that was opened, also when another one takes its name.
"""

import hashlib
import os
from contextlib import suppress

_ATTRIBUTE = "user.robomaker.etag"
_CHUNK_BYTES = 1 << 20
_REMEMBERED = 16_384

_computed: dict[tuple[int, str], str] = {}


def store_etag(descriptor: int, etag: str) -> None:
    """Keeps a file's ETag with the file, where the file system can.

    Args:
        descriptor: the file, open, after its last write.
        etag: hexadecimal MD5 of its content.
    """
    # Not every file system and platform has user attributes; then it is computed when asked for.
    with suppress(OSError, AttributeError):
        os.setxattr(descriptor, _ATTRIBUTE, f"{_version(descriptor)} {etag}".encode())


def etag_of(descriptor: int) -> str:
    """The ETag of an open file; its read position stays where it is.

    Raises:
        OSError: it cannot be read.
    """
    version = _version(descriptor)
    with suppress(OSError, AttributeError):
        kept_version, _, etag = os.getxattr(descriptor, _ATTRIBUTE).decode(errors="replace").rpartition(" ")
        if kept_version == version:
            return etag
    key = (os.fstat(descriptor).st_dev, version)
    if key not in _computed:
        if len(_computed) >= _REMEMBERED:
            _computed.clear()
        _computed[key] = _md5(descriptor)
        store_etag(descriptor, _computed[key])
    return _computed[key]


def _md5(descriptor: int) -> str:
    digest = hashlib.md5(usedforsecurity=False)
    offset = 0
    while chunk := os.pread(descriptor, _CHUNK_BYTES, offset):
        digest.update(chunk)
        offset += len(chunk)
    return digest.hexdigest()


def _version(descriptor: int) -> str:
    found = os.fstat(descriptor)
    return f"{found.st_size} {found.st_mtime_ns} {found.st_ino}"
