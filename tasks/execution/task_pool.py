"""Runs parts of a job in threads, as Prefect task runs, and ends them when the job worker has to end."""

import concurrent.futures
import contextvars
import logging
import sys
import time
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import contextmanager, suppress
from functools import cache
from typing import TYPE_CHECKING, Any, Protocol, TypeVar

from ...schemas.wire.errors import ServiceUnavailableException
from ..service.service import Service
from ..service.spans import span

if TYPE_CHECKING:
    from uuid import UUID

    from prefect import Task

    from .mapped_runs import MapTaskRunner


_logger = logging.getLogger(__name__)

_LOOK_S = 0.25


def run_tasks(
    name: str,
    part: Callable[..., None],
    calls: Sequence[Mapping[str, Any]],
    *,
    run_name: str,
    workers: int,
    job_arn: str,
    service: Service,
    look: Callable[[], bool | None] = lambda: None,
    summary: Callable[[], str] | None = None,
) -> None:
    """Runs part of a job once for each argument set, in threads, as Prefect task runs; waits for all of them.

    An interruption (Ctrl-C, a signal) requests the job's cancellation.

    Args:
        name: Name of the task in Prefect.
        part: Watches for a cancel request of the job, and ends soon after one.
        calls: Arguments of each call.
        run_name: Name of each task run; arguments in braces stand for their values.
        workers: Number of calls that run at once.
        job_arn: The job that they are parts of.
        service: The service, with its catalog and object store.
        look: Polled several times a second meanwhile, and once after an interruption, in the calling thread; once it
            returns true, calls that have not begun are left out.
        summary: Makes it one task run, and says at its end how the calls went; `None`: a task run for each call.

    Raises:
        BaseException: The first task's error, once all tasks have ended, or the interruption.
    """
    from prefect import task
    from prefect.cache_policies import NO_CACHE

    from .mapped_runs import MapTaskRunner

    parts: Any = task(name=name, task_run_name=run_name, cache_policy=NO_CACHE, persist_result=False)(part)

    with service.activated(), MapTaskRunner[None](workers, lambda _: summary() if summary else "") as runner:
        try:
            futures = _begin(runner, parts, calls, as_one=summary is not None)
            waiting: set[concurrent.futures.Future[Any]] = {future.wrapped_future for future in futures}
            while waiting:
                if look():
                    for future in waiting:
                        future.cancel()
                # Prefect's own `future.state` asks the server, for each future each time.
                waiting = concurrent.futures.wait(waiting, timeout=_LOOK_S).not_done
        except Exception:
            raise
        except BaseException:  # Ctrl-C, or a worker's termination signal
            _request_cancel(job_arn, service)
            with suppress(ServiceUnavailableException):  # what is to be seen now is seen when it is run again
                look()
            raise
    for future in futures:
        if not future.wrapped_future.cancelled():
            future.result()


def _begin(runner: "MapTaskRunner[None]", part: Any, calls: Sequence[Mapping[str, Any]], *, as_one: bool) -> list[Any]:
    if as_one:
        return runner.map(part, {name: [call[name] for call in calls] for name in calls[0]})
    return [runner.submit(part, dict(call)) for call in calls]


def run_alone(work: Callable[[], None], *, job_arn: str, service: Service) -> None:
    """Runs a job that has a single part in a thread, and waits for it.

    An interruption (Ctrl-C, a signal) requests the job's cancellation.

    Args:
        work: Watches for a cancel request of the job, and ends soon after one.
        job_arn: The job.
        service: The service, with its catalog and object store.

    Raises:
        BaseException: What `work` raised, or the interruption, once it has ended.
    """
    with service.activated(), concurrent.futures.ThreadPoolExecutor(max_workers=1) as pool:
        future = pool.submit(contextvars.copy_context().run, work)
        try:
            concurrent.futures.wait([future])
        except BaseException:  # Ctrl-C, or a worker's termination signal
            _request_cancel(job_arn, service)
            raise
    future.result()


def _request_cancel(job_arn: str, service: Service) -> None:
    """Requests a job's cancellation, repeatedly until the catalog answers or another interruption comes."""
    while True:
        try:
            service.catalog.request_cancel(job_arn)
        except ServiceUnavailableException as error:
            _logger.warning("%s is cancelled as soon as the catalog answers: %s", job_arn, error)
            time.sleep(service.timing.after_outage_s)
        else:
            return


Result = TypeVar("Result")


class RunStep(Protocol):
    """Interface of a function that runs a part of a job as a step: as a plain call or as a Prefect task run."""

    def __call__(self, name: str, part: Callable[[], Result], /) -> Result:
        """Runs a part of a job as a step with that name, and returns the part's result."""
        ...


def directly(name: str, part: Callable[[], Result], /) -> Result:
    """Runs a part of a job as a plain function call, and returns its result; for jobs that have a task run already."""
    with span(name):
        return part()


def as_task(name: str, part: Callable[[], Result], /) -> Result:
    """Runs a part of a job as a Prefect task run of the current flow run, named as the step, and returns its result."""
    with span(name):
        return _task(name)(part)


def step_runner() -> RunStep:
    """Returns the function that runs steps here: `as_task` inside a flow run, else `directly`."""
    return directly if current_flow_run() is None else as_task


@contextmanager
def shown_as(name: str, message: str) -> Generator[None]:
    """Gives the running flow's Prefect state a name inside the `with` block, such as `AwaitingApproval`.

    Does nothing outside a flow.

    Args:
        name: The name, such as `AwaitingApproval`.
        message: Text for the user.
    """
    run = current_flow_run()
    if run is None:
        yield
        return
    _set_name("Running", name, run, message)
    try:
        yield
    finally:
        _set_name(name, "Running", run)


def show_note(key: str, markdown: str) -> None:
    """Stores a note as a Markdown artifact of the running flow; notes of the same key form a history.

    Does nothing outside a flow run.
    """
    if current_flow_run() is not None:
        from .prefect_artifacts import show_text

        show_text(key, markdown, "What the job waits for")


def current_flow_run() -> "UUID | None":
    """Returns the id of the Prefect flow run that this code runs in, without importing Prefect; `None` outside one."""
    context = sys.modules.get("prefect.context")  # without Prefect there is no flow run, and importing it takes seconds
    found = None if context is None else context.FlowRunContext.get()
    return None if found is None or found.flow_run is None else found.flow_run.id


def _set_name(before: str, after: str, run: "UUID", message: str | None = None) -> None:
    """Renames a flow or task run's state in Prefect, if it is still named `before`.

    A Prefect server that does not answer is logged, and raises nothing.

    Args:
        before: Present name of the state.
        after: New name; the state's type becomes running.
        run: Id of the flow run.
        message: Text of the state.
    """
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
