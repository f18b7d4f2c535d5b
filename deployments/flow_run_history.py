"""Deletes old flow runs of the local Prefect server through its API, with their task runs, logs and artifacts.

Only runs of this package's flows are deleted, and only on the server that this package started: other flows there, and
other servers, belong to somebody else. Unused space in its database is then returned to the system.
"""

import os
import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import datetime
from pathlib import Path
from typing import Any

from ..schemas.reports.retention import GcFlowRuns, RetentionPolicy
from ..schemas.settings import Settings
from ..tasks.operations.registry import flow_names
from ..tasks.service.service import Service
from .prefect_database import WORTH_BYTES, database_file, measure_database, prepare_database, shrink_database
from .prefect_server.local_server import ServerStatus, client_variables, server_status
from .prefect_server.secret import auth_string

_NO_PROFILE = {"PREFECT_PROFILES_PATH": os.devnull}
_PAGE = 50
"""Limit of the flow runs that Prefect deletes at once."""


def collect_flow_runs(settings: Settings, policy: RetentionPolicy, now: datetime, *, act: bool) -> GcFlowRuns:
    """Deletes old flow runs from the local Prefect server's database, and shrinks it.

    Args:
        settings: Settings of the data home with the local server.
        policy: Retention policy; without an age every flow run is kept.
        now: The time.
        act: Whether anything is changed.

    Returns:
        Number of flow runs, or the reason why none were examined; and the size of the database.
    """
    status = server_status(settings, _NO_PROFILE)
    told = _collect(settings, policy, now, status, act=act)
    path = database_file(settings)
    if not path.is_file():
        return told
    try:
        return _shrink(path, told, is_open=status.running or status.busy, act=act)
    except sqlite3.Error as error:
        return told.model_copy(update={"problem": told.problem or f"{path}: {error}"})


def collect_limits(settings: Settings, service: Service, *, act: bool) -> list[str]:
    """Deletes concurrency limits of finished batches from the local Prefect server.

    Args:
        settings: Settings of the data home with the local server.
        service: The service, with its catalog and object store.
        act: Whether anything is changed.

    Returns:
        Names of the limits.
    """
    status = server_status(settings, _NO_PROFILE)
    if not status.running:
        return []
    from prefect.client.orchestration import SyncPrefectClient

    from ..tasks.execution.batch_slots import batches_with_limits
    from .dead_run_sweeper import leftover_limits, remove_leftover_limits

    with SyncPrefectClient(str(status.api_url), auth_string=auth_string(settings)) as client:
        if act:
            return remove_leftover_limits(client, settings)
        return leftover_limits(batches_with_limits(client), service)


def _collect(
    settings: Settings, policy: RetentionPolicy, now: datetime, status: ServerStatus, *, act: bool
) -> GcFlowRuns:
    if policy.older_than is None:
        return GcFlowRuns(note="flow runs of Prefect go by age; --older-than was not given")
    if not status.running:
        return GcFlowRuns(note="the local Prefect server does not run, so its flow runs were not looked at")
    chosen = _filters(policy, now - policy.older_than)
    count = 0
    try:
        with _client(str(status.api_url), settings) as client:
            count = client.count_flow_runs(**chosen)
            if act:
                _remove(client, chosen)
    except Exception as error:  # whatever Prefect's client raises: what else was removed is told all the same
        return GcFlowRuns(count=count, problem=f"{type(error).__name__}: {error}")
    return GcFlowRuns(count=count)


def _shrink(path: Path, told: GcFlowRuns, *, is_open: bool, act: bool) -> GcFlowRuns:
    """Frees the unused disk space of Prefect's database (SQLite) if it is much, or only measures it if `act` is false.

    Returns the given answer with the size of the database and the freed space, in bytes.
    """
    before = measure_database(path)
    if before.free_bytes < WORTH_BYTES:
        return told.model_copy(update={"database_bytes": before.size_bytes})
    if not act:
        return told.model_copy(update={"database_bytes": before.size_bytes, "freed_bytes": before.free_bytes})
    if not is_open:
        prepare_database(path)
    shrink_database(path)
    after = measure_database(path)
    freed = max(0, before.size_bytes - after.size_bytes)
    return told.model_copy(update={"database_bytes": after.size_bytes, "freed_bytes": freed})


def _filters(policy: RetentionPolicy, before: datetime) -> dict[str, Any]:
    from prefect.client.schemas import filters
    from prefect.client.schemas.objects import TERMINAL_STATES, StateType
    from prefect.types import DateTime

    kept = {StateType.FAILED, StateType.CRASHED} if policy.keep_failures else set[StateType]()
    states = filters.FlowRunFilterStateType(any_=sorted(TERMINAL_STATES - kept))
    ended = filters.FlowRunFilterEndTime(before_=DateTime.fromisoformat(before.isoformat()))
    return {
        "flow_filter": filters.FlowFilter(name=filters.FlowFilterName(any_=sorted(flow_names()))),
        "flow_run_filter": filters.FlowRunFilter(state=filters.FlowRunFilterState(type=states), end_time=ended),
    }


def _remove(client: Any, chosen: dict[str, Any]) -> None:
    """Deletes the chosen flow runs page by page, and before them their artifacts, which could not be found afterwards.

    Raises an error if the server refuses a page; those before it stay deleted.
    """
    from prefect.client.schemas.filters import FlowRunFilter, FlowRunFilterId

    while runs := client.read_flow_runs(**chosen, limit=_PAGE):
        page = FlowRunFilter(id=FlowRunFilterId(any_=[run.id for run in runs]))
        while artifacts := client.read_artifacts(flow_run_filter=page):
            for artifact in artifacts:
                client.delete_artifact(artifact.id)
        body = {"flow_runs": page.model_dump(mode="json", exclude_unset=True), "limit": _PAGE}
        client.request("POST", "/flow_runs/bulk_delete", json=body).raise_for_status()


@contextmanager
def _client(api_url: str, settings: Settings) -> Iterator[Any]:
    from prefect.client.orchestration import get_client
    from prefect.settings import PREFECT_API_AUTH_STRING, PREFECT_API_URL, temporary_settings

    secret = client_variables(api_url, settings, _NO_PROFILE).get("PREFECT_API_AUTH_STRING")
    with (
        temporary_settings({PREFECT_API_URL: api_url, PREFECT_API_AUTH_STRING: secret}),
        get_client(sync_client=True) as client,
    ):
        yield client
