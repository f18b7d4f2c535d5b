"""Prefect tasks of operation flows, and how the flows use them.

Prefect shows the tasks of a flow run by name. Operations that write have the tasks `validate` and `record`; those that
create a job also have its steps (`prepare`, `simulate`, `upload`; `generate-world`; `export`). Operations that only
read have no tasks.
"""

import logging
from collections.abc import Mapping
from contextlib import suppress
from typing import Any

import httpx
from prefect import task
from prefect.cache_policies import NO_CACHE
from prefect.client.orchestration import get_client
from prefect.context import FlowRunContext
from prefect.exceptions import PrefectException
from prefect.runtime import flow_run

from ..schemas.job_owners import NeededEnvironment
from ..schemas.wire.base import Shape
from ..schemas.wire.errors import ServiceUnavailableException
from ..tasks.execution.flow_ends import end_state, ends_as_cancelled
from ..tasks.execution.leases.catalog_outages import CatalogWait
from ..tasks.execution.leases.held_leases import died_here
from ..tasks.execution.prefect_artifacts import shown_progress
from ..tasks.execution.run_watch import watched_run
from ..tasks.inspection.job_standings import job_result
from ..tasks.jobs.job_owners import OwnOrder, needs_elsewhere
from ..tasks.operations.registry import registry
from ..tasks.service.service import Service

_logger = logging.getLogger(__name__)


@task(name="validate", cache_policy=NO_CACHE)
def validate(operation: str, members: Mapping[str, Any]) -> Shape:
    """Checks the members of a request; those that are `None` count as absent.

    Raises:
        ServiceError: The request is refused.
    """
    return registry()[operation].checked(_present(members), Service.current())


@task(name="record", cache_policy=NO_CACHE)
def record(operation: str, request: Shape) -> dict[str, Any]:
    """Stores a checked request in the catalog, and returns the response; a job is `Pending` then.

    Raises:
        ServiceError: The request is refused; nothing was stored.
    """
    return registry()[operation].handle(request, Service.current())


def order(operation: str, members: Mapping[str, Any]) -> Any:
    """Creates a job and runs it to completion in this flow; no other process can take the job meanwhile.

    Returns:
        As `carry_out`.

    Raises:
        ServiceError: The request is refused; nothing was stored.
    """
    request, service = validate(operation, members), Service.current()
    with OwnOrder(service) as own:
        with own.through(operation, request.to_wire()).activated():
            job = record(operation, request)
        own.keep(job["arn"])
        return carry_out(operation, job["arn"])


def read(operation: str, members: Mapping[str, Any]) -> dict[str, Any]:
    """Performs a request that changes nothing, and returns the response.

    Raises:
        ServiceError: The request is refused.
    """
    return registry()[operation].answer(_present(members), Service.current())


def carry_out(operation: str, arn: str) -> Any:
    """Runs a stored job to completion, with its steps as Prefect tasks and its progress in Prefect's UI.

    Returns:
        The final Prefect state of the flow. If it is successful, the flow returns the job's final description with a
        `FlowResult` as `result`; otherwise it raises `RunNotSucceeded`, which has both.
    """
    service = Service.current()
    _name_run_after(arn)
    _warn_of_environment(arn, service)
    with (
        ends_as_cancelled(),
        watched_run(service.catalog, lambda: _cancel(arn, service)),
        shown_progress(service, f"{operation}: {arn}") as watched,
        watched.activated(),
    ):
        answer = registry()[operation].perform(arn, watched)
    wait = CatalogWait(arn, lambda: service.catalog.standing(arn), lambda: False, service.timing.after_outage_s)
    result = wait.outlasting(lambda: job_result(operation, answer, service))
    return end_state(result, answer, verdict_fails_run=service.settings.verdict_fails_run)


def _warn_of_environment(arn: str, service: Service) -> None:
    """Logs a warning if a job that may be continued here was created for another environment; it goes on all the same.

    Nothing is logged if the catalog does not answer, or another process runs the job.
    """
    with suppress(ServiceUnavailableException):
        ownership = service.catalog.ownerships([arn]).get(arn)
        if ownership is None or (ownership.is_held and not died_here(ownership.owner or "")):
            return
        if differences := needs_elsewhere(ownership.needed_environment, service):
            command = NeededEnvironment.of_stored(ownership.needed_environment or {}).command(arn)
            _logger.warning(
                "%s was ordered in another environment, and goes on in this one: %s; as it was ordered: %s",
                arn.rpartition("/")[2],
                "; ".join(differences),
                command,
            )


def _cancel(arn: str, service: Service) -> None:
    """Cancels a job whose flow run was cancelled in Prefect."""
    service.catalog.request_cancel(arn)


def _present(members: Mapping[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in members.items() if value is not None}


def job_id() -> str:
    """Returns the name of a flow run that runs a job: the id at the end of the job's ARN."""
    return str(flow_run.parameters["arn"]).rsplit("/", 1)[-1]


def _name_run_after(arn: str) -> None:
    """Names a subflow run after the job that it has created, as there is no job id when the flow run begins.

    Flow runs that are named by the caller, or that are no subflows, keep their name.
    """
    context = FlowRunContext.get()
    if context is None or context.flow_run is None or context.flow_run.parent_task_run_id is None:
        return
    if context.flow is None or context.flow.flow_run_name is not None:
        return
    try:
        with get_client(sync_client=True) as client:
            client.update_flow_run(context.flow_run.id, name=arn.rsplit("/", 1)[-1])
    except (httpx.HTTPError, PrefectException) as error:
        _logger.warning("the flow run of %s keeps a name of chance: %s", arn, error)
