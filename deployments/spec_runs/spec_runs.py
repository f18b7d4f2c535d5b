"""Ordered runs of a data home, and their states: starts, cancels and resumes them."""

import fcntl
import os
import threading
from collections.abc import Iterator, Mapping
from contextlib import suppress
from pathlib import Path

from pydantic import Field, ValidationError

from ...schemas.reports.names import began
from ...schemas.reports.progress import FINISHED, Note, ProgressEvent, StepEnded, StepProgress, StepStarted
from ...schemas.reports.run_record import Order
from ...schemas.runs.programs import IN_WORDS
from ...schemas.wire.base import Model
from ...schemas.wire.errors import ThrottlingException
from ...tasks.files.whole_files import write_whole
from ...tasks.nights.open_runs import CANCEL, LOCK, LOG, ORDER, OpenRun, has_broken_off, is_going, lock_of
from ...tasks.nights.taking_up import CONTINUED, start_process

STANDING = "standing.json"
"""Name of the file with the state of an ordered run, in the run's folder."""

_EVERY_S = 0.3


class StepStanding(Model):
    """State of one step of a run ordered in the web console."""

    name: str = Field(description="The step's name in the specification.")
    operation: str = Field(description="The operation it calls.")
    status: str = Field(default="waiting", description="`waiting`, `running`, or how it ended.")
    ended: int = Field(default=0, description="How many of its parts, worlds or jobs, have ended.")
    total: int = Field(default=0, description="How many parts it has; 0: none are known.")
    detail: str = Field(default="", description="Reason of the wait, ARN of the result, or reason of the failure.")


class Standing(Model):
    """State of a run ordered in the web console."""

    name: str = Field(description="Name of the specification.")
    key_id: str | None = Field(default=None, description="The access key that ordered it; absent: none was asked for.")
    ordered_by: str = Field(default="", description="The name of that key.")
    steps: list[StepStanding] = Field(default=[], description="Steps of the run, in the order they run.")
    note: str = Field(default="", description="The latest thing that was worth a line.")
    problem: str = Field(default="", description="Why it did not begin or broke off; empty: it did not.")


def read_standing(folder: Path) -> Standing | None:
    """Reads the state of an ordered run from its folder; `None` if it was not ordered here."""
    with suppress(OSError, ValidationError):
        return Standing.model_validate_json((folder / STANDING).read_bytes())
    return None


def write_standing(folder: Path, standing: Standing) -> None:
    """Writes the state of an ordered run into its folder, in a file that is replaced as a whole."""
    write_whole(folder / STANDING, standing.model_dump_json())


class StandingFile:
    """Progress listener that writes the state of an ordered run to its folder.

    Args:
        folder: The run's.
        standing: Initial state of the run.
    """

    def __init__(self, folder: Path, standing: Standing) -> None:
        self._folder = folder
        self._standing = standing
        self._lock = threading.Lock()
        self._is_due = False

    def __call__(self, event: ProgressEvent, /) -> None:
        """Updates the stored state of an ordered run by an event: a note, a step's start or end, or progress."""
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
        """Records why the run did not start or was interrupted."""
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
        """Updates the state, and writes it a moment later, as thousands of jobs each cause several events."""
        self._standing = self._standing.model_copy(update=members)
        if not self._is_due:
            self._is_due = True
            timer = threading.Timer(_EVERY_S, self.write)
            timer.daemon = True
            timer.start()

    def write(self) -> None:
        """Writes the current state of an ordered run into its folder, now."""
        with self._lock:
            self._is_due = False
            write_standing(self._folder, self._standing)


_MOST_LOG_BYTES = 4_096

MOST_AT_ONCE = 4
"""Limit of runs at the same time: each is a process of some 200 MB, and their jobs share the machine."""


class SpecRuns:
    """Runs of specifications that are ordered through one server.

    Args:
        home: The data home.
        variables: Environment variables of their processes, besides those of this one.
        audit_log: Audit log of their steps; `None`: steps are not recorded.
    """

    def __init__(self, home: Path, variables: Mapping[str, str], audit_log: Path | None = None) -> None:
        self.audit_log = audit_log
        self._runs = home / "runs"
        self._variables = variables
        self._lock = threading.Lock()

    def begin(self, order: Order, standing: Standing) -> None:
        """Starts a run in a process that outlives this one.

        Raises:
            ThrottlingException: Too many run already.
        """
        with self._lock:
            self._check_room()
            folder = self._runs / order.run_id
            folder.mkdir(parents=True)
            write_standing(folder, standing)
            with lock_of(folder, os.O_CREAT) as lock:
                # Waits a moment where another server just looks whether this run goes on. Locked before there is an
                # order, which another process could take for that of a run that broke off.
                fcntl.flock(lock, fcntl.LOCK_EX)
                (folder / ORDER).touch(0o600)  # the specification may hold secrets
                (folder / ORDER).write_text(order.model_dump_json(), encoding="utf-8")
                start_process(OpenRun(folder, order, os.dup(lock)), self._variables)

    def has_broken_off(self, run_id: str) -> bool:
        """Whether a run was interrupted because its process died."""
        return has_broken_off(self._runs / run_id)

    def take_up(self, run_id: str) -> bool:
        """Resumes an interrupted run.

        Returns:
            Whether it was resumed; False: it has ended, or is already running.

        Raises:
            ThrottlingException: Too many run already.
        """
        with self._lock:
            self._check_room()
            if (claimed := OpenRun.claim(self._runs / run_id)) is None:
                return False
            start_process(claimed, self._variables, CONTINUED)
        return True

    def _open(self) -> Iterator[str]:
        """Yields the ids of visitors' runs that have not ended."""
        return (path.parent.name for path in self._runs.glob(f"*/{LOCK}") if path.with_name(STANDING).is_file())

    def _check_room(self) -> None:
        if len(self.going()) >= MOST_AT_ONCE:
            raise ThrottlingException(f"{MOST_AT_ONCE} runs that were ordered here go on; wait until one has ended")

    def standing(self, run_id: str) -> Standing | None:
        """Returns the state of an ordered run; `None` if it was not ordered here."""
        return read_standing(self._runs / run_id)

    def going(self) -> list[str]:
        """Returns the ids of ordered runs that are running, newest first."""
        return sorted(filter(self.is_going, self._open()), key=began, reverse=True)

    def is_going(self, run_id: str) -> bool:
        """Whether the process of a run is alive."""
        return is_going(self._runs / run_id)

    def cancel(self, run_id: str) -> None:
        """Cancels a run: its jobs are cancelled, and its report is written."""
        (self._runs / run_id / CANCEL).touch()

    def last_words(self, run_id: str) -> str:
        """Returns the last log lines of a run's process; empty if there are none."""
        try:
            with (self._runs / run_id / LOG).open("rb") as log:
                log.seek(max(0, log.seek(0, os.SEEK_END) - _MOST_LOG_BYTES))
                return log.read().decode(errors="replace").strip()
        except OSError:
            return ""
