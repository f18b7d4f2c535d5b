"""Reading files that applications have left, which may have put anything in their place."""

import errno
import os
import stat
from io import BufferedReader
from pathlib import Path

_FLAGS = os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC


def read_left(path: Path, most_bytes: int) -> bytes:
    """Reads a regular file; links are not followed, FIFOs not waited for, what is longer not read.

    Args:
        path: The file.
        most_bytes: How long it may be.

    Raises:
        OSError: It is not there, is no regular file, is too long, or cannot be read.
    """
    with open_left(path) as file:
        if os.fstat(file.fileno()).st_size > most_bytes:
            raise OSError(errno.EFBIG, f"longer than {most_bytes} bytes", str(path))
        return file.read(most_bytes)


def open_left(path: Path, folder: int | None = None) -> BufferedReader:
    """Opens a regular file for reading; links are not followed, FIFOs not waited for.

    Args:
        path: The file.
        folder: Descriptor of the folder that a relative path starts from; absent: the working directory.

    Raises:
        OSError: It is not there, is no regular file, or cannot be opened.
    """
    file = os.fdopen(os.open(path, _FLAGS, dir_fd=folder), "rb")
    if not stat.S_ISREG(os.fstat(file.fileno()).st_mode):
        file.close()
        raise OSError(errno.EINVAL, "no regular file", str(path))
    return file
