"""One task run for a whole map: what its users get of each item, and what the server shows."""

import asyncio
import threading
import time
import uuid
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from typing import Any

import pytest
from helpers.processes import wait_for
from hypothesis import given
from hypothesis import strategies as st
from prefect import Flow, State, Task, flow, task, unmapped
from prefect.cache_policies import INPUTS
from prefect.client.orchestration import get_client
from prefect.client.schemas.filters import FlowRunFilter, FlowRunFilterId
from prefect.client.schemas.objects import StateType, TaskRun, TaskRunResult
from prefect.exceptions import UnfinishedRun
from prefect.futures import as_completed, wait
from prefect.states import Cancelled, Completed, Failed

from prefect_robomaker.schemas.wire.errors import ConfigurationError
from prefect_robomaker.tasks.execution.mapped_runs import ItemFuture, MapTaskRunner, in_words

pytestmark = pytest.mark.usefixtures("prefect_server")


@task
def halved(number: int, *, divisor: int = 2) -> int:
    """Divides even numbers."""
    if number % 2:
        raise ValueError(f"{number} is odd")
    return number // divisor


def in_flow(body: Callable[[], Any], workers: int | None = 4) -> Any:
    """Runs code as a flow with the runner."""
    runner: Any = MapTaskRunner[Any](max_workers=workers)  # Prefect's types refuse its own runners, too
    return flow(name="maps", task_runner=runner)(body)()


def rows(flow_run_id: uuid.UUID, most: int) -> list[TaskRun]:
    """The task runs of a flow run on the server, once it knows of that many and all have ended."""

    def read() -> list[TaskRun]:
        with get_client(sync_client=True) as client:
            found = FlowRunFilter(id=FlowRunFilterId(any_=[flow_run_id]))
            return client.read_task_runs(flow_run_filter=found)

    def ended() -> bool:
        known = read()
        return len(known) >= most and all(each.state and not each.state.is_running() for each in known)

    wait_for(ended, "the server to know of the task runs")
    return sorted(read(), key=lambda run: str(run.start_time))


def with_rows(body: Callable[[], Any], most: int = 1, workers: int = 4) -> tuple[Any, list[TaskRun]]:
    """What a flow returns, and its task runs."""
    from prefect.runtime import flow_run

    ids: list[str] = []

    def noting() -> Any:
        ids.append(flow_run.id)
        return body()

    returned = in_flow(noting, workers)
    return returned, rows(uuid.UUID(ids[0]), most)


def test_many_items_are_one_task_run_with_their_results_in_order() -> None:
    results, known = with_rows(lambda: halved.map(range(0, 400, 2)).result())

    assert results == list(range(200))
    assert [(run.name, run.state_name) for run in known] == [("halved x 200", "Completed")]
    assert known[0].state is not None
    assert known[0].state.message == "all 200 items completed"


def test_an_item_that_fails_does_so_alone_and_the_task_run_says_how_many_did() -> None:
    def body() -> Any:
        futures = halved.map([0, 1, 2, 3])
        wait(futures)
        assert [future.state.name for future in futures] == ["Completed", "Failed", "Completed", "Failed"]
        assert [futures[0].result(), futures[2].result()] == [0, 1]
        assert [str(each) for each in futures.result(raise_on_failure=False)] == ["0", "1 is odd", "1", "3 is odd"]
        with pytest.raises(ValueError, match="3 is odd"):
            futures[3].result()
        with pytest.raises(ValueError, match="is odd"):
            futures.result()
        return halved.map([0, 1], return_state=True)[0]

    _, known = with_rows(body, 2)

    assert [run.state_name for run in known] == ["Failed", "Failed"]
    assert known[0].state is not None
    assert known[0].state.message == "2 of 4 items did not complete: 2 Failed; item 1: ValueError: 1 is odd"


def test_parameters_are_unpacked_as_prefect_unpacks_them() -> None:
    @task
    def called(one: int, many: list[int], other: int = 7, **more: int) -> Any:
        """Returns what it got."""
        return one, many, other, more

    def body() -> Any:
        number = halved.submit(4)
        assert called.map([1, 2], many=unmapped([3, 4]), extra=number).result() == [
            (1, [3, 4], 7, {"extra": 2}),
            (2, [3, 4], 7, {"extra": 2}),
        ]
        assert list(halved.map([])) == []
        with pytest.raises(Exception, match="different lengths"):
            called.map([1, 2], [3])
        with pytest.raises(Exception, match="at least one iterable"):
            called.map(1, many=unmapped([3]))

    in_flow(body)


@pytest.mark.parametrize("workers", [1, 4])
def test_items_of_one_map_are_inputs_of_another_and_only_what_needs_a_failed_one_is_not_run(workers: int) -> None:
    def body() -> None:
        first = halved.map([0, 1, 8])
        second = halved.map(first)
        one: Any = halved.submit(first[2])  # pyright: ignore[reportArgumentType] - Prefect resolves it
        wait(second)
        assert [future.state.name for future in second] == ["Completed", "NotReady", "Completed"]
        assert (second[2].result(), one.result()) == (2, 2)
        with pytest.raises(UnfinishedRun):
            second[1].result()

    in_flow(body, workers)


def test_an_item_that_runs_is_of_the_task_run_of_its_map() -> None:
    """Prefect asks its state for the task run, where the item is an input of another task."""
    map_run = uuid.uuid4()
    item = ItemFuture[int](map_run, Future())
    assert item.state.is_pending()
    assert item.state.state_details.task_run_id == map_run
    item.wrapped_future.set_running_or_notify_cancel()
    assert item.state.is_running()
    assert item.state.state_details.task_run_id == map_run


def test_what_a_map_waits_for_ends_before_its_items_begin() -> None:
    def body() -> None:
        ended: list[float] = []
        late = task(lambda: ended.append(time.sleep(0.3) or time.monotonic()))
        when: Any = task(lambda _: time.monotonic())
        begun = when.map([1, 2], wait_for=[late.submit()]).result()
        assert min(begun) >= ended[0]
        never = when.map([1, 2], wait_for=[halved.submit(1)])
        never.wait()
        assert {future.state.name for future in never} == {"NotReady"}

    in_flow(body, 1)


def test_the_task_run_has_the_arrows_of_what_its_items_use() -> None:
    def body() -> None:
        halved.map(halved.map([4, 8])).wait()

    _, known = with_rows(body, 2)

    # Both begin at the same moment, in either order.
    used = {run.id: {each.id for each in run.task_inputs["items"] if isinstance(each, TaskRunResult)} for run in known}
    (first,) = (run for run, inputs in used.items() if not inputs)
    assert [inputs for inputs in used.values() if inputs] == [{first}]


def test_an_item_is_retried_as_its_task_says() -> None:
    tries: list[int] = []

    def until_odd(_task: Any, _run: TaskRun, state: State[Any]) -> bool:
        return "hopeless" not in str(state.message)

    @task(retries=2, retry_condition_fn=until_odd)
    def tried(number: int) -> int:
        """Works the third time."""
        tries.append(number)
        if number == 9:
            raise ValueError("hopeless")
        if tries.count(number) < 3:
            raise ValueError("not yet")
        return number

    def body() -> None:
        futures = tried.map([1, 2, 9])
        assert [future.result(raise_on_failure=False) for future in futures][:2] == [1, 2]
        assert futures[2].state.is_failed()

    in_flow(body)
    assert sorted(tries) == [1, 1, 1, 2, 2, 2, 9]


def test_states_timeouts_and_coroutines_are_what_they_are_with_a_task_run_each() -> None:
    @task(timeout_seconds=2)
    async def waiting(duration_s: float) -> float:
        """Waits."""
        await asyncio.sleep(duration_s)
        return duration_s

    @task(timeout_seconds=2)
    def busy(duration_s: float) -> None:
        """Waits, as code of Python that can be interrupted."""
        until = time.monotonic() + duration_s
        while time.monotonic() < until:
            time.sleep(0.01)

    @task
    def judged(number: int) -> Any:
        """Returns a state."""
        return Completed(message="fine") if number else Failed(message="bad")

    def body() -> None:
        for futures in (waiting.map([0.0, 60.0]), busy.map([0.0, 60.0])):
            futures.wait()
            assert [future.state.name for future in futures] == ["Completed", "TimedOut"]
        states = judged.map([1, 0], return_state=True)
        assert [(state.name, state.message) for state in states] == [("Completed", "fine"), ("Failed", "bad")]

    in_flow(body)


def test_no_more_items_run_at_once_than_there_are_workers() -> None:
    running, most, lock, all_are_there = 0, 0, threading.Lock(), threading.Event()

    @task
    def counted(_: int) -> None:
        """Notes how many run."""
        nonlocal running, most
        with lock:
            running += 1
            most = max(most, running)
            if most == 3:
                all_are_there.set()
        assert all_are_there.wait(200)
        time.sleep(0.02)  # one too many has the time to come
        with lock:
            running -= 1

    def body() -> None:
        maps = [counted.map(range(6)) for _ in range(2)]
        counted.submit(0).wait()
        for futures in maps:
            futures.wait()

    in_flow(body, 3)
    assert most == 3


def test_futures_can_be_waited_for_as_they_complete_and_items_that_have_not_begun_be_cancelled() -> None:
    free = threading.Event()

    @task
    def held(number: int) -> int:
        """Waits for the test."""
        free.wait(120)
        return number

    def body() -> None:
        futures: Any = held.map(range(3))
        wait_for(lambda: futures[0].state.is_running(), "the first item")
        assert (wait(futures, timeout=0.1).done, futures[2].state.name) == (set(), "Pending")
        with pytest.raises(TimeoutError):
            futures[0].result(timeout=0.1)
        assert futures[2].wrapped_future.cancel()
        free.set()
        assert {future.result() for future in as_completed(futures[:2])} == {0, 1}
        assert futures[2].state.is_cancelled()

    _, known = with_rows(body, workers=1)
    assert known[0].state is not None
    assert (known[0].state.type, known[0].state.message) == (
        StateType.CANCELLED,
        "1 of 3 items did not complete: 1 Cancelled; item 2: it was cancelled before it began",
    )


def test_items_that_no_flow_waits_for_are_cancelled_at_its_end_unless_they_have_begun() -> None:
    begun: list[int] = []

    @task
    def slow(number: int) -> None:
        """Takes a while."""
        begun.append(number)
        time.sleep(1)

    futures: list[Any] = []

    def body() -> None:
        futures.extend(slow.map(range(50)))
        wait_for(lambda: bool(begun), "an item")

    in_flow(body, 2)

    assert len(begun) < 10
    assert all(future.wrapped_future.done() for future in futures)
    assert futures[-1].state.is_cancelled()


def test_hooks_and_tags_are_those_of_the_map(caplog: pytest.LogCaptureFixture) -> None:
    seen: list[tuple[str, str]] = []

    def note(_task: Task[..., Any], run: TaskRun, state: State[Any]) -> None:
        seen.append((run.name, state.name or ""))

    @task(tags=["odd"], on_failure=[note], on_completion=[note])
    def hooked(number: int) -> int:
        """Fails for 0."""
        return 1 // number

    _, known = with_rows(lambda: [hooked.map([1, 2]).wait(), hooked.map([0, 1]).wait()][0], 2)

    assert sorted(seen) == [("hooked x 2", "Completed"), ("hooked x 2", "Failed")]
    assert [run.tags for run in known] == [["odd"], ["odd"]]
    assert "item 0: ZeroDivisionError" in caplog.text


@task
def each(number: int) -> Any:
    """A generator."""
    yield number


@pytest.mark.parametrize(
    ("unfit", "what"),
    [
        (halved.with_options(persist_result=True), "a kept or cached result"),
        (halved.with_options(cache_policy=INPUTS), "a kept or cached result"),
        (each, "as a generator"),
    ],
)
def test_what_items_do_not_have_is_refused(unfit: Task[..., Any], what: str) -> None:
    def body() -> None:
        with pytest.raises(ConfigurationError, match=f"task '{unfit.name}' asks for .*{what}.*ThreadPoolTaskRunner"):
            unfit.map([1, 2])

    in_flow(body)


def test_the_message_can_be_ones_own_and_a_runner_stays_what_it_is_for_each_run() -> None:
    runner: Any = MapTaskRunner[Any](max_workers=2, summary=lambda states: f"{len(states)} rooms")
    visits: Flow[[], Any] = flow(name="visits", task_runner=runner)(lambda: halved.map([2, 4, 6]).result())

    assert visits() == visits() == [1, 2, 3]
    with pytest.raises(RuntimeError, match="has not been started"):
        runner.map(halved, {"number": [1]})


@given(st.lists(st.sampled_from([Completed(), Failed(message="no"), Cancelled(), Failed(name="TimedOut")])))
def test_the_words_count_every_item(states: Sequence[State[Any]]) -> None:
    bad = sum(not state.is_completed() for state in states)
    words = in_words(states)

    assert words.startswith(f"{bad} of {len(states)} items" if bad else f"all {len(states)} items completed")
