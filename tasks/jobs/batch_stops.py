"""Why the jobs of a batch have to end: because it is cancelled, or its time is over."""

from collections.abc import Mapping

from ...schemas.runs.stops import StopReason

STOPPING: Mapping[str, StopReason] = {
    "Canceling": StopReason.BATCH_CANCELED,
    "TimingOut": StopReason.BATCH_TIMED_OUT,
}
"""The reason, by the batch's status."""

STOP_EVENTS: Mapping[str, str] = {StopReason.BATCH_CANCELED: "cancel", StopReason.BATCH_TIMED_OUT: "time_out"}
"""What happens to the batch, by the reason; the keys are the failure codes of its jobs."""
