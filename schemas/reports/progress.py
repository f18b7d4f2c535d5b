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
    """Progress event: a step of a specification began."""

    step: str
    operation: str


@dataclass(frozen=True)
class StepProgress:
    """Progress event: how many worlds of a generation job, or jobs of a batch, are done."""

    step: str
    counts: Mapping[str, int]
    """Numbers of parts by state: `{"completed": 3, "running": 2}`."""

    total: int
    """Number of all parts; parts that `counts` leaves out wait."""

    newest_failure: str = ""
    """The latest failure in one line; empty when nothing failed yet."""

    waits_for: Wait | None = None
    """Resource that the next part waits for: one that the machine lacks, or a job worker elsewhere; None: nothing."""

    trials: TrialCounts | None = None
    """The trials of all parts; None: there are none."""


@dataclass(frozen=True)
class StepEnded:
    """Progress event: a step of a specification ended, successfully or not."""

    step: str
    status: str
    """The resource's terminal status, or `Completed` for quick operations."""

    duration_s: float
    detail: str = ""
    """The ARN it made, or the error."""


@dataclass(frozen=True)
class Note:
    """Progress event: a message for the user, such as that the server was started or outputs were moved."""

    text: str


ProgressEvent: TypeAlias = StepStarted | StepProgress | StepEnded | Note


class ProgressListener(Protocol):
    """Interface of a function that receives progress events of a run; it has to be thread-safe."""

    def __call__(self, event: ProgressEvent, /) -> None:
        """Takes one event."""
        ...
