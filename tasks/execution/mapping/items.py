"""One item of a map: its inputs, its attempts, and the state in which it ends.

It is run as Prefect's task engine would run a task, but is no task run of its own: the server is told nothing.
"""

import asyncio
import inspect
import time
from collections.abc import Callable, Coroutine, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, cast

from prefect import State, Task
from prefect.context import TaskRunContext
from prefect.exceptions import PrefectException, UpstreamTaskError
from prefect.logging import get_run_logger
from prefect.results import get_result_store
from prefect.states import Completed, Crashed, Failed, Pending, format_exception
from prefect.utilities.asyncutils import run_coro_as_sync
from prefect.utilities.callables import call_with_parameters
from prefect.utilities.engine import resolve_inputs_sync
from prefect.utilities.math import clamped_poisson_interval
from prefect.utilities.timeout import timeout


@dataclass(frozen=True)
class Item:
    """A call of a task for one item of a map.

    Args:
        task: what is mapped.
        index: its place in the map, from 0.
        parameters: of the call; futures in them are waited for.
    """

    task: Task[..., Any]
    index: int
    parameters: Mapping[str, Any]

    def run(self, sleep: Callable[[float], None] = time.sleep) -> State[Any]:
        """Calls the task's function, as often as its retries allow.

        Args:
            sleep: waits before a retry, in seconds.

        Returns:
            Its final state; `NotReady` where an input of it failed.
        """
        try:
            parameters = resolve_inputs_sync(dict(self.parameters))
        except UpstreamTaskError as error:
            return Pending(name="NotReady", message=str(error))
        except PrefectException as error:
            return _failed(error)
        state, attempt = self._attempt(parameters), 0
        while state.is_failed() and attempt < self.task.retries and self._may_retry(state):
            self._log(f"retry {attempt + 1} of {self.task.retries}", state)
            sleep(self._delay_s(attempt))
            state, attempt = self._attempt(parameters), attempt + 1
        if not state.is_completed():
            self._log("it is not tried again", state)
        return state

    def _attempt(self, parameters: dict[str, Any]) -> State[Any]:
        try:
            return _state_of(self._call(parameters))
        except TimeoutError as error:
            return _failed(error, name="TimedOut")
        except Exception as error:
            return _failed(error)
        except BaseException as error:  # it must not end the thread that other items need
            return Crashed(data=error, message=format_exception(error))

    def _call(self, parameters: dict[str, Any]) -> Any:
        limit_s = self.task.timeout_seconds
        if self.task.isasync:
            return asyncio.run(_within(limit_s, call_with_parameters(self.task.fn, parameters)))
        with timeout(seconds=limit_s):
            return call_with_parameters(self.task.fn, parameters)

    def _may_retry(self, state: State[Any]) -> bool:
        """Asks the task's `retry_condition_fn`; a condition that raises counts as no, as with Prefect."""
        context = TaskRunContext.get()
        if (condition := self.task.retry_condition_fn) is None or context is None:
            return True
        try:
            answer = condition(self.task, context.task_run, state)
            return bool(run_coro_as_sync(answer) if inspect.iscoroutine(answer) else answer)
        except Exception:
            get_run_logger().exception("item %s: the retry condition failed", self.index)
            return False

    def _delay_s(self, attempt: int) -> float:
        delays = self.task.retry_delay_seconds or 0
        delay_s = delays[min(attempt, len(delays) - 1)] if isinstance(delays, Sequence) else delays
        factor = self.task.retry_jitter_factor
        return clamped_poisson_interval(delay_s, clamping_factor=factor) if factor and delay_s > 0 else delay_s

    def _log(self, what: str, state: State[Any]) -> None:
        error = state.data if isinstance(state.data, BaseException) else None
        get_run_logger().error("item %s: %s; %s", self.index, state.message, what, exc_info=error)


async def _within(limit_s: float | None, call: Coroutine[Any, Any, Any]) -> Any:
    return await asyncio.wait_for(call, limit_s)


def _failed(error: Exception, name: str | None = None) -> State[Any]:
    return Failed(data=error, message=format_exception(error), name=name or "Failed")


def _state_of(returned: Any) -> State[Any]:
    """The state that a task's return value stands for: a state itself, or `Completed` with it."""
    if not isinstance(returned, State):
        return Completed(data=get_result_store().create_result_record(returned))
    state = cast("State[Any]", returned)
    if state.data is None:  # else there would be no result, not the result `None`
        state.data = get_result_store().create_result_record(None)
    return state
