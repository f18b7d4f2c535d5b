"""Simulation jobs as Prefect tasks: a job on its own, or a request of a batch."""

from typing import Protocol

from prefect import task
from prefect.cache_policies import NO_CACHE

from ..catalog import Resource
from ..execution.slots import Slots
from ..service.service import Service
from .job_runs import perform_job


class Batch(Protocol):
    """What a batch's performer offers to the tasks that run its requests."""

    def why_stop(self) -> str | None:
        """The failure code with which the batch's jobs have to stop, if they have to."""
        ...

    def create_job(self, index: int) -> Resource | None:
        """Turns a request into a job, once; `None` when it is refused for good."""
        ...

    def report(self) -> None:
        """Tells whoever watches how many requests are in which state."""
        ...


@task(name="simulate", cache_policy=NO_CACHE)
def simulate(arn: str) -> None:
    """Carries one simulation job to its end."""
    perform_job(arn, Service.current())


@task(name="simulate-request", task_run_name="request-{index}", cache_policy=NO_CACHE)
def simulate_request(batch: Batch, index: int, slots: Slots) -> None:
    """Turns one request of a batch into a job, while holding a slot of the batch, and runs it."""
    with slots.hold(lambda: batch.why_stop() is not None) as held:
        if held and (job := batch.create_job(index)) is not None:
            batch.report()
            perform_job(job.arn, Service.current(), batch.why_stop)
    batch.report()
