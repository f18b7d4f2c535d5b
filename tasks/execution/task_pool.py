"""Runs a job's parts as Prefect tasks in threads, and ends them when the job worker has to end.

When a flow run is cancelled or Ctrl-C is pressed, only the main thread is interrupted, not tasks in other threads.
So an interruption stores a cancel request in the catalog, which the tasks watch for. The interruption is raised once
they have ended.
"""

import concurrent.futures
import contextvars
import logging
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from typing import TYPE_CHECKING, Any

from ...schemas.wire.errors import ServiceUnavailableException
from ..service.service import Service

if TYPE_CHECKING:
    from .mapping.runner import MapTaskRunner

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
    """Runs a part of a job once for each call, as a task run each or as one for all, and waits for all of them.

    Args:
        name: what Prefect shows as the name of the task.
        part: watches for a cancel request of the job, and ends soon after one.
        calls: its arguments.
        run_name: name of each task run; arguments in braces stand for their values.
        workers: how many run at once.
        job_arn: the job that they are parts of.
        service: where the job is stored.
        look: called several times a second meanwhile, and once after an interruption, in the calling thread; once it
            says true, calls that have not begun are left out.
        summary: makes it one task run, and says at its end how the calls went; `None`: a task run for each call.

    Raises:
        BaseException: what the first task raised, once all have ended, or the interruption.
    """
    from prefect import task
    from prefect.cache_policies import NO_CACHE

    from .mapping.runner import MapTaskRunner

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
    """Runs a job that has one part only in a thread of its own, and waits for it; steps inside it may be tasks.

    Args:
        work: watches for a cancel request of the job, and ends soon after one.
        job_arn: the job.
        service: where the job is stored.

    Raises:
        BaseException: what `work` raised, or the interruption, once it has ended.
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
    """Requests a job's cancellation, again until the catalog answers; another interruption ends that."""
    while True:
        try:
            service.catalog.request_cancel(job_arn)
        except ServiceUnavailableException as error:
            _logger.warning("%s is cancelled as soon as the catalog answers: %s", job_arn, error)
            time.sleep(service.timing.after_outage_s)
        else:
            return
