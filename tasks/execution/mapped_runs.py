"""Prefect task runner that makes one task run for a whole `map`, with retries and state of each item."""

import asyncio
import concurrent.futures
import contextvars
import inspect
import time
from collections import Counter
from collections.abc import Callable, Coroutine, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias, TypeVar, cast

from prefect import State, Task
from prefect.cache_policies import NO_CACHE
from prefect.client.schemas.objects import RunInput, StateDetails
from prefect.context import TaskRunContext
from prefect.exceptions import PrefectException, UpstreamTaskError
from prefect.futures import PrefectConcurrentFuture, PrefectFuture, PrefectFutureList
from prefect.logging import get_run_logger
from prefect.results import get_result_store, should_persist_result
from prefect.states import Cancelled, Completed, Crashed, Failed, Pending, Running, format_exception
from prefect.task_runners import TaskRunner, ThreadPoolTaskRunner
from prefect.utilities.asyncutils import run_coro_as_sync
from prefect.utilities.callables import call_with_parameters
from prefect.utilities.engine import collect_task_run_inputs_sync, resolve_inputs_sync
from prefect.utilities.math import clamped_poisson_interval
from prefect.utilities.timeout import timeout

from ...schemas.wire.errors import ConfigurationError


@dataclass(frozen=True)
class Item:
    """One call of a task inside a mapped Prefect task run (`task.map`).

    Args:
        task: The task that is mapped.
        index: Number of the item in the map, from 0.
        parameters: Parameters of the call; futures in them are waited for.
    """

    task: Task[..., Any]
    index: int
    parameters: Mapping[str, Any]

    def run(self, sleep: Callable[[float], None] = time.sleep) -> State[Any]:
        """Calls the task's function, with the task's retries, and returns the final state.

        Args:
            sleep: Waits before a retry, in seconds.

        Returns:
            Final state of the item; `NotReady` if an input of it failed.
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
            return _state_of_returned(self._call(parameters))
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
        """Asks the task's `retry_condition_fn` whether a failed call may be repeated; true if there is no condition.

        A condition that raises an error counts as no, as with Prefect; the error is logged.
        """
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


def _state_of_returned(returned: Any) -> State[Any]:
    """Converts a task's return value to its final state: the value itself if it is a state, else `Completed`."""
    if not isinstance(returned, State):
        return Completed(data=get_result_store().create_result_record(returned))
    state = cast("State[Any]", returned)
    if state.data is None:  # else there would be no result, not the result `None`
        state.data = get_result_store().create_result_record(None)
    return state


Result = TypeVar("Result")
Ended: TypeAlias = concurrent.futures.Future[Any]
"""Future of the final state of one item of a Prefect `map`."""

Summary: TypeAlias = Callable[[Sequence[State[Any]]], str]
"""Function that describes the result of a map, from the final states of its items in order."""


def in_words(states: Sequence[State[Any]]) -> str:
    """Returns text about the failures of a map: `3 of 1000 items did not complete: 2 Failed, 1 TimedOut; item 17: ...`.

    If all items completed, the text says so.
    """
    bad = [(index, state) for index, state in enumerate(states) if not state.is_completed()]
    if not bad:
        return f"all {len(states)} items completed"
    names = ", ".join(f"{number} {name}" for name, number in Counter(state.name for _, state in bad).items())
    index, first = bad[0]
    return f"{len(bad)} of {len(states)} items did not complete: {names}; item {index}: {first.message}"


class ItemFuture(PrefectConcurrentFuture[Result]):
    """Prefect future of one item of a map: the task run is shared by the whole map, state and result are its own."""

    @property
    def state(self) -> State[Any]:
        """Prefect state of this item of a `map`, independent of the other items."""
        future = self.wrapped_future
        if future.done():
            return _state_of(future)
        # Prefect takes the task run of an input that runs for a parent of the task that gets it.
        details = StateDetails(task_run_id=self.task_run_id)
        return Running(state_details=details) if future.running() else Pending(state_details=details)


class MapTaskRunner(ThreadPoolTaskRunner[Result]):
    """Prefect task runner in threads that makes a single task run for each `map`, instead of one for each item.

    Each item has its own future, with its own result, failure and retries. The task run is named after the task and
    the number of items, and its state says how many of them did not complete.

    Args:
        max_workers: Limit of items and submitted tasks that run at once; absent: that of `ThreadPoolTaskRunner`.
        summary: Makes the text of the state of a map's task run.
    """

    def __init__(self, max_workers: int | None = None, summary: Summary = in_words) -> None:
        super().__init__(max_workers)
        self._summary = summary
        self._maps: ThreadPoolTaskRunner[Any] | None = None

    def duplicate(self) -> "MapTaskRunner[Result]":
        """Returns a task runner with the same configuration, for another flow run."""
        return type(self)(max_workers=self._max_workers, summary=self._summary)

    def map(  # pyright: ignore[reportIncompatibleMethodOverride] - the same for async tasks
        self,
        task: Task[..., Any],
        parameters: dict[str, Any],
        wait_for: Iterable[PrefectFuture[Any]] | None = None,
    ) -> PrefectFutureList[Any]:
        """Runs a task once for each item, in threads, all as one Prefect task run.

        Args:
            task: The task to map.
            parameters: Parameters of the call; each iterable that is not `unmapped` has an element for each item.
            wait_for: Futures that have to complete before any item begins.

        Returns:
            A future for each item, in order.

        Raises:
            ConfigurationError: The task asks for what only a task run of its own has, such as a cached result.
            RuntimeError: The runner has not been started.
        """
        _check(task)
        if self._executor is None or self._maps is None:
            raise RuntimeError("MapTaskRunner has not been started")
        with _Calls() as calls:
            calls.map(task, parameters, wait_for)
        if not calls.parameters:
            return _listed([])
        run = _MapRun([Item(task, index, call) for index, call in enumerate(calls.parameters)], self._summary)
        run.begin(self._executor)
        future = self._maps.submit(run.as_task(task), {"items": None}, wait_for, {"items": calls.inputs()})
        future.wrapped_future.add_done_callback(run.end_without_beginning)
        return _listed([ItemFuture[Any](future.task_run_id, ended) for ended in run.ended])

    def __enter__(self) -> "MapTaskRunner[Result]":
        super().__enter__()
        # Task runs of maps only wait for their items, and must not take the threads that these need.
        self._maps = ThreadPoolTaskRunner[Any]().__enter__()
        return self

    def __exit__(self, exc_type: Any, exc_value: Any, traceback: Any) -> None:
        super().__exit__(exc_type, exc_value, traceback)
        if self._maps is not None:
            self._maps.__exit__(exc_type, exc_value, traceback)
            self._maps = None


def _listed(futures: list[ItemFuture[Any]]) -> PrefectFutureList[Any]:
    return PrefectFutureList[Any](futures)  # pyright: ignore[reportAbstractUsage] - Prefect's own says it is an iterator


class _Calls(TaskRunner[PrefectFuture[Any]]):
    """Records the calls of a `map` in Prefect, rather than running them."""

    def __init__(self) -> None:
        super().__init__()
        self.parameters: list[dict[str, Any]] = []
        self._dependencies: dict[str, set[RunInput]] = {}

    def duplicate(self) -> "_Calls":
        return type(self)()

    def submit(  # pyright: ignore[reportIncompatibleMethodOverride] - nothing uses what it returns
        self,
        task: Task[..., Any],  # noqa: ARG002 - Prefect's signature
        parameters: dict[str, Any],
        wait_for: Iterable[PrefectFuture[Any]] | None = None,  # noqa: ARG002
        dependencies: dict[str, set[RunInput]] | None = None,
    ) -> None:
        self.parameters.append(parameters)
        self._dependencies = dependencies or {}

    def inputs(self) -> set[RunInput]:
        """Returns the task runs whose results the calls use, for the arrows in Prefect's graph."""
        return set[RunInput](collect_task_run_inputs_sync(self.parameters)).union(*self._dependencies.values())


class _MapRun:
    """Task run of one `map` call.

    Args:
        items: The calls, at least one.
        summary: Makes the text of its final state.
    """

    def __init__(self, items: Sequence[Item], summary: Summary) -> None:
        self.ended: list[Ended] = []
        self._items = items
        self._summary = summary
        self._begun = concurrent.futures.Future[contextvars.Context | State[Any]]()

    def begin(self, pool: concurrent.futures.Executor) -> None:
        """Submits the items to the thread pool, where they wait until the task run begins."""
        self.ended = [pool.submit(self._run_item, item) for item in self._items]

    def as_task(self, task: Task[..., Any]) -> Task[..., Any]:
        """Returns the Prefect task whose single run waits for all items; it has the mapped task's name and hooks."""
        name = f"{task.name} x {len(self._items)}"
        return Task(
            fn=self._wait,
            name=task.name,
            description=task.description,
            version=task.version,
            tags=task.tags,
            task_run_name=lambda: name,  # a text would be a template
            log_prints=task.log_prints,
            on_running=task.on_running_hooks,
            on_completion=task.on_completion_hooks,
            on_failure=task.on_failure_hooks,
            retries=0,
            cache_policy=NO_CACHE,
            persist_result=False,
        )

    def end_without_beginning(self, ended: Ended) -> None:
        """Ends all items without running them, because the task run failed or was cancelled before it began."""
        if not self._begun.done():
            self._begun.set_result(_state_of(ended))

    def _wait(self, items: None) -> State[Any]:  # noqa: ARG002 - Prefect's graph leads its arrows to a parameter
        self._begun.set_result(contextvars.copy_context())
        states = [_state_of(each) for each in self.ended]
        message = self._summary(states)
        if all(state.is_completed() for state in states):
            return Completed(message=message)
        if all(state.is_completed() or state.is_cancelled() for state in states):
            return Cancelled(message=message)
        return Failed(message=message)

    def _run_item(self, item: Item) -> State[Any]:
        begun = self._begun.result()
        return begun if isinstance(begun, State) else begun.copy().run(item.run)


def _state_of(ended: Ended) -> State[Any]:
    """Waits for an item or a task run to end, and returns its final state; an error becomes a failed state."""
    try:
        return ended.result()
    except concurrent.futures.CancelledError:
        return Cancelled(message="it was cancelled before it began")
    except BaseException as error:
        return Failed(data=error, message=f"{type(error).__name__}: {error}")


def _check(task: Task[..., Any]) -> None:
    """Raises `ConfigurationError` if a task has features that mapped items do not have, such as cached results."""
    persists = should_persist_result() if task.persist_result is None else task.persist_result
    asked = {
        "a kept or cached result (persist_result=False keeps none)": persists,
        "hooks of a transaction": task.on_commit_hooks or task.on_rollback_hooks,
        "assets": getattr(task, "assets", None) or task.asset_deps,
        "results one after the other, as a generator": task.isgenerator,
    }
    for what, is_asked in asked.items():
        if is_asked:
            raise ConfigurationError(
                f"task '{task.name}' asks for {what}, which items of one task run do not have; "
                "map it with Prefect's ThreadPoolTaskRunner, or change the task"
            )
