"""A run's own outputs that can be stored; any other is left out by name and does not fail the rest."""

import heapq
import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from ....schemas.wire.errors import StorageError
from ...storage import MANIFEST_NAME
from ...storage.failures import os_failures
from ...storage.folders import FolderFile, files_told
from ...storage.naming import check_key, join_key
from .bounds import LeftOut, Room, rank

_ALL_BYTES = 1 << 62
_MOST_FILES = 1_000_000
"""More than any limit that can be set allows."""


@dataclass(frozen=True)
class StorableFiles:
    """Files of a folder that can be stored, and those that are left out."""

    files: list[FolderFile]
    left_out: LeftOut
    """Everything else: what it is, and why it is left out."""

    @property
    def notes(self) -> list[str]:
        """A line for everything that is left out, as far as it is named."""
        return self.left_out.lines


def storable_files(folder: Path, prefix: str, room: Room | None = None) -> StorableFiles:
    """Looks through what a run wrote; none of its processes is there any more.

    Left out are links, pipes, sockets and devices, what this process may not read, what no store could have under its
    name, a `manifest.json`, which would say what is whole, and what has no room. However many files there are, only as
    many as there is room for are kept in memory.

    Args:
        folder: where the run wrote.
        prefix: of the keys that the files get.
        room: what may be stored; it is taken. Absent: everything.

    Raises:
        StorageError: there is no such folder.
    """
    room = room or Room(_ALL_BYTES, _MOST_FILES)
    looked = _Looked(folder, prefix, room.left_out)
    with os_failures(f"read the folder {folder}"):
        best = heapq.nsmallest(max(0, room.most_files - room.used_files) + 1, looked.files(), key=_rank)
    files = [file for file, size in best if room.take(file.name, size)]
    more = looked.count - len(best)  # than there is room for; one of them has been named
    room.left_out.count(more, looked.size_bytes - sum(size for _, size in best))
    room.left_out.beyond_limits += more
    return StorableFiles(sorted(files, key=lambda file: os.fsencode(file.name)), room.left_out)


def _rank(found: tuple[FolderFile, int]) -> tuple[int, int, bytes]:
    return rank(found[0].name)


class _Looked:
    """Counts the files of a folder that could be stored, while they are looked at."""

    def __init__(self, folder: Path, prefix: str, left_out: LeftOut) -> None:
        self._folder = folder
        self._prefix = prefix
        self._left_out = left_out
        self.count = 0
        self.size_bytes = 0

    def files(self) -> Iterator[tuple[FolderFile, int]]:
        """Yields them with their sizes; notes everything else as left out."""
        for file in files_told(self._folder, self._leave_out):
            if (why := _obstacle(file, self._prefix)) is not None:
                self._leave_out(file.path, why)
                continue
            size = file.path.lstat().st_size
            self.count += 1
            self.size_bytes += size
            yield file, size

    def _leave_out(self, path: Path, why: str) -> None:
        self._left_out.note(os.fspath(path.relative_to(self._folder)), why)


def _obstacle(file: FolderFile, prefix: str) -> str | None:
    if file.name == MANIFEST_NAME:
        return "has the name of the manifest"
    try:
        check_key(join_key(prefix, file.name))
    except StorageError as error:
        return f"has a name that no store takes: {error}"
    return None if os.access(file.path, os.R_OK) else "may not be read"
