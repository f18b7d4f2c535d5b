"""Policy for scheduled runs that begin too late: they are skipped.

A night is late if it waited for the last one, or if the machine slept. So several missed nights are made up for by one.
"""

from datetime import UTC, datetime, timedelta
from typing import Any

from prefect.client.schemas.objects import State
from prefect.context import FlowRunContext
from prefect.states import Cancelled

from ...schemas.settings import Settings


def skipped_night(settings: Settings) -> State[Any] | None:
    """Returns the end state for a scheduled flow run that starts too late and is skipped; `None` if it may run.

    Runs that somebody ordered are never too late.

    Args:
        settings: Say how late is too late.
    """
    context = FlowRunContext.get()
    run = context.flow_run if context is not None else None
    if run is None or not run.auto_scheduled or run.expected_start_time is None:
        return None
    late = datetime.now(UTC) - run.expected_start_time
    if late <= timedelta(hours=settings.max_late_hours):
        return None
    due, hours = f"{run.expected_start_time:%Y-%m-%d %H:%M} UTC", late.total_seconds() / 3600
    allowed = f"at most {settings.max_late_hours} h are allowed (ROBOMAKER_MAX_LATE_HOURS)"
    message = f"skipped: due at {due}, begun {hours:.1f} h later; {allowed}"
    return Cancelled(name="Skipped", message=message)
