"""Finds scheduled nights in Prefect that did not happen, records them in the data home, and sends notifications."""

import logging
from collections.abc import Iterator, Mapping
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import cast
from uuid import UUID

from prefect.client.orchestration import SyncPrefectClient
from prefect.client.schemas.filters import (
    DeploymentFilter,
    DeploymentFilterId,
    FlowFilter,
    FlowFilterName,
    FlowRunFilter,
    FlowRunFilterStartTime,
)
from prefect.client.schemas.objects import FlowRun, StateType, WorkPoolStatus
from prefect.client.schemas.responses import DeploymentResponse
from prefect.client.schemas.sorting import FlowRunSort
from prefect.exceptions import ObjectNotFound
from prefect.settings import get_current_settings

from ..schemas.reports.history import NightSchedule
from ..schemas.settings import Settings
from ..schemas.specs.check import load_spec
from ..schemas.wire.errors import RobomakerError
from ..tasks.execution.prefect_settings import asking_once
from ..tasks.nights.missed_nights import (
    DueRun,
    booted_at,
    forget_schedule,
    has_run,
    judged,
    message_of_missed,
    only_one,
    schedules_of,
    store_schedule,
    tell_of_missed,
)
from .prefect_server.local_server import is_own_server

_FLOW = "RunPipeline"
_FIRST_LOOK = timedelta(days=7)
"""Time back in which nights of a deployment without runs are judged, as shown by `doctor` and notifications."""

_PAGE = 200
"""Limit of the flow runs that Prefect returns at once: with a night each day it is more than half a year."""

_logger = logging.getLogger(__name__)


def look_for_missed_nights(settings: Settings, now: datetime | None = None) -> None:
    """Checks which scheduled runs did not happen since the last check, and sends notifications.

    Without a server in Prefect's settings nothing is looked at.

    Args:
        settings: Settings of this process.
        now: The time; `None`: that of the clock.
    """
    if get_current_settings().api.url is None:
        return  # a server of its own, which Prefect would start to be asked, knows of no night
    with only_one(settings.home) as may_look:
        if not may_look:
            return
        now = now or datetime.now(UTC)
        with asking_once() as client:
            for schedule in [*schedules_of(settings.home), *_never_begun(settings, client, now)]:
                found = looked_at(schedule, settings, client, now)
                if found is None:
                    forget_schedule(settings.home, schedule)
                else:  # also one that is the same: it may be new here
                    store_schedule(settings.home, found)
                    _tell(schedule, found, settings)


def without_worker(settings: Settings) -> list[tuple[str, str]]:
    """Lists specifications that are scheduled in a work pool without a ready Prefect worker, each with the pool's name.

    Deployments that were deleted are left out.
    """
    found: list[tuple[str, str]] = []
    with asking_once() as client:
        for schedule in schedules_of(settings.home):
            try:
                pool = client.read_deployment(UUID(schedule.deployment)).work_pool_name
            except ObjectNotFound:
                continue
            if pool is not None and client.read_work_pool(pool).status is not WorkPoolStatus.READY:
                found.append((schedule.name, pool))
    return found


def _never_begun(settings: Settings, client: SyncPrefectClient, now: datetime) -> Iterator[NightSchedule]:
    """Yields schedules of this data home's deployments of which no run has ever begun.

    A run that begins records its deployment itself.
    """
    known = {each.deployment for each in schedules_of(settings.home)}
    ours = FlowFilter(name=FlowFilterName(any_=[_FLOW]))
    offset = 0
    while page := client.read_deployments(flow_filter=ours, limit=_PAGE, offset=offset):
        offset += len(page)
        for each in page:
            if (
                str(each.id) not in known
                and each.schedules
                and _is_of_home(each, str(client.api_url).rstrip("/"), settings)
            ):
                begun = client.read_flow_runs(
                    deployment_filter=DeploymentFilter(id=DeploymentFilterId(any_=[each.id])),
                    flow_run_filter=FlowRunFilter(start_time=FlowRunFilterStartTime(is_null_=False)),
                    limit=1,
                )
                if not begun:
                    since = max(each.created or now, now - _FIRST_LOOK)
                    yield NightSchedule(deployment=str(each.id), name=_name_of_spec(each), checked_until=since)


def _is_of_home(deployment: DeploymentResponse, server: str, settings: Settings) -> bool:
    """Whether runs of a deployment use this data home.

    It names the home, or names none and is on the home's own server.
    """
    environ = deployment.job_variables.get("env")
    named = cast("Mapping[str, object]", environ).get("ROBOMAKER_HOME") if isinstance(environ, Mapping) else None
    return Path(str(named)) == settings.home if named else is_own_server(server, settings)


def _name_of_spec(deployment: DeploymentResponse) -> str:
    """Returns the name of a deployment's specification.

    It is the deployment's name if the specification cannot be read here.
    """
    text, path = deployment.parameters.get("text"), deployment.parameters.get("spec")
    try:
        text = Path(str(path)).read_text() if path else str(text)
        return load_spec(text, str(path or deployment.name), is_complete=False).name
    except (OSError, ValueError, RobomakerError):
        return deployment.name


def looked_at(
    schedule: NightSchedule, settings: Settings, client: SyncPrefectClient, now: datetime
) -> NightSchedule | None:
    """Updates the record of a schedule from Prefect; `None` if the deployment or schedule was deleted."""
    try:
        deployment = client.read_deployment(UUID(schedule.deployment))
    except ObjectNotFound:
        return None
    if not deployment.schedules:
        return None
    return judged(
        schedule,
        _runs(schedule, settings, client),
        is_paused=bool(deployment.paused) or not any(each.active for each in deployment.schedules),
        now=now,
        max_late=timedelta(hours=settings.max_late_hours),
        booted_at=booted_at(),
    )


def _runs(schedule: NightSchedule, settings: Settings, client: SyncPrefectClient) -> Mapping[datetime, DueRun]:
    """Returns the flow runs for the schedule's times since the last check, and for the next ones."""
    found = client.read_flow_runs(
        deployment_filter=DeploymentFilter.model_validate({"id": {"any_": [schedule.deployment]}}),
        flow_run_filter=FlowRunFilter.model_validate({"expected_start_time": {"after_": schedule.checked_until}}),
        sort=FlowRunSort.EXPECTED_START_TIME_ASC,
        limit=_PAGE,
    )
    return {
        run.expected_start_time.astimezone(UTC): DueRun(
            run.state.type.value, run.state.name or "", run.state.message or "", _has_begun(run, schedule, settings)
        )
        for run in found
        if run.auto_scheduled and run.expected_start_time is not None and run.state is not None
    }


def _has_begun(run: FlowRun, schedule: NightSchedule, settings: Settings) -> bool:
    """Whether a flow run began, and has a run in the data home if its process died or it failed.

    One that fails before its code is called, as when a package is missing, has none.
    """
    if run.start_time is None or run.state is None:
        return False
    may_have_none = run.state.type in (StateType.CRASHED, StateType.FAILED)
    return not may_have_none or has_run(settings.home, schedule.name, run.start_time, run.state.timestamp)


def _tell(before: NightSchedule, found: NightSchedule, settings: Settings) -> None:
    if (message := message_of_missed(before, found)) is None:
        return
    _logger.warning("%s", message.title)
    for problem in tell_of_missed(settings, message):
        _logger.warning("not notified: %s", problem)
