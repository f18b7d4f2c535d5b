"""States of a running pipeline's steps, gathered from its events, and the interface of what shows them."""

from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field

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
from .answers import duration

BAD_STATUSES = frozenset({"Failed", "Canceled", "TimedOut", "PartialFailed", "Skipped"})


@dataclass
class StepState:
    """One step."""

    name: str
    operation: str
    started_s: float | None = None
    counts: Mapping[str, int] = field(default_factory=dict)
    total: int = 0
    newest_failure: str = ""
    waits_for: Wait | None = None
    trials: TrialCounts | None = None
    status: str | None = None
    """How it ended; `None` while it waits or runs."""

    duration_s: float = 0.0
    detail: str = ""

    @property
    def is_running(self) -> bool:
        """Whether it has started and not ended."""
        return self.started_s is not None and self.status is None

    @property
    def done(self) -> int:
        """Parts that are done with."""
        return sum(count for state, count in self.counts.items() if state.lower() in FINISHED)

    def counts_text(self) -> str:
        """The counts in words: `2 running, 1 completed`."""
        return ", ".join(f"{count} {state}" for state, count in self.counts.items() if count)

    def trials_text(self) -> str:
        """How many trials have finished: `3,100 of 10,000 trials`; empty: there are none."""
        return f"{self.trials.finished:,} of {self.trials.total:,} trials" if self.trials else ""

    @property
    def work(self) -> tuple[int, int]:
        """Finished and total work: trials where there are any, else parts."""
        return (self.trials.finished, self.trials.total) if self.trials else (self.done, self.total)

    def wait_text(self) -> str:
        """Names the resource that the next part waits for: `waits for memory`; empty: it does not wait."""
        return f"waits for {IN_WORDS[self.waits_for]}" if self.waits_for and self.done < self.total else ""

    def pace(self, now_s: float) -> str:
        """Rate and expected time to go, once something is done: `0.5/s, 12 s to go`."""
        elapsed = now_s - self.started_s if self.started_s is not None else 0.0
        done, total = self.work
        if not done or done >= total or elapsed <= 0:
            return ""
        rate = done / elapsed
        shown = f"{rate:.1f}/s" if rate >= 1 else f"{rate * 60:.1f}/min"
        return f"{shown}, {duration((total - done) / rate)} to go"


class StepStates:
    """All steps of a pipeline, in the order they run.

    Args:
        steps: names and operations.
    """

    def __init__(self, steps: Sequence[tuple[str, str]]) -> None:
        self.steps = {name: StepState(name, operation) for name, operation in steps}
        self.notes: list[str] = []

    def take(self, event: ProgressEvent, now_s: float) -> None:
        """Takes an event.

        Args:
            event: what happened.
            now_s: when, on a clock that only runs forward.
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
            state.status, state.duration_s, state.detail = event.status, event.duration_s, event.detail


class Watcher(AbstractContextManager["Watcher"]):
    """A listener that shows what it hears while it is entered."""

    def __call__(self, event: ProgressEvent) -> None:
        """Takes one event; from any thread."""
        raise NotImplementedError
