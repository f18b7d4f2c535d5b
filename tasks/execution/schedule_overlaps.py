"""Scheduled runs whose nights overlap, or were missed: one policy for every schedule.

One run of a deployment at a time: a night that is due while the last one runs waits for it. A night that begins too
late, since it waited so long or the machine slept, is skipped, so that several missed nights are made up for by one.
Prefect's other choice, to cancel what is due while another runs, would lose nights that were missed together: the
oldest would take the slot only to be skipped.
"""

from datetime import UTC, datetime, timedelta
from typing import Any

from prefect.client.schemas.objects import ConcurrencyLimitStrategy, ConcurrencyOptions, State
from prefect.context import FlowRunContext
from prefect.states import Cancelled

from ...schemas.settings import Settings

RUNS_AT_ONCE = 1
"""The `concurrency_limit` of every deployment that has a schedule."""

OVERLAP = ConcurrencyOptions(collision_strategy=ConcurrencyLimitStrategy.ENQUEUE)
"""The `concurrency_options` of every deployment that has a schedule."""


def skipped_night(settings: Settings, now: datetime | None = None) -> State[Any] | None:
    """The end of the current flow run, if a schedule made it and it begins too late; else None.

    Runs that somebody ordered are never too late.

    Args:
        settings: say how late is too late.
        now: the time; None: that of the clock.
    """
    context = FlowRunContext.get()
    run = context.flow_run if context is not None else None
    if run is None or not run.auto_scheduled or run.expected_start_time is None:
        return None
    late = (now or datetime.now(UTC)) - run.expected_start_time
    if late <= timedelta(hours=settings.max_late_hours):
        return None
    due, hours = f"{run.expected_start_time:%Y-%m-%d %H:%M} UTC", late.total_seconds() / 3600
    allowed = f"at most {settings.max_late_hours} h are allowed (ROBOMAKER_MAX_LATE_HOURS)"
    message = f"skipped: due at {due}, begun {hours:.1f} h later; {allowed}"
    return Cancelled(name="Skipped", message=message)
