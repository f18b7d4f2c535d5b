"""Temporary folders for the warm-up of processes: locked while in use, deleted after a process was killed."""

import fcntl
import os
import shutil
import tempfile
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

_PREFIX = "robomaker-rehearsal-"
_NEW_S = 60.0
"""Age in seconds below which an unlocked folder is left alone: its process may not have locked it yet."""


def make_locked_folder() -> tuple[Path, int]:
    """Creates a locked temporary folder for the warm-up of a process.

    Returns:
        Path of the folder, and the file descriptor of the lock.
    """
    folder = Path(tempfile.mkdtemp(prefix=_PREFIX))
    lock = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    return folder, lock


def remove_abandoned_folders() -> list[Path]:
    """Deletes this user's warm-up folders whose process was killed.

    Returns:
        The deleted folders.
    """
    found: list[Path] = []
    for left in abandoned_folders():
        shutil.rmtree(left, ignore_errors=True)
        if not left.exists():
            found.append(left)
    return found


def abandoned_folders() -> Iterator[Path]:
    """Yields each warm-up folder of this user whose process was killed, while holding its lock; skips those in use."""
    for left in sorted(Path(tempfile.gettempdir()).glob(f"{_PREFIX}*")):
        with suppress(OSError):  # it is in use, another user's, or has just been removed
            about = left.lstat()
            if about.st_uid != os.getuid() or left.is_symlink() or time.time() - about.st_mtime < _NEW_S:
                continue
            lock = os.open(left, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW | os.O_CLOEXEC)
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                yield left
            finally:
                os.close(lock)
