"""Safe access to files in folders of untrusted programs: no links are followed, no FIFO blocks.

Written files are complete or absent.
"""

import errno
import os
import stat
from collections.abc import Container, Generator, Iterable, Iterator
from contextlib import contextmanager, suppress
from io import BufferedReader
from pathlib import Path
from typing import BinaryIO, NamedTuple

_FLAGS = os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC


def read_left(path: Path, most_bytes: int) -> bytes:
    """Returns the content of a regular file that untrusted code may have made: no links, no FIFOs, limited size.

    Args:
        path: Path of the file.
        most_bytes: Maximum size of the file.

    Raises:
        OSError: The file does not exist, is not a regular file, is too long, or cannot be read.
    """
    with open_left(path) as file:
        if os.fstat(file.fileno()).st_size > most_bytes:
            raise OSError(errno.EFBIG, f"longer than {most_bytes} bytes", str(path))
        return file.read(most_bytes)


def open_left(path: Path, folder: int | None = None) -> BufferedReader:
    """Opens and returns a regular file that untrusted code may have made: no links, no FIFOs.

    Args:
        path: Path of the file.
        folder: File descriptor of the folder to which a relative path refers; absent: the working directory.

    Raises:
        OSError: The file does not exist, is not a regular file, or cannot be opened.
    """
    descriptor = os.open(path, _FLAGS, dir_fd=folder)
    if not stat.S_ISREG(os.fstat(descriptor).st_mode):  # of a folder, `fdopen` would leave the descriptor open
        os.close(descriptor)
        raise OSError(errno.EINVAL, "no regular file", str(path))
    return os.fdopen(descriptor, "rb")


def unfinished_of(path: Path) -> Path:
    """Returns the temporary path of a file while it is being written."""
    return path.with_name(f".{path.name}.unfinished")


@contextmanager
def written_anew(path: Path) -> Generator[BinaryIO]:
    """Yields a new file that takes the place of `path` if the `with` block ends without an error.

    A link that an untrusted program has left at its temporary path is deleted.

    Raises:
        OSError: The folder cannot be written.
    """
    unfinished = unfinished_of(path)
    unfinished.unlink(missing_ok=True)
    with unfinished.open("xb") as file:
        yield file
    unfinished.replace(path)


def write_anew(path: Path, *parts: bytes) -> None:
    """Writes a file atomically: it is complete or absent, even if the process is killed; see `written_anew`.

    Raises OSError if the folder cannot be written or the disk is full.
    """
    with written_anew(path) as file:
        file.writelines(parts)


def write_all(file: BinaryIO, data: bytes) -> None:
    """Writes all bytes, repeating partial writes, which unbuffered files on a nearly full disk may have."""
    view = memoryview(data)
    while view:
        view = view[file.write(view) or 0 :]


LEAST_BYTES = 4096
"""Size in bytes that each file counts at least: an empty file takes space on the disk, too."""
_BLOCK_BYTES = 512
_PIECE_CHARACTERS = 1000
"""Length of the parts into which paths longer than the kernel's limit of 4096 bytes are split; a character has at most
four bytes.
"""
_FOLDER = os.O_DIRECTORY | os.O_CLOEXEC


class HeldFile(NamedTuple):
    """A file that takes space on a disk: its size there in bytes, path, time of last change (s), and device."""

    size_bytes: int
    """Space on the disk in bytes; holes of sparse files do not count."""

    path: str
    changed_s: float
    """Time of the last change of content, name or permissions (`st_ctime`), in seconds since 1970."""

    device: int


def files_below(folders: Iterable[Path]) -> Iterator[HeldFile | None]:
    """Yields the files in folders without following links.

    Unreadable folders of this user are made readable.

    Args:
        folders: The folders; missing ones are skipped.

    Yields:
        A file; None for other entries, so that the caller gets control often.
    """
    waiting = [(str(folder), 0) for folder in folders]
    while waiting:
        path, flags = waiting.pop()
        with suppress(OSError):  # it may be gone, or another user's
            descriptor = _open(path, flags)
            try:
                with os.scandir(descriptor) as entries:
                    for entry in entries:
                        if entry.is_dir(follow_symlinks=False):
                            waiting.append((f"{path}/{entry.name}", os.O_NOFOLLOW))
                            yield None
                        else:
                            yield _held(entry, path)
            finally:
                os.close(descriptor)


def deleted_files(processes: Iterable[int], devices: Container[int]) -> Iterator[int | None]:
    """Yields the sizes in bytes of deleted files that processes still hold open.

    Args:
        processes: Ids of the processes; some may have ended.
        devices: Numbers of the file systems that count (`st_dev`); this leaves out files in memory.

    Yields:
        Bytes on the disk; None for other files.
    """
    seen: set[tuple[int, int]] = set()
    for process in processes:
        with suppress(OSError), os.scandir(f"/proc/{process}/fd") as entries:
            for entry in entries:
                size = None
                with suppress(OSError):
                    about = os.stat(entry.path)  # noqa: PTH116 - several times faster
                    this = about.st_dev, about.st_ino
                    is_deleted = about.st_nlink == 0 and stat.S_ISREG(about.st_mode)
                    if is_deleted and about.st_dev in devices and this not in seen:
                        seen.add(this)
                        size = _size_of(about)
                yield size


def _held(entry: "os.DirEntry[str]", folder: str) -> HeldFile | None:
    try:
        about = entry.stat(follow_symlinks=False)
    except OSError:  # it may be gone
        return None
    return HeldFile(_size_of(about), f"{folder}/{entry.name}", about.st_ctime, about.st_dev)


def _size_of(about: os.stat_result) -> int:
    return max(about.st_blocks * _BLOCK_BYTES, LEAST_BYTES)


def _open(path: str, flags: int) -> int:
    """Opens a folder and returns its file descriptor; missing permissions of this user on an own folder are added.

    Raises `OSError` if it cannot be opened.
    """
    place = _open_long_path(path, flags)
    try:
        try:
            return os.open(".", os.O_RDONLY | _FOLDER, dir_fd=place)
        except PermissionError:
            rights = stat.S_IMODE(os.fstat(place).st_mode) | stat.S_IRUSR | stat.S_IXUSR
            Path(f"/proc/self/fd/{place}").chmod(rights)
            return os.open(".", os.O_RDONLY | _FOLDER, dir_fd=place)
    finally:
        os.close(place)


def _open_long_path(path: str, flags: int) -> int:
    """Opens a folder as a file descriptor for its place only, even if its path is too long for the kernel.

    Raises `OSError` if it cannot be opened.
    """
    try:
        return os.open(path, os.O_PATH | _FOLDER | flags)
    except OSError as error:
        if error.errno != errno.ENAMETOOLONG:
            raise
    place: int | None = None
    for piece in _pieces(path):
        try:
            found = os.open(piece, os.O_PATH | _FOLDER | flags, dir_fd=place)
        finally:
            if place is not None:
                os.close(place)
        place = found
    assert place is not None
    return place


def _pieces(path: str) -> Iterator[str]:
    """Yields the parts of a long path, each relative to the one before."""
    while len(path) > _PIECE_CHARACTERS:
        piece, _, rest = path[:_PIECE_CHARACTERS].rpartition("/")
        yield piece
        path = rest + path[_PIECE_CHARACTERS:]
    yield path
