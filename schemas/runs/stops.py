"""Why a run or a job stops that did not come to its end by itself."""

from collections.abc import Mapping
from enum import StrEnum


class StopReason(StrEnum):
    """Why a job has to stop. Those of a batch are its jobs' failure codes."""

    CANCELED = "Canceled"
    """It was cancelled itself, or another worker has taken it over."""

    BATCH_CANCELED = "BatchCanceled"
    BATCH_TIMED_OUT = "BatchTimedOut"


STOPPING: Mapping[str, StopReason] = {
    "Canceling": StopReason.BATCH_CANCELED,
    "TimingOut": StopReason.BATCH_TIMED_OUT,
}
"""Why the jobs of a batch have to stop, by the batch's status."""

STOP_EVENTS: Mapping[str, str] = {StopReason.BATCH_CANCELED: "cancel", StopReason.BATCH_TIMED_OUT: "time_out"}
"""The event of the batch, by the reason; the keys are the failure codes of its jobs."""


class RunStop(StrEnum):
    """Why a run was ended from outside, in the words of `RunResult.ended_by`."""

    DURATION_LIMIT = "duration limit"
    CANCELED = "canceled"
