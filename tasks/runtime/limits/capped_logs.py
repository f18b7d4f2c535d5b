"""Logs that cannot fill the disk.

Programs write straight into their log files, so logging costs them nothing and nothing stands between
them and the disk that could break. A supervisor looks at the sizes from time to time: a log that has
become too long is cut back to its beginning and gets a line that says so. What is written after that is
kept until the next look, so that the end of a log, which says why a program died, is there too.
"""

import os
from contextlib import suppress
from pathlib import Path

MAX_LOG_BYTES = 100_000_000
"""How much of one log is kept from its beginning."""
MAX_END_BYTES = 64 * 1024
"""How much of its end is kept besides."""
_SLACK_BYTES = 4 * 1024 * 1024


class CappedLog:
    """One log file, open for appending; made when it is not there.

    Args:
        path: The file. Links are not followed.
        max_bytes: How much of it is kept from its beginning.

    Raises:
        OSError: It cannot be opened.
    """

    def __init__(self, path: Path, max_bytes: int = MAX_LOG_BYTES) -> None:
        flags = os.O_RDWR | os.O_CREAT | os.O_APPEND | os.O_NOFOLLOW | os.O_CLOEXEC
        self.descriptor = os.open(path, flags, 0o644)
        self._max_bytes = max_bytes
        self._kept_bytes: int | None = None
        """Length of beginning and remark, once it was cut."""

    def note(self, text: str) -> None:
        """Appends a line of our own; a full disk loses it."""
        with suppress(OSError):
            os.write(self.descriptor, f"robomaker: {text}\n".encode())

    def look(self) -> None:
        """Cuts the log back if it has become too long."""
        self._cut_beyond(_SLACK_BYTES)

    def close(self) -> None:
        """Cuts the log for the last time; no process may write to it any more."""
        self._cut_beyond(MAX_END_BYTES)
        os.close(self.descriptor)

    def _cut_beyond(self, slack_bytes: int) -> None:
        """Cuts it, the first time as soon as it is too long, later when its end has become longer than that."""
        size = os.fstat(self.descriptor).st_size
        if self._kept_bytes is None:
            if size > self._max_bytes:
                words = f"this log became longer than {self._max_bytes:,} bytes; from here only its end is kept"
                self._cut(size, self._max_bytes, f"\nrobomaker: {words}\n".encode())
        elif size > self._kept_bytes + slack_bytes:
            self._cut(size, self._kept_bytes)

    def _cut(self, size: int, length: int, remark: bytes = b"") -> None:
        """Keeps the beginning and the end: a program that is fast may have written its last line by now."""
        end = self._end(max(length, size - MAX_END_BYTES), size)
        if remark:
            self._write_at(length, remark)
        with suppress(OSError):
            os.ftruncate(self.descriptor, length + len(remark))
            self._kept_bytes = length + len(remark)
            os.write(self.descriptor, end)

    def _end(self, start: int, size: int) -> bytes:
        with suppress(OSError):
            return os.pread(self.descriptor, size - start, start)
        return b""

    def _write_at(self, place: int, data: bytes) -> None:
        """Writes before the log is cut: what a program appends meanwhile would come before a remark appended after."""
        with suppress(OSError):
            # Linux appends whatever is written to a descriptor that appends, also where `pwrite` names a place.
            descriptor = os.open(f"/proc/self/fd/{self.descriptor}", os.O_WRONLY | os.O_CLOEXEC)
            try:
                os.pwrite(descriptor, data, place)
            finally:
                os.close(descriptor)
