"""A thousand items of a map, with a task run for each, with one for all, and with plain threads; asserts no time."""

import os
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any, NamedTuple

import pytest
from prefect import flow, task
from prefect.task_runners import ThreadPoolTaskRunner

from prefect_robomaker.tasks.execution.mapped_runs import MapTaskRunner

ITEMS, WORKERS, ROUNDS = 1_000, 2, 3


class Took(NamedTuple):
    """What a map cost this process."""

    wall_s: float
    cpu_s: float


def measured(work: Callable[[], list[int]]) -> Took:
    """What it costs to have all results."""
    began, cpu = time.monotonic(), time.process_time()
    assert work() == list(range(ITEMS))
    return Took(time.monotonic() - began, time.process_time() - cpu)


@task
def same(number: int) -> int:
    """Returns the number."""
    return number


def through(runner: Any) -> Took:
    """What a map in a flow with this runner costs, without the flow."""
    return flow(name="map benchmark", task_runner=runner)(lambda: measured(lambda: same.map(range(ITEMS)).result()))()


def plain() -> Took:
    """What threads alone cost."""
    with ThreadPoolExecutor(WORKERS) as pool:
        return measured(lambda: list(pool.map(same.fn, range(ITEMS))))


@pytest.mark.benchmark
@pytest.mark.timeout(900)
def test_a_map_of_a_thousand_items(prefect_server: str) -> None:
    for number in range(ROUNDS):
        one, each, bare = through(MapTaskRunner(WORKERS)), through(ThreadPoolTaskRunner(WORKERS)), plain()
        print(
            f"round {number}: {ITEMS} items: MapTaskRunner {one.wall_s:.2f} s ({one.cpu_s:.2f} CPU-s), "
            f"ThreadPoolTaskRunner {each.wall_s:.2f} s ({each.cpu_s:.2f} CPU-s), plain threads {bare.wall_s:.3f} s; "
            f"load {os.getloadavg()[0]:.1f}"
        )
