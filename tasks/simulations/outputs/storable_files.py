"""A run's own outputs that can be stored; any other is left out by name and does not fail the rest."""

import heapq
import os
from collections.abc import Iterator
from pathlib import Path

from ....schemas.wire.errors import StorageError
from ...storage import MANIFEST_NAME
from ...storage.base import Stopped, never
from ...storage.failures import os_failures
from ...storage.folders import FolderFile, files_told
from ...storage.naming import check_key, join_key
from .bounds import Room, check_wanted, rank


def storable_files(folder: Path, prefix: str, room: Room, ended: Stopped = never) -> list[FolderFile]:
    """Looks through what a run wrote; none of its processes is there any more.

    Left out are links, pipes, sockets and devices, what this process may not read, what no store could have under its
    name, a `manifest.json`, which would say what is whole, and what has no room. However many files there are, only as
    many as there is room for are kept in memory.

    Args:
        folder: where the run wrote.
        prefix: of the keys that the files get.
        room: what may be stored; it is taken, and is told what is left out.
        ended: asked before each file whether to end that; quick.

    Raises:
        TransferStoppedError: `ended` said so.
        StorageError: there is no such folder.
    """
    count = size_bytes = 0

    def leave_out(path: Path, why: str) -> None:
        room.left_out.note(os.fspath(path.relative_to(folder)), why)

    def found() -> Iterator[tuple[FolderFile, int]]:
        nonlocal count, size_bytes
        for file in files_told(folder, leave_out):
            check_wanted(ended)
            if (why := _obstacle(file, prefix)) is not None:
                leave_out(file.path, why)
                continue
            size = file.path.lstat().st_size
            count, size_bytes = count + 1, size_bytes + size
            yield file, size

    with os_failures(f"read the folder {folder}"):
        most = max(0, room.most_files - room.used_files) + 1
        best = heapq.nsmallest(most, found(), key=lambda each: rank(each[0].name))
    files = [file for file, size in best if room.take(file.name, size)]
    more = count - len(best)  # than there is room for; one of them has been named
    room.left_out.count(more, size_bytes - sum(size for _, size in best))
    room.left_out.beyond_limits += more
    return sorted(files, key=lambda file: os.fsencode(file.name))


def _obstacle(file: FolderFile, prefix: str) -> str | None:
    if file.name == MANIFEST_NAME:
        return "has the name of the manifest"
    try:
        check_key(join_key(prefix, file.name))
    except StorageError as error:
        return f"has a name that no store takes: {error}"
    return None if os.access(file.path, os.R_OK) else "may not be read"
