"""Progress events of a running pipeline.

Listeners are called from any thread, also several at a time; they return quickly and never raise.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Protocol, TypeAlias

from ..runs.programs import Wait
from ..runs.trials import TrialCounts
from ..wire.common import passed_of
from .run_record import CaseOutcome

FINISHED = frozenset(
    {
        *("completed", "passed", "failed", "broken", "no verdict", "canceled", "terminated"),
        *("succeeded", "taken over", "exported", "not created"),
    }
)
"""States, in lower case, of parts that are finished."""

_ORDER: tuple[CaseOutcome, ...] = ("passed", "failed", "broken", "canceled", "unfinished", "no verdict")


@dataclass(frozen=True)
class StepStarted:
    """Progress event: a step of a specification began."""

    step: str
    operation: str


@dataclass(frozen=True)
class StepProgress:
    """Progress event: numbers of finished worlds of a generation job, or of finished jobs of a batch."""

    step: str
    counts: Mapping[str, int]
    """Numbers of parts by state: `{"completed": 3, "running": 2}`."""

    total: int
    """Number of all parts; those that `counts` does not include are waiting."""

    newest_failure: str = ""
    """Latest failure in one line; empty if there is none."""

    waits_for: Wait | None = None
    """Resource for which the next part waits: one of this machine, or a job worker elsewhere; None: it does not wait.
    """

    trials: TrialCounts | None = None
    """Numbers of trials of all parts by verdict; None: there are no trials."""


@dataclass(frozen=True)
class StepEnded:
    """Progress event: a step of a specification ended, successfully or not."""

    step: str
    status: str
    """Final status of the resource, or `Completed` for short operations."""

    duration_s: float
    detail: str = ""
    """ARN of the created resource, or the error."""

    outcomes: Mapping[CaseOutcome, int] = field(default_factory=dict[CaseOutcome, int])
    """Numbers of the step's simulation jobs by outcome: `{"passed": 3, "failed": 1}`; empty: it has none."""

    may_be_known: bool = False
    """Whether the specification names known failures: the end of the run tells whether these jobs' are among them."""

    @property
    def in_words(self) -> str:
        """Ending of a step in words: `1 passed, 1 failed` of a step with jobs that completed, else its status."""
        counts = ", ".join(f"{self.outcomes[each]} {each}" for each in _ORDER if self.outcomes.get(each))
        return counts if counts and self.status == "Completed" else ", ".join(filter(None, (self.status, counts)))

    @property
    def in_log(self) -> str:
        """Ending of a step for a log: `0 of 6 jobs passed: ARN` if it has jobs, else its status with ARN or error."""
        total = sum(self.outcomes.values())
        passed = passed_of(self.outcomes.get("passed", 0), total, "job") if total else ""
        status = "" if passed and self.status == "Completed" else self.status
        return ": ".join(filter(None, (", ".join(filter(None, (status, passed))), self.detail)))


@dataclass(frozen=True)
class Note:
    """Progress event: a message for the user, such as that the server was started or outputs were moved."""

    text: str


ProgressEvent: TypeAlias = StepStarted | StepProgress | StepEnded | Note


class ProgressListener(Protocol):
    """Interface of a function that receives progress events of a run; it has to be thread-safe."""

    def __call__(self, event: ProgressEvent, /) -> None:
        """Receives one progress event."""
        ...
