"""Notes that the runtime adds to the log of a run."""

import os
from contextlib import suppress
from pathlib import Path

from ....schemas.runs.plan import RunPlan
from .logs import LOG_FOLDER, STDERR_LOG


def add_note(output_dir: Path, text: str) -> None:
    """Adds a line to the run's error log."""
    folder = output_dir / LOG_FOLDER
    flags = os.O_WRONLY | os.O_APPEND | os.O_CREAT | os.O_NOFOLLOW | os.O_NONBLOCK
    with suppress(OSError):  # the application may have put anything there
        folder.mkdir(exist_ok=True)
        with os.fdopen(os.open(folder / STDERR_LOG, flags, 0o644), "w") as file:
            file.write(f"{text}\n")


def note_screens(plan: RunPlan) -> None:
    """Says in the log that a program's screen is not shown, if the request asked for it."""
    if plan.live_view_port is not None and not plan.has_episode:
        add_note(
            plan.output_dir,
            "streamUI: the screen of a program cannot be shown here; only the physics of a dm_env environment can",
        )
