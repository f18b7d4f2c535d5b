"""The logs of a run: where its output goes, and how they end."""

import os
import stat
import sys
from io import TextIOWrapper
from pathlib import Path

from ....schemas.wire.common import without_escapes

LOG_FOLDER = "logs"
STDOUT_LOG = "stdout.log"
STDERR_LOG = "stderr.log"

_TAIL_BYTES = 8192
_MAX_STEM_CHARACTERS = 240
"""File names have 255 bytes; tools may have longer names than that leaves."""
_SAYS_NOTHING = frozenset({"The traceback for the exception was written to the log file"})
"""Lines that say nothing: `roslaunch` prints this one after the error, about a file that users do not read."""


def redirect_output(output_dir: Path) -> None:
    """Sends this process's standard output and error to `logs/`, below Python, and closes its input.

    Programs that the process starts and libraries that print in C end up in the same files.
    """
    folder = output_dir / LOG_FOLDER
    folder.mkdir(parents=True, exist_ok=True)
    for descriptor, target in ((1, folder / STDOUT_LOG), (2, folder / STDERR_LOG)):
        opened = os.open(target, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644)
        os.dup2(opened, descriptor)
        os.close(opened)
    nothing = os.open(os.devnull, os.O_RDONLY)
    os.dup2(nothing, 0)
    os.close(nothing)
    for stream in (sys.stdout, sys.stderr):
        assert isinstance(stream, TextIOWrapper)
        # By line, so that the log shows what was printed just before a crash.
        stream.reconfigure(encoding="utf-8", errors="backslashreplace", line_buffering=True)


def program_logs(program: str) -> tuple[str, str]:
    """Names of the logs of one of the run's programs, in `logs/`: standard output, standard error."""
    stem = program[:_MAX_STEM_CHARACTERS]
    return f"{stem}.{STDOUT_LOG}", f"{stem}.{STDERR_LOG}"


def log_tail(output_dir: Path, program: str | None = None) -> tuple[str, list[str]]:
    """Returns the name of the log that says most about a failure, and its last lines without colours.

    That is the error log, or the output log when nothing was written to the error log.

    Args:
        output_dir: The run's output folder.
        program: One of its programs; None: the run's own process.
    """
    stdout, stderr = program_logs(program) if program else (STDOUT_LOG, STDERR_LOG)
    name, lines = stderr, _last_lines(output_dir / LOG_FOLDER / stderr)
    if not lines:
        name, lines = stdout, _last_lines(output_dir / LOG_FOLDER / stdout)
    return f"{LOG_FOLDER}/{name}", lines


def _last_lines(path: Path) -> list[str]:
    try:
        # The application may have put a link or a FIFO there: neither is followed or waited for.
        with os.fdopen(os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK), "rb") as log:
            if not stat.S_ISREG(os.fstat(log.fileno()).st_mode):
                return []
            size = log.seek(0, os.SEEK_END)
            log.seek(max(0, size - _TAIL_BYTES))
            data = log.read(_TAIL_BYTES)
    except OSError:
        return []
    lines = data.decode(errors="replace").splitlines()
    if size > _TAIL_BYTES and len(lines) > 1:
        lines = lines[1:]  # begins in the middle of a line
    cleaned = (without_escapes(line).rstrip() for line in lines)
    return [line for line in cleaned if line and line not in _SAYS_NOTHING]
