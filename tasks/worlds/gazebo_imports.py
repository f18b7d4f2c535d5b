"""Imports Gazebo worlds, each in a child process with limits of time and memory."""

import json
import signal
import subprocess
import sys
import threading
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from ...schemas.wire.errors import ConfigurationError
from ...schemas.worlds.gazebo_notes import GazeboNotes
from ..sdf.xml_files import similar_to

SUFFIXES = (".world", ".sdf")
"""File name suffixes of Gazebo worlds."""

_PROGRAM = "prefect_robomaker.tasks.worldforge.gazebo.worker"
_MOST_S = 3600.0
"""Time limit of an import, in seconds, for a busy machine; its processor time is limited to 600 s."""


@dataclass(frozen=True, slots=True)
class GazeboImport:
    """Order to import a Gazebo world: file and options."""

    path: Path
    model_paths: Sequence[Path] = ()
    start: tuple[float, float, float, float | None] | None = None
    """Start position in a Gazebo world: x, y, yaw, and approximate height of the floor (`None`: unknown)."""
    start_from: str | None = None
    """Launch file from which a Gazebo world's start position is read; `None`: there is none."""
    loose: Literal["hold", "free"] = "free"
    allow_missing: bool = False
    notes: GazeboNotes = field(default_factory=GazeboNotes)


def write_gazebo_bundle(wanted: GazeboImport, folder: Path, *, most_s: float = _MOST_S) -> None:
    """Imports a Gazebo world in a child process, and writes its files.

    Args:
        wanted: The import.
        folder: A new folder for the bundle.
        most_s: Seconds on the clock after which the process is ended.

    Raises:
        ConfigurationError: The world cannot be imported; the message says why.
    """
    _check_existence(wanted.path)
    request = {
        "path": str(wanted.path),
        "model_paths": [str(path) for path in wanted.model_paths],
        "start": wanted.start,
        "start_from": wanted.start_from,
        "loose": wanted.loose,
        "allow_missing": wanted.allow_missing,
        "notes": wanted.notes.model_dump_json(),
        "folder": str(folder),
    }
    with subprocess.Popen(
        [sys.executable, "-P", "-m", _PROGRAM], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        # It may wait for ever without taking processor time, which its own limits do not see.
        clock = threading.Timer(most_s, process.kill)
        clock.daemon = True
        clock.start()
        try:
            process.stdin.write(json.dumps(request) + "\n")
            process.stdin.flush()  # and open until it has answered: it ends with it
            line = process.stdout.readline()
        except BrokenPipeError:
            line = ""
        finally:
            process.stdin.close()
            if sys.exc_info()[0] is not None:
                process.kill()
            code = process.wait()
            clock.cancel()
    if not line.endswith("\n"):
        raise ConfigurationError(f"{wanted.path}: {_reason(code)}")
    answer: dict[str, str] = json.loads(line)
    if "error" in answer:
        raise ConfigurationError(answer["error"])


def _check_existence(path: Path) -> None:
    """Raises ConfigurationError for a file that is not there, before a child process imports modules for a second."""
    with suppress(OSError):  # which the child process tells
        if not path.exists():
            raise ConfigurationError(f"{path}: it does not exist{similar_to(path)}")


def _reason(code: int) -> str:
    if code in (-signal.SIGXCPU, -signal.SIGKILL):
        return "importing it takes too long or too much memory, and was ended; name fewer or simpler models"
    return f"the process that imported it ended with code {code}; its messages are above"
