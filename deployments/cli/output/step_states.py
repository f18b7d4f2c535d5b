"""States of a run's steps, updated by its events, and the base class of progress displays."""

from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from typing import Literal

from ....schemas.reports.progress import (
    FINISHED,
    Note,
    ProgressEvent,
    StepEnded,
    StepProgress,
    StepStarted,
    TrialCounts,
)
from ....schemas.runs.programs import IN_WORDS, Wait
from ....schemas.wire.common import counted
from .answers import duration

_BAD_STATUSES = frozenset({"Failed", "Canceled", "TimedOut", "PartialFailed", "Skipped"})
_BAD_OUTCOMES = ("broken", "canceled")

Look = Literal["good", "bad", "unsure"]


def look_of(ended: StepEnded) -> Look:
    """Returns how an ended step is shown: `bad` if it, or a job of it, did not do as it should.

    It is `unsure` where only the end of the run tells whether its failed jobs are known failures.
    """
    if ended.status in _BAD_STATUSES or any(ended.outcomes.get(each) for each in _BAD_OUTCOMES):
        return "bad"
    if ended.outcomes.get("failed"):
        return "unsure" if ended.may_be_known else "bad"
    return "good"


@dataclass
class StepState:
    """Progress of one step of a run, for display."""

    name: str
    operation: str
    started_s: float | None = None
    counts: Mapping[str, int] = field(default_factory=dict)
    total: int = 0
    newest_failure: str = ""
    waits_for: Wait | None = None
    trials: TrialCounts | None = None
    ended: StepEnded | None = None
    """Final event of a run's step; `None` while it waits or runs."""

    @property
    def is_running(self) -> bool:
        """Whether a run's step has started and not ended."""
        return self.started_s is not None and self.ended is None

    @property
    def done(self) -> int:
        """Number of a step's parts (worlds or jobs) that are done."""
        return sum(count for state, count in self.counts.items() if state.lower() in FINISHED)

    def counts_text(self) -> str:
        """Returns the counts of a step's parts by state: `2 running, 1 completed`."""
        return ", ".join(f"{count} {state}" for state, count in self.counts.items() if count)

    def parts_text(self) -> str:
        """Returns the counts of a step's parts while it goes on; empty for a single job whose trials are counted."""
        return "" if self.total == 1 and self.trials is not None else self.counts_text()

    def trials_text(self) -> str:
        """Returns a step's trial counts: `3,100 of 10,000 trials`; empty if there are none."""
        return "" if self.trials is None else f"{self.trials.finished:,} of {counted(self.trials.total, 'trial', ',')}"

    def after_trials_text(self) -> str:
        """Says what jobs do after their last trial, which may take minutes; empty before, and at the end.

        An example: `2 of 10 trials recorded, records a video of trial 3 of job sim-1`.
        """
        told = self.trials
        if told is None or self.done >= self.total:
            return ""
        done, total = told.work
        parts = [
            f"{told.recorded} of {counted(told.to_record, 'trial')} recorded" if told.to_record else "",
            told.recording,
        ]
        parts += ["outputs are stored" if self.is_running and done == total else ""]
        return ", ".join(filter(None, parts))

    @property
    def work(self) -> tuple[int, int]:
        """Returns finished and total work of a step: trials and their recordings if there are any, else parts."""
        return self.trials.work if self.trials else (self.done, self.total)

    def wait_text(self) -> str:
        """Returns the resource that the next part waits for: `waits for memory`; empty if it does not wait."""
        return f"waits for {IN_WORDS[self.waits_for]}" if self.waits_for and self.done < self.total else ""

    def pace(self, now_s: float) -> str:
        """Returns a step's rate and expected time left: `0.5/s, 12 s to go`; empty if they are not known."""
        elapsed = now_s - self.started_s if self.started_s is not None else 0.0
        done, total = self.work
        # A trial that is recorded takes many times as long as one that is not.
        if not done or done >= total or elapsed <= 0 or (self.trials is not None and self.trials.to_record):
            return ""
        rate = done / elapsed
        shown = f"{rate:.1f}/s" if rate >= 1 else f"{rate * 60:.1f}/min"
        return f"{shown}, {duration((total - done) / rate)} to go"


class StepStates:
    """Progress of all steps of a run, for display.

    Args:
        steps: Names and operations.
    """

    def __init__(self, steps: Sequence[tuple[str, str]]) -> None:
        self.steps = {name: StepState(name, operation) for name, operation in steps}
        self.notes: list[str] = []

    def take(self, event: ProgressEvent, now_s: float) -> None:
        """Updates the progress by an event.

        Args:
            event: The event to apply.
            now_s: Time of the event, in seconds of a clock that only runs forward.
        """
        if isinstance(event, Note):
            self.notes.append(event.text)
            return
        state = self.steps.setdefault(event.step, StepState(event.step, ""))
        if isinstance(event, StepStarted):
            state.started_s = now_s
        elif isinstance(event, StepProgress):
            state.counts, state.total = dict(event.counts), event.total
            state.newest_failure = event.newest_failure or state.newest_failure
            state.waits_for, state.trials = event.waits_for, event.trials
        elif isinstance(event, StepEnded):
            state.ended = event


class Watcher(AbstractContextManager["Watcher"]):
    """Base class of progress displays: listeners that are active inside a `with` block."""

    def __call__(self, event: ProgressEvent) -> None:
        """Handles an event of the run, from any thread; each subclass shows it in its way."""
        raise NotImplementedError
