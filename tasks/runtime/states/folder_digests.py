"""Digests of what is in a folder, without MuJoCo."""

import hashlib
import os
from collections.abc import Iterator
from pathlib import Path

_IGNORED_FOLDER = "__pycache__"
_PREVIEW_FILE = "preview.png"


def digest_of_folder(folder: Path, suffix: str = "") -> str:
    """SHA-256 over the names and bytes of a folder's files, also behind links; previews and byte code are left out.

    Args:
        folder: The folder.
        suffix: What the names of the files have to end with.
    """
    digest = hashlib.sha256()
    files = {path.relative_to(folder).as_posix(): path for path in _files_in(folder) if path.name.endswith(suffix)}
    for name in sorted(files):
        if name != _PREVIEW_FILE:
            with files[name].open("rb") as file:
                content = hashlib.file_digest(file, "sha256").digest()
            digest.update(f"{name}\0".encode() + content)
    return digest.hexdigest()


def _files_in(folder: Path) -> Iterator[Path]:
    """Yields all files below a folder; links to folders are followed, each real folder once on a way down."""
    ways = {str(folder): frozenset({os.path.realpath(folder)})}
    for place, folders, files in os.walk(folder, followlinks=True):
        above = ways.pop(place)
        if _IGNORED_FOLDER in folders:
            folders.remove(_IGNORED_FOLDER)
        for name in list(folders):
            real = os.path.realpath(os.path.join(place, name))  # noqa: PTH118 - half the time of `Path`
            if real in above:  # a link to a folder that it lies in
                folders.remove(name)
            else:
                ways[os.path.join(place, name)] = above | {real}  # noqa: PTH118
        yield from (path for name in files if (path := Path(place, name)).is_file())
