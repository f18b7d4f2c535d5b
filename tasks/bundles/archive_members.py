"""Reads the members of .tar, .tar.gz and .zip archives; refuses anything but files, folders and, if wanted, links.

The container is recognised by its content, not its name. Nothing is written here; the caller decides whether a member's
name and size are acceptable.
"""

from __future__ import annotations

import gzip
import io
import stat
import struct
import tarfile
import zipfile
import zlib
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any, cast

try:
    from lzma import LZMAError  # type: ignore[assignment]
except ImportError:  # a Python that was built without it

    class LZMAError(Exception):
        """Is never raised."""


class ArchiveError(Exception):
    """Raised for an archive that is not unpacked; the text names the member."""


BROKEN_ARCHIVE = (
    tarfile.TarError,
    zipfile.BadZipFile,
    gzip.BadGzipFile,
    zlib.error,
    LZMAError,
    struct.error,
    EOFError,
    NotImplementedError,
    OverflowError,
    RuntimeError,  # what zipfile says of a compression that this Python lacks
    ValueError,
)
"""Exceptions that the standard library raises for damaged archives."""

_LARGEST_HEADER_BYTES = 1 << 20
_LONGEST_PADDING_BYTES = 1 << 20
_ENCRYPTED = 0x1
_UNIX = 3


@dataclass(frozen=True)
class Member:
    """A file or folder in a tar or zip archive."""

    name: str
    """Name of the member, as in the archive."""
    is_folder: bool
    executable: bool
    open: Callable[[], AbstractContextManager[IO[bytes]]]
    """Function that opens the content; it must be read before the next member is requested."""
    symbolic_link: str | None = None
    """Target of a symbolic link; `None`: the member is not one."""
    hard_link: str | None = None
    """Name of the member whose content a hard link has; `None`: the member is not one."""


def members(archive: Path, *, links: bool = False) -> Iterator[Member]:
    """Yields the members of a tar or zip archive, in order.

    Args:
        archive: The archive.
        links: Whether a tar archive may have links, too.

    Raises:
        ArchiveError: The file is not an archive, or has a member that is neither file, folder nor link.
        OSError: The archive cannot be read.
    """
    with archive.open("rb") as file:
        beginning = file.read(262)
        file.seek(0)
        if beginning.startswith((b"PK\x03\x04", b"PK\x05\x06")):
            yield from _zip_members(file)
        elif beginning.startswith(b"\x1f\x8b"):
            with gzip.GzipFile(fileobj=file) as unzipped:
                yield from _tar_members(cast("IO[bytes]", unzipped), links)
        elif beginning[257:] == b"ustar":
            yield from _tar_members(file, links)
        else:
            raise ArchiveError("this is no .tar, .tar.gz or .zip archive")


def _zip_members(file: IO[bytes]) -> Iterator[Member]:
    with zipfile.ZipFile(file) as container:
        for info in container.infolist():
            mode = info.external_attr >> 16 if info.create_system == _UNIX else 0
            if "\0" in info.orig_filename:
                raise ArchiveError(f"member {info.orig_filename!r}: NUL in its name")
            if stat.S_IFMT(mode) not in (0, stat.S_IFREG, stat.S_IFDIR):
                raise ArchiveError(
                    f"member {info.filename!r}: {_kind(mode)} is not allowed, only files and folders are"
                )
            if info.flag_bits & _ENCRYPTED:
                raise ArchiveError(f"member {info.filename!r}: encrypted members cannot be read")
            yield Member(
                name=info.filename,
                is_folder=info.is_dir(),
                executable=bool(mode & stat.S_IXUSR),
                open=lambda info=info: container.open(info),
            )


def _kind(mode: int) -> str:
    return "a symbolic link" if stat.S_ISLNK(mode) else "a device, pipe or socket"


def _tar_members(file: Any, links: bool) -> Iterator[Member]:
    forward = _Forward(file)
    with tarfile.open(fileobj=cast("IO[bytes]", forward), mode="r:") as container:
        for info in container:
            is_link = links and (info.issym() or info.islnk())
            if not (info.isreg() or info.isdir() or is_link) or info.issparse():
                raise ArchiveError(
                    f"member {info.name!r}: {_tar_kind(info)} is not allowed, only files and folders are"
                )
            yield Member(
                name=info.name,
                is_folder=info.isdir(),
                executable=bool(info.mode & stat.S_IXUSR),
                open=lambda info=info: _content(container, info),
                symbolic_link=info.linkname if info.issym() else None,
                hard_link=info.linkname if info.islnk() else None,
            )
    forward.check_end()


def _tar_kind(info: tarfile.TarInfo) -> str:
    if info.issym():
        return "a symbolic link"
    if info.islnk():
        return "a hard link"
    return "a sparse file" if info.issparse() else "a device, pipe or unknown kind"


def _content(container: tarfile.TarFile, info: tarfile.TarInfo) -> IO[bytes]:
    content = container.extractfile(info)
    if content is None:
        raise ArchiveError(f"member {info.name!r} has no content")
    return content


class _Forward(io.RawIOBase):
    """File wrapper that protects tarfile from crafted archives: it only moves forward, and limits the size of headers.

    Crafted archives state negative sizes, which send tarfile back to an earlier position, for ever; and headers of
    gigabytes, which it reads into memory at once. And where a header is damaged or missing, tarfile takes it for the
    end.
    """

    def __init__(self, file: Any) -> None:
        self._file = file
        self._position = 0
        self._latest = b""

    def read(self, size: int = -1) -> bytes:
        if not 0 <= size <= _LARGEST_HEADER_BYTES:
            raise ArchiveError(f"the archive is damaged: a header of {size} bytes")
        self._latest = self._file.read(size)
        self._position += len(self._latest)
        return self._latest

    def seek(self, offset: int, whence: int = io.SEEK_SET) -> int:
        if whence != io.SEEK_SET or offset < self._position:
            raise ArchiveError("the archive is damaged: a member before its predecessor's end")
        self._position = self._file.seek(offset)
        return self._position

    def tell(self) -> int:
        return self._position

    def check_end(self) -> None:
        """Checks that the archive is not truncated.

        Raises:
            ArchiveError: The archive is damaged, truncated or continues after its end mark.
        """
        if len(self._latest) < tarfile.BLOCKSIZE or any(self._latest):
            raise ArchiveError("the archive is damaged: a header is broken or missing, or the archive is cut off")
        # Reading on makes gzip compare its checksum; behind the end mark there is at most padding.
        if len(self._file.read(_LONGEST_PADDING_BYTES + 1)) > _LONGEST_PADDING_BYTES:
            raise ArchiveError("the archive is damaged: it goes on behind its end mark")
