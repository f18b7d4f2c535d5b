"""Causes of a run's failures in a file, `why.json` in its folder, that the console and the command line read."""

from pathlib import Path

from pydantic import ValidationError

from ...schemas.reports.causes import Why
from ..files.whole_files import write_whole

WHY_FILE = "why.json"


def write_why(why: Why | None, folder: Path) -> None:
    """Writes the causes of a run's failures, atomically; removes the file of an earlier answer where there are none.

    Args:
        why: The causes; None: no trial failed, or nothing was asked.
        folder: The run's folder.

    Raises:
        OSError: It cannot be written.
    """
    path = folder / WHY_FILE
    if why is None:
        path.unlink(missing_ok=True)
        return
    write_whole(path, why.model_dump_json(exclude_none=True))


def read_why(folder: Path) -> Why | None:
    """Reads the causes of a run's failures; `None` where none are stored, or another release has written them.

    Args:
        folder: The run's folder.
    """
    try:
        return Why.model_validate_json((folder / WHY_FILE).read_bytes())
    except (OSError, ValidationError):
        return None
