"""Why a run or a job stops that did not come to its end by itself."""

from enum import StrEnum


class StopReason(StrEnum):
    """Why a job has to stop. Those of a batch are its jobs' failure codes."""

    CANCELED = "Canceled"
    """It was cancelled itself, or another worker has taken it over."""

    BATCH_CANCELED = "BatchCanceled"
    BATCH_TIMED_OUT = "BatchTimedOut"


class RunStop(StrEnum):
    """Why a run was ended from outside, in the words of `RunResult.ended_by`."""

    DURATION_LIMIT = "duration limit"
    CANCELED = "canceled"
