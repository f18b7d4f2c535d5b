"""Unpacks a bundle into the folder of its version, which appears when all of it is on the disk."""

from __future__ import annotations

import gzip
import io
import os
import shutil
import stat
import struct
import tarfile
import unicodedata
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any, Callable, cast

from ..errors import StepFailed, disk_failure
from ..journal import sync_folder

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


_CHUNK_BYTES = 1 << 20


@dataclass(frozen=True)
class Limits:
    """Limits of a bundle's content, counted while it is unpacked."""

    total_bytes: int = 20 << 30
    entries: int = 100_000
    depth: int = 32
    ratio: int = 200
    """Largest ratio of unpacked bytes to the archive's; it applies above `unsuspicious_bytes`."""

    unsuspicious_bytes: int = 256 << 20


def unpack(archive: Path, folder: Path, limits: Limits | None = None) -> None:
    """Unpacks an archive, unless the folder is there.

    Args:
        archive: a .tar, .tar.gz or .zip.
        folder: where to; the folder beside it with a dot and `.part` is replaced.
        limits: what it may hold.

    Raises:
        StepFailed: it is damaged, or has a member that is neither file nor folder or would land elsewhere; or the
            disk is full. Nothing is left of it then.
    """
    if folder.exists():
        return
    part = folder.with_name(f".{folder.name}.part")
    try:
        shutil.rmtree(part, ignore_errors=True)
        part.mkdir(parents=True)
        try:
            _fill(part, archive, limits or Limits())
            _sync(part)
            part.rename(folder)
        except BaseException:
            shutil.rmtree(part, ignore_errors=True)
            raise
        sync_folder(folder.parent)
    except OSError as error:
        raise disk_failure(error, f"unpacking {folder.name}") from error


def _fill(part: Path, archive: Path, limits: Limits) -> None:
    extraction = _Extraction(part, limits, archive.stat().st_size)
    try:
        for member in members(archive):
            extraction.add(member)
    except BROKEN as error:
        raise bad_archive(f"the archive is damaged: {error or type(error).__name__}") from error


class _Extraction:
    """Members unpacked so far."""

    def __init__(self, top: Path, limits: Limits, archive_bytes: int) -> None:
        self._top = top
        self._limits = limits
        self._most_bytes = min(limits.total_bytes, max(limits.unsuspicious_bytes, limits.ratio * archive_bytes))
        self._entries = 0
        self._size = 0
        self._names: dict[str, str] = {}

    def add(self, member: Member) -> None:
        """Writes one member."""
        self._entries += 1
        if self._entries > self._limits.entries:
            raise bad_archive(f"more than {self._limits.entries} files and folders")
        parts = _parts(member, self._limits.depth)
        for end in range(1, len(parts) + member.is_folder):
            self._folder(member, "/".join(parts[:end]))
        if not member.is_folder:
            self._write(member, "/".join(parts))

    def _folder(self, member: Member, name: str) -> None:
        self._take(member, name)
        path = self._top / name
        if path.exists() and not path.is_dir():
            raise bad_archive(f"member {member.name!r}: {name!r} is both a file and a folder")
        path.mkdir(mode=0o755, exist_ok=True)

    def _take(self, member: Member, name: str) -> None:
        """Takes a name; file systems that ignore case would make one file of two."""
        other = self._names.setdefault(unicodedata.normalize("NFC", name).casefold(), name)
        if other != name:
            raise bad_archive(f"member {member.name!r} differs from {other!r} only in case or composition of letters")

    def _write(self, member: Member, name: str) -> None:
        self._take(member, name)
        path = self._top / name
        if path.exists():
            raise bad_archive(f"member {member.name!r} is in the archive more than once")
        mode = 0o755 if member.is_executable else 0o644
        descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC, mode)
        with os.fdopen(descriptor, "wb") as target, member.open() as content:
            os.fchmod(descriptor, mode)  # whatever the umask is: applications may have a user of their own
            while chunk := content.read(_CHUNK_BYTES):
                self._size += len(chunk)
                if self._size > self._most_bytes:
                    raise bad_archive(
                        f"member {member.name!r}: with it the bundle has more than {self._most_bytes} bytes"
                    )
                target.write(chunk)


def _parts(member: Member, depth: int) -> list[str]:
    name = member.name
    while name.startswith("./"):
        name = name[2:]
    if member.is_folder:
        name = "" if name == "." else name.rstrip("/")
    parts = name.split("/") if name else []
    is_bad = any(part in ("", ".", "..") or len(os.fsencode(part)) > 255 for part in parts)
    if is_bad or "\\" in name or "\0" in name or len(parts) > depth or not (parts or member.is_folder):
        raise bad_archive(f"member {member.name!r} would not land in the folder of its version")
    return parts


def _sync(top: Path) -> None:
    """Makes files, folders and their names survive a power loss."""
    for folder, _, files in os.walk(top):
        Path(folder).chmod(0o755)
        for name in files:
            descriptor = os.open(Path(folder, name), os.O_RDONLY)
            try:
                os.fsync(descriptor)
            finally:
                os.close(descriptor)
        sync_folder(Path(folder))
