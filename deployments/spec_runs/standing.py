"""How an ordered run stands: a file in the run's folder, written by its process and read by servers."""

import threading
from contextlib import suppress
from pathlib import Path

from pydantic import Field, ValidationError

from ...schemas.reports.progress import FINISHED, Note, ProgressEvent, StepEnded, StepProgress, StepStarted
from ...schemas.runs.machine_waits import IN_WORDS
from ...schemas.wire.base import Model

STANDING = "standing.json"
"""File in the folder of an ordered run."""

_EVERY_S = 0.3


class StepStanding(Model):
    """One step of the run."""

    name: str = Field(description="The step's name in the specification.")
    operation: str = Field(description="The operation it calls.")
    status: str = Field(default="waiting", description="`waiting`, `running`, or how it ended.")
    ended: int = Field(default=0, description="How many of its parts, worlds or jobs, have ended.")
    total: int = Field(default=0, description="How many parts it has; 0: none are known.")
    detail: str = Field(default="", description="Reason of the wait, ARN of the result, or reason of the failure.")


class Standing(Model):
    """The run."""

    name: str = Field(description="Name of the specification.")
    key_id: str | None = Field(default=None, description="The access key that ordered it; absent: none was asked for.")
    ordered_by: str = Field(default="", description="The name of that key.")
    steps: list[StepStanding] = Field(default=[], description="Steps of the run, in the order they run.")
    note: str = Field(default="", description="The latest thing that was worth a line.")
    problem: str = Field(default="", description="Why it did not begin or broke off; empty: it did not.")


def read_standing(folder: Path) -> Standing | None:
    """How the run of a folder stands; `None`: it is none that was ordered here."""
    with suppress(OSError, ValidationError):
        return Standing.model_validate_json((folder / STANDING).read_bytes())
    return None


def write_standing(folder: Path, standing: Standing) -> None:
    """Writes how a run stands; readers find the old or the new, whole."""
    part = folder / f".{STANDING}.part"
    part.write_text(standing.model_dump_json(), encoding="utf-8")
    part.replace(folder / STANDING)


class StandingFile:
    """Notes the progress of a run in its folder; called from any thread.

    Args:
        folder: the run's.
        standing: how it stands at the beginning.
    """

    def __init__(self, folder: Path, standing: Standing) -> None:
        self._folder = folder
        self._standing = standing
        self._lock = threading.Lock()
        self._is_due = False

    def __call__(self, event: ProgressEvent, /) -> None:
        """Takes an event of the run."""
        with self._lock:
            if isinstance(event, Note):
                self._change(note=event.text)
            elif isinstance(event, StepStarted):
                self._change_step(event.step, status="running")
            elif isinstance(event, StepEnded):
                self._change_step(event.step, status=event.status, detail=event.detail)
            else:
                self._progress(event)

    def broke(self, problem: str) -> None:
        """Notes why the run did not begin or broke off."""
        with self._lock:
            self._change(problem=problem)

    def _progress(self, event: StepProgress) -> None:
        ended = sum(count for state, count in event.counts.items() if state.lower() in FINISHED)
        waits = f"waits for {IN_WORDS[event.waits_for]}" if event.waits_for else ""
        self._change_step(event.step, ended=ended, total=event.total, detail=waits)

    def _change_step(self, name: str, **members: object) -> None:
        steps = [each.model_copy(update=members) if each.name == name else each for each in self._standing.steps]
        self._change(steps=steps)

    def _change(self, **members: object) -> None:
        """Changes what is known, and writes it a moment later: of thousands of jobs each has several events."""
        self._standing = self._standing.model_copy(update=members)
        if not self._is_due:
            self._is_due = True
            timer = threading.Timer(_EVERY_S, self.write)
            timer.daemon = True
            timer.start()

    def write(self) -> None:
        """Writes what is known now."""
        with self._lock:
            self._is_due = False
            write_standing(self._folder, self._standing)
