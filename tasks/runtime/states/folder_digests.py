"""Digests of what is in a folder, without MuJoCo."""

import hashlib
from pathlib import Path

_IGNORED_FOLDER = "__pycache__"
_PREVIEW_FILE = "preview.png"


def digest_of_folder(folder: Path, suffix: str = "") -> str:
    """SHA-256 over the names and bytes of a folder's files; previews and byte code are left out.

    Args:
        folder: The folder.
        suffix: What the names of the files have to end with.
    """
    digest = hashlib.sha256()
    files = {path.relative_to(folder).as_posix(): path for path in folder.rglob(f"*{suffix}") if path.is_file()}
    for name in sorted(files):
        if name != _PREVIEW_FILE and _IGNORED_FOLDER not in name.split("/"):
            with files[name].open("rb") as file:
                content = hashlib.file_digest(file, "sha256").digest()
            digest.update(f"{name}\0".encode() + content)
    return digest.hexdigest()
