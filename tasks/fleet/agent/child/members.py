"""Members of .tar, .tar.gz and .zip archives; every kind that is neither file nor folder is refused."""

from __future__ import annotations

import gzip
import io
import stat
import struct
import tarfile
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any, Callable, cast

from ..errors import StepFailed

BROKEN = (
    tarfile.TarError,
    zipfile.BadZipFile,
    gzip.BadGzipFile,
    zlib.error,
    struct.error,
    EOFError,
    NotImplementedError,
    OverflowError,
    RuntimeError,
    ValueError,
)
"""Exceptions that the standard library raises for damaged archives."""

_LARGEST_READ_BYTES = 1 << 20


@dataclass(frozen=True)
class Member:
    """A file or folder of an archive."""

    name: str
    is_folder: bool
    is_executable: bool
    open: Callable[[], AbstractContextManager[IO[bytes]]]
    """Opens the member's content, which has to be read before the next member is taken."""


def bad_archive(text: str) -> StepFailed:
    """The refusal of an archive."""
    return StepFailed("ExtractingBundleFailure", text)


def members(archive: Path) -> Iterator[Member]:
    """Reads an archive's members; what kind it is is told by its content.

    Raises:
        StepFailed: it is no archive, or has a member that is neither file nor folder.
    """
    with archive.open("rb") as file:
        beginning = file.read(262)
        file.seek(0)
        if beginning.startswith((b"PK\x03\x04", b"PK\x05\x06")):
            yield from _of_zip(file)
        elif beginning.startswith(b"\x1f\x8b"):
            with gzip.GzipFile(fileobj=file) as unzipped:
                yield from _of_tar(cast("IO[bytes]", unzipped))
        elif beginning[257:] == b"ustar":
            yield from _of_tar(file)
        else:
            raise bad_archive("the bundle is no .tar, .tar.gz or .zip archive")


def _of_zip(file: IO[bytes]) -> Iterator[Member]:
    with zipfile.ZipFile(file) as container:
        for info in container.infolist():
            mode = info.external_attr >> 16
            if stat.S_IFMT(mode) not in (0, stat.S_IFREG, stat.S_IFDIR) or "\0" in info.orig_filename:
                raise bad_archive(f"member {info.filename!r} is neither file nor folder")
            if info.flag_bits & 1:
                raise bad_archive(f"member {info.filename!r} is encrypted")
            is_executable = bool(mode & stat.S_IXUSR)
            yield Member(info.filename, info.is_dir(), is_executable, lambda info=info: container.open(info))


def _of_tar(file: IO[bytes]) -> Iterator[Member]:
    forward = _Forward(file)
    with tarfile.open(fileobj=forward, mode="r:") as container:  # type: ignore[arg-type]
        for info in container:
            if not (info.isreg() or info.isdir()) or info.issparse():
                raise bad_archive(f"member {info.name!r} is neither file nor folder")
            yield Member(
                info.name, info.isdir(), bool(info.mode & stat.S_IXUSR), lambda info=info: _open(container, info)
            )
    if len(forward.latest) < tarfile.BLOCKSIZE or any(forward.latest):
        raise bad_archive("the archive is cut off, or a header of it is broken")
    if len(file.read(_LARGEST_READ_BYTES + 1)) > _LARGEST_READ_BYTES:  # reading on makes gzip compare its checksum
        raise bad_archive("the archive goes on behind its end")


def _open(container: tarfile.TarFile, info: tarfile.TarInfo) -> IO[bytes]:
    content = container.extractfile(info)
    if content is None:
        raise bad_archive(f"member {info.name!r} has no content")
    return content


class _Forward(io.RawIOBase):
    """A file that only moves forward, and has no large headers: crafted ones ask for gigabytes or lead in circles."""

    def __init__(self, file: IO[bytes]) -> None:
        self._file: Any = file
        self._position = 0
        self.latest = b""
        """The block that was read last; at the end of the archive, the end mark."""

    def read(self, size: int = -1) -> bytes:
        if not 0 <= size <= _LARGEST_READ_BYTES:
            raise bad_archive(f"the archive is damaged: a header of {size} bytes")
        self.latest = self._file.read(size)
        self._position += len(self.latest)
        return self.latest

    def seek(self, offset: int, whence: int = io.SEEK_SET) -> int:
        if whence != io.SEEK_SET or offset < self._position:
            raise bad_archive("the archive is damaged: a member before the end of another")
        self._position = self._file.seek(offset)
        return self._position

    def tell(self) -> int:
        return self._position
