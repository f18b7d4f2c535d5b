"""Steps of a job: parts that Prefect shows as task runs, each under its own name."""

import sys
from collections.abc import Callable
from functools import cache
from typing import TYPE_CHECKING, Any, Protocol, TypeVar

if TYPE_CHECKING:
    from prefect import Task

Result = TypeVar("Result")


class RunStep(Protocol):
    """Runs a step: `directly`, or `as_task`."""

    def __call__(self, name: str, part: Callable[[], Result], /) -> Result:
        """Runs a part of a job as the step `name` and returns what it returns."""
        ...


def directly(_name: str, part: Callable[[], Result], /) -> Result:
    """Runs a step as a plain call: in a batch, where each job is one light task run already."""
    return part()


def as_task(name: str, part: Callable[[], Result], /) -> Result:
    """Runs a step as a task run of the flow run that is under way."""
    return _task(name)(part)


def step_runner() -> RunStep:
    """Returns how steps are run here: as tasks inside a flow run, directly elsewhere."""
    context = sys.modules.get("prefect.context")  # without Prefect there is no flow run, and importing it takes seconds
    return as_task if context is not None and context.FlowRunContext.get() is not None else directly


@cache
def _task(name: str) -> "Task[..., Any]":
    from prefect import task
    from prefect.cache_policies import NO_CACHE

    @task(name=name, cache_policy=NO_CACHE)
    def run(part: Callable[[], Result]) -> Result:
        return part()

    return run
