"""Reads files in folders that others may have filled: links are not followed, errors become `StorageError`."""

import errno
import os
import stat
from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from io import BufferedReader
from pathlib import Path

from ...schemas.wire.errors import StorageAccessDeniedError, StorageError, StorageFullError, StorageUnavailableError

_FULL = {errno.ENOSPC, errno.EDQUOT}
# What a network file system says while its server is away; a connection that breaks or cannot be made.
_AWAY = {
    errno.EIO,
    errno.EREMOTEIO,
    errno.ESTALE,
    errno.ETIMEDOUT,
    errno.ENOTCONN,
    errno.ECONNREFUSED,
    errno.ECONNRESET,
    errno.ECONNABORTED,
    errno.EPIPE,
    errno.EHOSTDOWN,
    errno.EHOSTUNREACH,
    errno.ENETDOWN,
    errno.ENETUNREACH,
}
_DENIED = {errno.EACCES, errno.EPERM, errno.EROFS}


@contextmanager
def os_failures(doing: str) -> Generator[None]:
    """Converts every `OSError` inside the `with` block to the matching `StorageError`, which is raised.

    Args:
        doing: Description of the action, in words that follow "cannot".
    """
    try:
        yield
    except OSError as error:
        raise from_os_error(error, doing) from error


def from_os_error(error: OSError, doing: str) -> StorageError:
    """Returns the `StorageError` for an `OSError`, without raising it: disk full, folder away, access denied, other.

    Args:
        error: Error of the operating system.
        doing: Action that failed, such as `read a/b`, for the message.
    """
    why = error.strerror or str(error)
    where = f" ({error.filename})" if error.filename else ""
    kind = StorageError
    if error.errno in _FULL:
        kind = StorageFullError
    elif error.errno in _AWAY:
        kind = StorageUnavailableError
    elif error.errno in _DENIED:
        kind = StorageAccessDeniedError
    return kind(f"cannot {doing}: {why}{where}")


# Nothing there, a file where a folder should be, a symbolic link, a socket.
_NO_REGULAR_FILE = {errno.ENOENT, errno.ENOTDIR, errno.ELOOP, errno.ENXIO}


MAX_DEPTH = 100
"""Limit of nested folders, far above what keys of 1024 bytes are used for."""


@dataclass(frozen=True)
class FolderFile:
    """A regular file in a folder: relative name and path."""

    name: str
    """Path of a file below the folder, with `/` between components."""
    path: Path
    """Full path of a file in the folder."""


def regular_files(folder: Path) -> list[FolderFile]:
    """Lists all files below a folder by name; anything but regular files is an error.

    Raises:
        StorageError: The folder is none or cannot be read, or holds something that is neither a regular
            file nor a folder: a symbolic link could name any file of this machine.
    """

    def refuse(path: Path, why: str) -> None:
        raise StorageError(f"{str(path)[:200]} {why}")

    with os_failures(f"read the folder {folder}"):
        return sorted(files_told(folder, refuse), key=lambda file: os.fsencode(file.name))


def files_told(folder: Path, tell: Callable[[Path, str], None]) -> Iterator[FolderFile]:
    """Yields all regular files below a folder, and reports everything else to `tell`.

    Args:
        folder: Path of the folder.
        tell: Called with the path of everything else, and what is wrong with it.

    Raises:
        OSError: The path is not a folder, or the folder cannot be read.
    """
    return _walk(folder, "", MAX_DEPTH, tell)


def _walk(folder: Path, prefix: str, depth: int, tell: Callable[[Path, str], None]) -> Iterator[FolderFile]:
    if depth == 0:
        tell(folder, f"is nested more than {MAX_DEPTH} folders deep; no store could hold it")
        return
    with os.scandir(folder) as entries:
        for entry in entries:
            name = prefix + entry.name
            if entry.is_dir(follow_symlinks=False):
                yield from _walk(Path(entry.path), f"{name}/", depth - 1, tell)
            elif entry.is_file(follow_symlinks=False):
                yield FolderFile(name, Path(entry.path))
            else:
                kind = "a symbolic link" if entry.is_symlink() else "neither a regular file nor a folder"
                tell(Path(entry.path), f"is {kind}; only regular files and folders can be stored")


def open_regular(path: Path) -> BufferedReader:
    """Opens and returns a regular file for reading; links and devices are refused.

    Raises:
        FileNotFoundError: Nothing is there, or no regular file: folders, symbolic links and devices
            are not followed, read or waited for.
        OSError: The file cannot be opened.
    """
    try:
        # Without O_NONBLOCK, opening a FIFO would wait for a writer.
        descriptor = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC)
    except OSError as error:
        if error.errno in _NO_REGULAR_FILE:
            raise FileNotFoundError(errno.ENOENT, "no regular file", str(path)) from None
        raise
    if not stat.S_ISREG(os.fstat(descriptor).st_mode):
        os.close(descriptor)
        raise FileNotFoundError(errno.ENOENT, "no regular file", str(path))
    return os.fdopen(descriptor, "rb")


def version_of(path: Path) -> tuple[int, int, int]:
    """Returns a file's inode, size in bytes and modification time in ns, which change when it is written or replaced.

    Raises `StorageError` if the file cannot be looked at.
    """
    with os_failures(f"read {path}"):
        now = path.lstat()
    return now.st_ino, now.st_size, now.st_mtime_ns
