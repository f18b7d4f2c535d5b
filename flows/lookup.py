"""Looks up the Prefect flow of a service operation by the operation's name."""

import logging
from collections.abc import Generator
from contextlib import contextmanager
from typing import Any

import httpx
from prefect import Flow
from prefect.context import SettingsContext, get_settings_context
from prefect.settings import PREFECT_API_URL

from ..schemas.lifecycles import is_terminal
from ..schemas.reports.run_states import FlowResult
from ..schemas.wire.errors import RobomakerError
from ..tasks.execution.flow_ends import answer_of
from ..tasks.inspection.job_standings import job_result
from ..tasks.operations.registry import registry
from ..tasks.service.service import Service
from . import operations

_logger = logging.getLogger(__name__)


class PrefectServerLostError(RobomakerError):
    """Raised when the Prefect server stops answering while a job is unfinished."""


def find_flow(operation: str) -> Flow[..., Any]:
    """Returns the Prefect flow of a service operation; its parameters are the request's members.

    Raises:
        KeyError: The service has no operation of that name.
    """
    return getattr(operations, registry()[operation].name)


def find_perform_flow(operation: str) -> Flow[..., Any]:
    """Returns the Prefect flow that runs stored jobs of an operation; its parameter is the job's ARN.

    Raises:
        KeyError: The service has no operation of that name.
    """
    return getattr(operations, registry()[operation].perform_name)


def perform(operation: str, arn: str) -> tuple[dict[str, Any], FlowResult]:
    """Runs a stored job to completion as a Prefect flow run.

    Args:
        operation: Operation that created the job.
        arn: ARN of the job.

    Returns:
        The job's final description, and how it ended.

    Raises:
        PrefectServerLostError: The Prefect server does not answer any more, and the job has not ended.
        BaseException: The flow failed with a programming error, or was interrupted, which cancelled the job.
    """
    try:
        with without_heartbeat():
            return answer_of(find_perform_flow(operation)(arn, return_state=True))
    except Exception as error:
        if not _is_unreachable(error):
            raise
        return _answer_without_prefect(operation, arn, error)


@contextmanager
def without_heartbeat() -> Generator[None]:
    """Turns off Prefect's heartbeat inside the `with` block, as every flow waits a second for it at its end.

    The settings are copied: `temporary_settings` of Prefect reads them all again, which takes 0.08 s of CPU time.
    If it is off already, as in the steps of a pipeline, nothing is changed.
    """
    context = get_settings_context()
    if context.settings.flows.heartbeat_frequency is None:
        yield
        return
    flows = context.settings.flows.model_copy(update={"heartbeat_frequency": None})
    settings = context.settings.model_copy(update={"flows": flows})
    with SettingsContext(profile=context.profile, settings=settings):
        yield


def _answer_without_prefect(operation: str, arn: str, error: Exception) -> tuple[dict[str, Any], FlowResult]:
    """Returns a job's final description and how it ended, from the catalog, as the Prefect server does not answer.

    Args:
        operation: Operation that created the job.
        arn: ARN of the job.
        error: Exception that showed that the server does not answer; the cause of the one raised here.

    Raises:
        PrefectServerLostError: The job has not ended; the message says how to go on with it.
    """
    service, url = Service.current(), PREFECT_API_URL.value()
    job = service.catalog.get(arn)
    if not is_terminal(job.kind, job.status):
        raise PrefectServerLostError(
            f"the Prefect server at {url} does not answer any more, and {arn} is {job.status}; once it answers again "
            f"(robomaker server status), go on with: robomaker perform {arn}"
        ) from error
    _logger.warning("the Prefect server at %s does not answer any more, and will not show how %s ended", url, job.id)
    answer = registry()[operation].described(arn, service)
    return answer, job_result(operation, answer, service)


def _is_unreachable(error: BaseException | None) -> bool:
    """Returns whether an exception means that a server does not answer; Prefect's client has several of them."""
    while error is not None:
        if isinstance(error, httpx.TransportError):
            return True
        error = error.__cause__ or error.__context__
    return False
