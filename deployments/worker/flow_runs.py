"""Marks flow runs whose worker has died as crashed, as Prefect would show them as running for ever."""

import logging
from collections.abc import Iterable

import httpx
from prefect.client.orchestration import get_client
from prefect.client.schemas.filters import (
    FlowRunFilter,
    FlowRunFilterName,
    FlowRunFilterState,
    FlowRunFilterStateType,
)
from prefect.client.schemas.objects import StateType
from prefect.exceptions import PrefectException
from prefect.states import Crashed

_logger = logging.getLogger(__name__)


def mark_crashed(job_ids: Iterable[str], message: str) -> None:
    """Marks the flow runs of some jobs as crashed in Prefect; a failure to do so is only logged.

    Args:
        job_ids: Ids of the jobs, which are the names of their flow runs.
        message: Why they have ended.
    """
    names = list(job_ids)
    if not names:
        return
    active = FlowRunFilterState(type=FlowRunFilterStateType(any_=[StateType.PENDING, StateType.RUNNING]))
    try:
        with get_client(sync_client=True) as client:
            runs = client.read_flow_runs(
                flow_run_filter=FlowRunFilter(name=FlowRunFilterName(any_=names), state=active)
            )
            for run in runs:
                client.set_flow_run_state(run.id, Crashed(message=message), force=True)
    except (httpx.HTTPError, PrefectException) as error:
        _logger.warning("Prefect is not told that runs have ended: %s", error)
