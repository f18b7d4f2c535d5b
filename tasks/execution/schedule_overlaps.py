"""Policy for scheduled runs that overlap: one run of a deployment at a time, the earliest first.

A night that is due while the last one runs waits for it, and is skipped if it then begins too late (`late_nights`).
Prefect's alternative, cancelling a run that is due while another runs, would lose nights that were missed together: the
oldest would take the slot only to be skipped.

Prefect gives a free slot to whichever waiting run asks first, so that a later night might begin before an earlier one.
So a run that began before an earlier one gives its slot back and waits again.
"""

import logging
from datetime import UTC, datetime, timedelta
from typing import Any
from uuid import UUID

import httpx
from prefect.client.schemas.filters import (
    DeploymentFilter,
    DeploymentFilterId,
    FlowRunFilter,
    FlowRunFilterNextScheduledStartTime,
    FlowRunFilterState,
    FlowRunFilterStateName,
)
from prefect.client.schemas.objects import ConcurrencyLimitStrategy, ConcurrencyOptions, FlowRun, State, StateType
from prefect.client.schemas.sorting import FlowRunSort
from prefect.context import FlowRunContext
from prefect.exceptions import Pause, PrefectException
from prefect.states import AwaitingConcurrencySlot

from .prefect_settings import asking_once

RUNS_AT_ONCE = 1
"""Value of `concurrency_limit` for every deployment with a schedule."""

OVERLAP = ConcurrencyOptions(collision_strategy=ConcurrencyLimitStrategy.ENQUEUE)
"""Value of `concurrency_options` for every deployment with a schedule."""

_GONE_AFTER = timedelta(seconds=90)
"""Time that a waiting run's next attempt may be overdue before it counts as gone.

A worker tries within 15 s, on a busy machine later. A run that is not tried for longer has no worker, or its queue is
paused; other runs do not wait for it.
"""

_AFTER_IT = timedelta(seconds=30)
"""Delay of the later run after the next attempt of the earlier one; workers try up to 10 s before the time."""

_MOST_TRIES = 20
"""Limit on how many times a run gives way: an earlier one is tried every two minutes, so 40 minutes."""

_WAITS = "AwaitingConcurrencySlot"
"""Name of the state of runs that wait for a slot; Prefect keeps such runs when a deployment is changed."""

_logger = logging.getLogger(__name__)


def give_way_to_earlier(continues: str | None = None) -> None:
    """Reschedules the current flow run and ends this process if an earlier run of its deployment still waits.

    A run goes before another of its deployment if it was due earlier, or if it continues one whose process died. If
    Prefect does not answer, that is logged, and the run begins.

    Args:
        continues: Id of the run that this one continues; such a run gives way to none.

    Raises:
        Pause: The run waits again; Prefect ends the process, with exit code 0.
    """
    context, now = FlowRunContext.get(), datetime.now(UTC)
    run = context.flow_run if context is not None else None
    if run is None or run.deployment_id is None or continues is not None or run.run_count > _MOST_TRIES:
        return
    try:
        if not (earlier := _waiting_before(run, run.deployment_id, now)):
            return
        tried_at = max(each.next_scheduled_start_time or now for each in earlier)
        names = ", ".join(each.name for each in earlier)
        state: State[Any] = AwaitingConcurrencySlot(scheduled_time=max(tried_at, now) + _AFTER_IT)
        state.message = f"waits until the runs before it have begun: {names}"
        with asking_once() as client:
            # By force: what Prefect's rules say of places is done then, too, and no rule asks for anything else.
            result = client.set_flow_run_state(run.id, state, force=True)
    except (httpx.HTTPError, PrefectException, RuntimeError) as error:
        # Prefect's client raises RuntimeError when it cannot reach the server. A night in a wrong order is better than
        # none.
        _logger.warning("it is not known whether earlier runs wait, so this one begins: %s", error)
        return
    _logger.info("%s", state.message)
    raise Pause(state=result.state or state)


def _waiting_before(run: FlowRun, deployment: UUID, now: datetime) -> list[FlowRun]:
    """Returns the waiting runs of the same deployment that come before a run, and that a worker tries to start.

    These were due earlier, or continue another run.
    """
    tried = FlowRunFilterNextScheduledStartTime.model_validate({"after_": now - _GONE_AFTER})
    waits = FlowRunFilterState(name=FlowRunFilterStateName(any_=[_WAITS]))
    with asking_once() as client:
        found = client.read_flow_runs(
            deployment_filter=DeploymentFilter(id=DeploymentFilterId(any_=[deployment])),
            flow_run_filter=FlowRunFilter(next_scheduled_start_time=tried, state=waits),
            sort=FlowRunSort.EXPECTED_START_TIME_ASC,
        )
    return [
        each
        for each in found
        if each.id != run.id
        and each.state is not None
        and each.state.type is StateType.SCHEDULED
        and (each.parameters.get("continues") is not None or _place_in_line(each) < _place_in_line(run))
    ]


def _place_in_line(run: FlowRun) -> tuple[datetime, str]:
    """Returns a run's sort key: when it was due, then its id, so that two that were due together have a fixed order."""
    return (run.expected_start_time or datetime.max.replace(tzinfo=UTC), str(run.id))
