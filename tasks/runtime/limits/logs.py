"""Logs of a run: their paths, size limits, lines added by the runtime, and their last lines."""

import os
import stat
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from io import TextIOWrapper
from pathlib import Path

from ....schemas.runs.plan import RunPlan
from ....schemas.wire.common import without_escapes

LOG_FOLDER = "logs"
STDOUT_LOG = "stdout.log"
STDERR_LOG = "stderr.log"

_TAIL_BYTES = 8192
_MAX_STEM_CHARACTERS = 240
"""Maximum length of a log's file name without suffix; file names have at most 255 bytes, and tools may have longer
names.
"""
_SAYS_NOTHING = frozenset({"The traceback for the exception was written to the log file"})
"""Log lines that carry no information: `roslaunch` prints this one after the error, about a file that users do not
read.
"""


def redirect_output(output_dir: Path) -> None:
    """Redirects this process's standard output and error to files in `logs/`, and closes its standard input.

    Programs that the process starts and libraries that print in C end up in the same files.
    """
    _write_to(output_dir)
    nothing = os.open(os.devnull, os.O_RDONLY)
    os.dup2(nothing, 0)
    os.close(nothing)
    for stream in (sys.stdout, sys.stderr):
        assert isinstance(stream, TextIOWrapper)
        # By line, so that the log shows what was printed just before a crash.
        stream.reconfigure(encoding="utf-8", errors="backslashreplace", line_buffering=True)


@contextmanager
def own_logs(output_dir: Path) -> Iterator[None]:
    """Redirects standard output and error to files in `logs/` of a folder, inside of the `with` block only.

    A trial that is run again to be recorded says all that it said before: the logs of the job would have it twice.

    Args:
        output_dir: Output folder of the trial.
    """
    before = [(os.dup(descriptor), descriptor) for descriptor in (1, 2)]
    try:
        _flush()
        _write_to(output_dir)
        yield
    finally:
        _flush()
        for kept, descriptor in before:
            os.dup2(kept, descriptor)
            os.close(kept)
        for name in (STDOUT_LOG, STDERR_LOG):
            with suppress(OSError):  # the application may have put anything there
                CappedLog(output_dir / LOG_FOLDER / name).close()


def _write_to(output_dir: Path) -> None:
    folder = output_dir / LOG_FOLDER
    folder.mkdir(parents=True, exist_ok=True)
    for descriptor, target in ((1, folder / STDOUT_LOG), (2, folder / STDERR_LOG)):
        opened = os.open(target, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644)
        os.dup2(opened, descriptor)
        os.close(opened)


def _flush() -> None:
    for stream in (sys.stdout, sys.stderr):
        with suppress(Exception):  # the application may have closed or replaced it, or the disk is full
            stream.flush()


def program_logs(program: str) -> tuple[str, str]:
    """Returns the log file names of one of the run's programs: for standard output, and for standard error."""
    stem = program[:_MAX_STEM_CHARACTERS]
    return f"{stem}.{STDOUT_LOG}", f"{stem}.{STDERR_LOG}"


def log_tail(
    output_dir: Path, program: str | None = None, sizes: tuple[int, int] | None = None
) -> tuple[str, list[str]]:
    """Returns the name of the log that explains a failure best, and its last lines without colour codes.

    That is the error log, or the output log if the error log is empty or was written last a while before.

    Args:
        output_dir: The run's output folder.
        program: Name of one of the run's programs; None: the run's own process.
        sizes: Bytes of the logs of output and errors that count; None: all.
    """
    most_output, most_errors = sizes if sizes is not None else (None, None)
    stdout, stderr = program_logs(program) if program else (STDOUT_LOG, STDERR_LOG)
    name, lines = stderr, _last_lines(output_dir / LOG_FOLDER / stderr, most_errors)
    if not lines or _is_later(output_dir / LOG_FOLDER / stdout, output_dir / LOG_FOLDER / stderr):
        said = _last_lines(output_dir / LOG_FOLDER / stdout, most_output)
        name, lines = (stdout, said) if said or not lines else (name, lines)
    return f"{LOG_FOLDER}/{name}", lines


def _is_later(output: Path, errors: Path) -> bool:
    """Returns whether the output log was written after the error log, by more than a program needs to end."""
    try:
        return output.lstat().st_mtime - errors.lstat().st_mtime > _LATER_S
    except OSError:
        return False


def _last_lines(path: Path, most: int | None) -> list[str]:
    try:
        # The application may have put a link or a FIFO there: neither is followed or waited for.
        with os.fdopen(os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK), "rb") as log:
            if not stat.S_ISREG(os.fstat(log.fileno()).st_mode):
                return []
            size = log.seek(0, os.SEEK_END)
            size = size if most is None else min(size, most)
            place = log.seek(max(0, size - _TAIL_BYTES))
            data = log.read(size - place)
    except OSError:
        return []
    lines = data.decode(errors="replace").splitlines()
    if size > _TAIL_BYTES and len(lines) > 1:
        lines = lines[1:]  # begins in the middle of a line
    cleaned = (without_escapes(line).rstrip() for line in lines)
    return [line for line in cleaned if line and line not in _SAYS_NOTHING]


_LATER_S = 1.0
"""Seconds by which a log counts as written later: Python writes a traceback, and then what its output still holds."""
MAX_LOG_BYTES = 100_000_000
"""Number of bytes that are kept from the beginning of a log."""
MAX_END_BYTES = 64 * 1024
"""Number of bytes that are kept from the end of a log."""
_SLACK_BYTES = 4 * 1024 * 1024


class CappedLog:
    """A log file of a program that is cut back to a maximum size.

    Args:
        path: Path of the log file; links are not followed.
        max_bytes: Number of bytes that are kept from its beginning.

    Raises:
        OSError: The file cannot be opened.
    """

    def __init__(self, path: Path, max_bytes: int = MAX_LOG_BYTES) -> None:
        flags = os.O_RDWR | os.O_CREAT | os.O_APPEND | os.O_NOFOLLOW | os.O_CLOEXEC
        self.descriptor = os.open(path, flags, 0o644)
        self._max_bytes = max_bytes
        self._kept_bytes: int | None = None
        """Size in bytes of the kept beginning with the remark, once the log was cut."""

    def note(self, text: str) -> None:
        """Appends a line of the runtime to the log; it is lost if the disk is full."""
        with suppress(OSError):
            os.write(self.descriptor, f"robomaker: {text}\n".encode())

    def look(self) -> None:
        """Removes the middle of the log if it has become too long."""
        self._cut_beyond(_SLACK_BYTES)

    def close(self) -> None:
        """Cuts the log back a last time, and closes it; no process may write to it any more."""
        self._cut_beyond(MAX_END_BYTES)
        os.close(self.descriptor)

    def _cut_beyond(self, slack_bytes: int) -> None:
        """Cuts the log back when it is too long; later only when its end has grown beyond `slack_bytes`."""
        size = os.fstat(self.descriptor).st_size
        if self._kept_bytes is None:
            if size > self._max_bytes:
                words = f"this log became longer than {self._max_bytes:,} bytes; from here only its end is kept"
                self._cut(size, self._max_bytes, f"\nrobomaker: {words}\n".encode())
        elif size > self._kept_bytes + slack_bytes:
            self._cut(size, self._kept_bytes)

    def _cut(self, size: int, length: int, remark: bytes = b"") -> None:
        """Removes the middle of the log and keeps its beginning (`length` bytes) and end, with a remark in between.

        Does nothing if the disk is full.
        """
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
        """Writes at an offset of the log, not at its end, as the program may append output at the same time."""
        with suppress(OSError):
            # Linux appends whatever is written to a descriptor that appends, also where `pwrite` names a place.
            descriptor = os.open(f"/proc/self/fd/{self.descriptor}", os.O_WRONLY | os.O_CLOEXEC)
            try:
                os.pwrite(descriptor, data, place)
            finally:
                os.close(descriptor)


def add_note(output_dir: Path, text: str) -> None:
    """Appends a line of the runtime to the run's error log; it is lost if the log cannot be written."""
    folder = output_dir / LOG_FOLDER
    flags = os.O_WRONLY | os.O_APPEND | os.O_CREAT | os.O_NOFOLLOW | os.O_NONBLOCK
    with suppress(OSError):  # the application may have put anything there
        folder.mkdir(exist_ok=True)
        with os.fdopen(os.open(folder / STDERR_LOG, flags, 0o644), "w") as file:
            file.write(f"{text}\n")


def note_screens(plan: RunPlan) -> None:
    """Writes to the run's error log that a program's graphical screen is not shown, if the request asked for one."""
    if plan.live_view_port is not None and not plan.has_episode:
        add_note(
            plan.output_dir,
            "streamUI: the screen of a program cannot be shown here; only the physics of a dm_env environment can",
        )
