"""Unpacks a bundle into the folder of its version, which appears when all of it is on the disk."""

from __future__ import annotations

import os
import shutil
import unicodedata
from dataclasses import dataclass
from pathlib import Path

from ..errors import disk_failure
from ..journal import sync_folder
from .members import BROKEN, Member, bad_archive, members

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
