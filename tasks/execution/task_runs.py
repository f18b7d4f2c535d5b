"""A running job in Prefect's UI: its steps as task runs, and a state of its own while it waits for a person.

A run that waits has a state with a name of its own, whose type stays `RUNNING`: the run asks again and again, so that a
decision made anywhere reaches it, and one whose process dies is closed, and the job carried on, as usual.
"""

import logging
import sys
from collections.abc import Callable, Generator
from contextlib import contextmanager
from functools import cache
from typing import TYPE_CHECKING, Any, Protocol, TypeVar

from ..service.spans import span

if TYPE_CHECKING:
    from uuid import UUID

    from prefect import Task

Result = TypeVar("Result")


_logger = logging.getLogger(__name__)


class RunStep(Protocol):
    """Runs a step: `directly`, or `as_task`."""

    def __call__(self, name: str, part: Callable[[], Result], /) -> Result:
        """Runs a part of a job as the step `name` and returns what it returns."""
        ...


def directly(name: str, part: Callable[[], Result], /) -> Result:
    """Runs a step as a plain call: in a batch, where each job is one light task run already."""
    with span(name):
        return part()


def as_task(name: str, part: Callable[[], Result], /) -> Result:
    """Runs a step as a task run of the flow run that is under way."""
    with span(name):
        return _task(name)(part)


def step_runner() -> RunStep:
    """Returns how steps are run here: as tasks inside a flow run, directly elsewhere."""
    return directly if _flow_run() is None else as_task


@contextmanager
def shown_as(name: str, message: str) -> Generator[None]:
    """Gives the state of the running flow a name inside the block.

    Args:
        name: the name, such as `AwaitingApproval`.
        message: what a person can do.
    """
    run = _flow_run()
    if run is None:
        yield
        return
    _set_name("Running", name, run, message)
    try:
        yield
    finally:
        _set_name(name, "Running", run)


def show_note(key: str, markdown: str) -> None:
    """Keeps a note as an artifact of the running flow; those of the same key are its history."""
    if _flow_run() is not None:
        from .artifacts import show_text

        show_text(key, markdown, "What the job waits for")


def _flow_run() -> "UUID | None":
    context = sys.modules.get("prefect.context")  # without Prefect there is no flow run, and importing it takes seconds
    found = None if context is None else context.FlowRunContext.get()
    return None if found is None or found.flow_run is None else found.flow_run.id


def _set_name(before: str, after: str, run: "UUID", message: str | None = None) -> None:
    """Renames the state, unless it has another meanwhile: a run that is being cancelled stays so."""
    import httpx
    from prefect.client.orchestration import get_client
    from prefect.exceptions import PrefectException
    from prefect.states import Running

    try:
        with get_client(sync_client=True) as client:
            state = client.read_flow_run(run).state
            if state is not None and state.name == before:
                client.set_flow_run_state(run, Running(name=after, message=message), force=True)
    except (httpx.HTTPError, PrefectException, RuntimeError) as error:
        _logger.warning("Prefect cannot be told that the run is %s: %s", after, error)


@cache
def _task(name: str) -> "Task[..., Any]":
    from prefect import task
    from prefect.cache_policies import NO_CACHE

    @task(name=name, cache_policy=NO_CACHE)
    def run(part: Callable[[], Result]) -> Result:
        return part()

    return run
