"""Files that appear whole or not at all: each is written under another name beside its place, and renamed.

Readers find the earlier file or the new one. Two writers have a name each, so that none renames the half of another's.
"""

import os
from collections.abc import Generator
from contextlib import contextmanager, suppress
from pathlib import Path
from uuid import uuid4


@contextmanager
def replaced(path: Path) -> Generator[Path]:
    """Yields the path of a new file, which takes the place of `path` if the `with` block ends without an error.

    Args:
        path: Final path of the file; its folder exists.

    Raises:
        OSError: The file cannot be renamed; an earlier one is still there, and the new one is deleted.
    """
    part = path.with_name(f".{uuid4().hex}.part")  # short, as the name itself may have all 255 bytes
    try:
        yield part
        part.replace(path)
    finally:
        with suppress(OSError):  # a folder that takes no file has said so
            part.unlink()


def write_whole(path: Path, content: str | bytes, mode: int = 0o666, *, is_synced: bool = False) -> Path:
    """Writes a file in the place of an earlier one, and returns its path.

    Args:
        path: Path of the file; its folder exists.
        content: All of it; text becomes UTF-8.
        mode: Permissions of the file, less those that the process's umask takes away.
        is_synced: Whether the content is on the disk before the file is renamed, so that a machine that loses its
            power has the earlier file or the new one.

    Raises:
        OSError: The file cannot be written; an earlier one is still there.
    """
    data = content.encode() if isinstance(content, str) else content
    with replaced(path) as part, os.fdopen(os.open(part, os.O_WRONLY | os.O_CREAT | os.O_EXCL, mode), "wb") as file:
        file.write(data)
        if is_synced:
            file.flush()
            os.fsync(file.fileno())
    return path
