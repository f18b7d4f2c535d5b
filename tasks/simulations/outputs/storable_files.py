"""Which of a run's own outputs can be stored; the rest is left out by name, and takes nothing with it."""

import os
from dataclasses import dataclass, field
from pathlib import Path

from ....schemas.wire.common import shorten
from ....schemas.wire.errors import StorageError
from ...storage import MANIFEST_NAME
from ...storage.folders import FolderFile, files_told
from ...storage.naming import check_key, join_key


@dataclass(frozen=True)
class StorableFiles:
    """What of a folder can be stored."""

    files: list[FolderFile]
    notes: list[str] = field(default_factory=list[str])
    """A line for everything else: what it is, and why it is left out."""


def storable_files(folder: Path, prefix: str) -> StorableFiles:
    """Looks through what a run wrote; none of its processes is there any more.

    Left out are links, pipes, sockets and devices, what this process may not read, what no store could have under its
    name, and a `manifest.json`, which would say what is whole.

    Args:
        folder: where the run wrote.
        prefix: of the keys that the files get.

    Raises:
        StorageError: there is no such folder.
    """
    notes: list[str] = []

    def leave_out(path: Path, why: str) -> None:
        notes.append(f"{shorten(ascii(os.fspath(path.relative_to(folder))), 300)} is not stored: it {why}")

    files: list[FolderFile] = []
    for file in files_told(folder, leave_out):
        if (why := _obstacle(file, prefix)) is None:
            files.append(file)
        else:
            leave_out(file.path, why)
    return StorableFiles(files, notes)


def _obstacle(file: FolderFile, prefix: str) -> str | None:
    if file.name == MANIFEST_NAME:
        return "has the name of the manifest"
    try:
        check_key(join_key(prefix, file.name))
    except StorageError as error:
        return f"has a name that no store takes: {error}"
    return None if os.access(file.path, os.R_OK) else "may not be read"
