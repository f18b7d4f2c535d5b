"""Unpacks untrusted archives into a new folder, member by member.

`tarfile`'s own filters are not relied on: several releases of Python have known ways around them. Members are written
one by one into a new folder in which no symbolic link exists; links of a system's tree are created last.
"""

from __future__ import annotations

import errno
import os
import unicodedata
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO

from .archive_members import BROKEN_ARCHIVE, ArchiveError, Member, members

_CHUNK_BYTES = 1 << 20
_MAX_COMPONENT_BYTES = 255


@dataclass(frozen=True)
class ArchiveLimits:
    """Limits of an archive's content; the bytes unpacked count, not the sizes in its headers."""

    total_bytes: int = 20 << 30
    """Limit of the unpacked bytes of all files of an archive together."""
    file_bytes: int = 10 << 30
    """Limit of the unpacked bytes of each file of an archive."""
    entries: int = 100_000
    """Limit of the number of files and folders in an archive."""
    depth: int = 32
    """Limit of the number of components of a path in an archive."""
    ratio: int = 200
    """Limit of the ratio of unpacked to archived bytes; it applies above `unsuspicious_bytes`."""
    unsuspicious_bytes: int = 256 << 20
    """Unpacked bytes that every archive may have, however small it is."""
    is_system_tree: bool = False
    """Whether the archive has part of an operating system.

    Names may differ only in case, and links that stay inside are kept.
    """


SYSTEM_TREE = ArchiveLimits(entries=1_000_000, depth=64, is_system_tree=True)
"""Limits of an overlay of a colcon bundle, which has an operating system's files."""


def extract(archive: Path, top: Path, limits: ArchiveLimits) -> None:
    """Unpacks an archive into an empty folder.

    Raises:
        ArchiveError: The file is not an archive, is damaged or too large, or has a member that is neither file nor
            folder or would land elsewhere; what was written stays.
        OSError: The disk is full, or the folder cannot be written.
    """
    extraction = _Extraction(top, limits, archive.stat().st_size)
    try:
        for member in members(archive, links=limits.is_system_tree):
            extraction.add(member)
        extraction.make_links()
    except BROKEN_ARCHIVE as error:
        said = str(error) or type(error).__name__
        raise ArchiveError(f"the archive is damaged{extraction.progress()}: {said}") from error
    except OSError as error:
        if error.errno != errno.EINVAL:
            raise
        # A damaged zip sends its reader to a place before the file's beginning.
        raise ArchiveError(f"the archive is damaged{extraction.progress()}: {error}") from error


@dataclass
class _Extraction:
    """State of an unpacking: members unpacked so far, and the names in use."""

    top: Path
    limits: ArchiveLimits
    archive_bytes: int
    entries: int = 0
    size: int = 0
    last: str = ""
    links: dict[str, Member] = field(default_factory=dict)
    """Links by path; they are created last, so that nothing is written through a link."""
    taken: dict[str, tuple[str, bool]] = field(default_factory=dict)
    """Path, and whether it is a folder, by normalised path.

    Case and Unicode composition are removed, as some file systems ignore them.
    """

    def progress(self) -> str:
        return f" after member {self.last!r}" if self.last else ""

    def add(self, member: Member) -> None:
        """Writes one member.

        Raises:
            ArchiveError: The member is not allowed, such as for its path, its size or its place in the limits.
        """
        self.entries += 1
        if self.entries > self.limits.entries:
            raise ArchiveError(f"member {member.name!r}: more than {self.limits.entries} files and folders")
        parts = self._parts(member)
        for end in range(1, len(parts)):
            self._take(member, "/".join(parts[:end]), is_folder=True)
        if parts:
            name = "/".join(parts)
            self._take(member, name, is_folder=member.is_folder)
            if member.symbolic_link is not None or member.hard_link is not None:
                self.links[name] = member
            elif not member.is_folder:
                self._write(member, self.top / name)
        self.last = member.name

    def make_links(self) -> None:
        """Creates the links of an archive; those that are absolute or would lead out of the top folder are left out.

        Raises ArchiveError if a hard link names no file of the archive.
        """
        made: list[Path] = []
        for name, member in self.links.items():
            if member.hard_link is not None:
                source = member.hard_link.removeprefix("./")
                if source not in self.taken or not (self.top / source).is_file():
                    raise ArchiveError(
                        f"member {member.name!r}: a hard link to {member.hard_link!r}, no file before it"
                    )
                os.link(self.top / source, self.top / name)
        for name, member in self.links.items():
            if member.symbolic_link and not member.symbolic_link.startswith("/") and "\0" not in member.symbolic_link:
                (self.top / name).symlink_to(member.symbolic_link)
                made.append(self.top / name)
        # Only when all are there is it seen where each leads; removing one takes no other one elsewhere.
        top = self.top.resolve()
        for path in made:
            if not Path(os.path.realpath(path)).is_relative_to(top):
                path.unlink()

    def _parts(self, member: Member) -> list[str]:
        """Returns the components of a member's path below the top folder; empty for the top folder itself.

        Raises ArchiveError if the path is not safe, such as an absolute one, or too deep or long.
        """
        path = member.name
        while path.startswith("./"):
            path = path[2:]
        if member.is_folder:
            path = path.rstrip("/") if path != "." else ""
        parts = path.split("/") if path else []
        if problem := self._problem(path, parts, member):
            raise ArchiveError(f"member {member.name!r}: {problem}")
        return parts

    def _problem(self, path: str, parts: list[str], member: Member) -> str:
        """Describes what is wrong with a member's path in an archive, `an absolute path`; empty if nothing is."""
        if member.name.startswith("/"):
            return "an absolute path"
        if "\\" in path or "\0" in path:
            return "a backslash or NUL in its name"
        if any(part in ("", ".", "..") for part in parts) or not (parts or member.is_folder):
            return "a path with an empty, '.' or '..' component"
        if len(parts) > self.limits.depth:
            return f"a path of more than {self.limits.depth} components"
        try:
            too_long = any(len(part.encode()) > _MAX_COMPONENT_BYTES for part in parts)
        except UnicodeEncodeError:
            return "a name that is not UTF-8"
        return f"a component of more than {_MAX_COMPONENT_BYTES} bytes" if too_long else ""

    def _take(self, member: Member, name: str, *, is_folder: bool) -> None:
        """Reserves a path in the target folder, and makes it if it is a folder; only folders may be named again.

        Raises ArchiveError if the path was taken by a file, or differs from another one only in case.
        """
        folded = name if self.limits.is_system_tree else unicodedata.normalize("NFC", name).casefold()
        other, other_is_folder = self.taken.setdefault(folded, (name, is_folder))
        if other != name:
            raise ArchiveError(f"member {member.name!r}: differs from {other!r} only in case or composition of letters")
        if other_is_folder != is_folder:
            raise ArchiveError(f"member {member.name!r}: {name!r} is both a file and a folder")
        path = self.top / name
        if is_folder:
            path.mkdir(mode=0o755, exist_ok=True)
        elif path.exists() or name in self.links:
            raise ArchiveError(f"member {member.name!r}: it is in the archive more than once")

    def _write(self, member: Member, path: Path) -> None:
        mode = 0o755 if member.executable else 0o644
        descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC, mode)
        with os.fdopen(descriptor, "wb") as target, member.open() as content:
            os.fchmod(descriptor, mode)  # whatever the umask is: programs may have a user of their own
            self._copy(member, content, target)

    def _copy(self, member: Member, content: IO[bytes], target: IO[bytes]) -> None:
        size = 0
        while chunk := content.read(_CHUNK_BYTES):
            size += len(chunk)
            self.size += len(chunk)
            if size > self.limits.file_bytes:
                raise ArchiveError(f"member {member.name!r}: more than {self.limits.file_bytes} bytes")
            if self.size > self.limits.total_bytes:
                raise ArchiveError(
                    f"member {member.name!r}: with it the archive has more than {self.limits.total_bytes} bytes"
                )
            if self.size > max(self.limits.unsuspicious_bytes, self.limits.ratio * self.archive_bytes):
                raise ArchiveError(
                    f"member {member.name!r}: with it the archive has more than {self.limits.ratio} times its own size"
                )
            target.write(chunk)
