"""Output streams of a recording."""

import errno
import os
from pathlib import Path


class Unbuffered:
    """A binary output stream without a buffer of its own, so that a finished chunk leaves the process."""

    def __init__(self, path: Path, keep_bytes: int = 0) -> None:
        """Opens a file, of which the beginning is kept.

        Raises:
            OSError: It is shorter than that, or cannot be opened.
        """
        fresh = 0 if keep_bytes else os.O_TRUNC
        self._descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_CLOEXEC | fresh, 0o644)
        self._position = keep_bytes
        if fresh:
            return
        if os.fstat(self._descriptor).st_size < keep_bytes:
            os.close(self._descriptor)
            raise OSError(errno.ENODATA, f"it has less than the {keep_bytes} bytes that it had at the checkpoint")
        os.ftruncate(self._descriptor, keep_bytes)
        os.lseek(self._descriptor, keep_bytes, os.SEEK_SET)

    def write(self, data: bytes) -> int:
        """Writes all of it."""
        view = memoryview(data)
        while view:
            written = os.write(self._descriptor, view)
            self._position += written
            view = view[written:]
        return len(data)

    def tell(self) -> int:
        """Returns how many bytes there are."""
        return self._position

    def close(self) -> None:
        """Closes the file."""
        os.close(self._descriptor)


class Nowhere:
    """A stream that discards its bytes."""

    def write(self, data: bytes) -> int:
        """Takes it."""
        return len(data)

    def tell(self) -> int:
        """Returns 0."""
        return 0

    def close(self) -> None:
        """There is nothing to close."""
