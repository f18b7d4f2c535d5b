"""Progress events of a running pipeline.

Listeners are called from any thread, also several at once; they return quickly and never raise.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol, TypeAlias

from ..runs.programs import Wait
from ..runs.trials import TrialCounts

FINISHED = frozenset({"completed", "failed", "canceled", "terminated", "succeeded", "exported", "not created"})
"""States, in lower case, whose parts are done with."""


@dataclass(frozen=True)
class StepStarted:
    """A step began."""

    step: str
    operation: str


@dataclass(frozen=True)
class StepProgress:
    """Progress of the parts of a step: worlds of a generation job, jobs of a batch."""

    step: str
    counts: Mapping[str, int]
    """How many parts are in each state, by the state's name: `{"completed": 3, "running": 2}`."""

    total: int
    """How many parts there are in all; parts that `counts` leaves out wait."""

    newest_failure: str = ""
    """The latest failure in one line; empty when nothing failed yet."""

    waits_for: Wait | None = None
    """Resource that the next part waits for: one that the machine lacks, or a job worker elsewhere; None: nothing."""

    trials: TrialCounts | None = None
    """The trials of all parts; None: there are none."""


@dataclass(frozen=True)
class StepEnded:
    """A step reached its end, good or bad."""

    step: str
    status: str
    """The resource's terminal status, or `Completed` for quick operations."""

    duration_s: float
    detail: str = ""
    """The ARN it made, or the error."""


@dataclass(frozen=True)
class Note:
    """Something worth a line: the server was started, outputs were moved."""

    text: str


ProgressEvent: TypeAlias = StepStarted | StepProgress | StepEnded | Note


class ProgressListener(Protocol):
    """Takes events; thread-safe."""

    def __call__(self, event: ProgressEvent, /) -> None:
        """Takes one event."""
        ...
