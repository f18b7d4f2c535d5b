"""Prefect's background worker as our server has it: it looks seldom, and is late for nothing.

Prefect's server is imported in functions: that takes each worker of pytest 2 s, and one of them runs these tests.
"""

import asyncio
from collections.abc import Callable
from contextlib import suppress
from datetime import timedelta
from inspect import signature
from uuid import uuid4

import pytest
from burner_redis.pubsub import PubSub
from docket import Docket, Worker

TIME_LIMIT_S = 200
BULK = 25
"""More tasks than the worker has slots twice over."""


@pytest.fixture(autouse=True)
def patched(monkeypatch: pytest.MonkeyPatch) -> None:
    from prefect.server.api import background_workers

    from prefect_robomaker.deployments.prefect_server import server_process

    # What is changed is there, in these releases of docket, burner-redis and Prefect; and as it was after the test.
    assert background_workers.Worker is Worker  # pyright: ignore[reportPrivateImportUsage]
    assert list(signature(PubSub._queue_get).parameters) == ["self", "timeout"]  # pyright: ignore[reportPrivateUsage]
    monkeypatch.setattr(background_workers, "Worker", Worker)
    monkeypatch.setattr(PubSub, "_queue_get", PubSub._queue_get)  # pyright: ignore[reportPrivateUsage]
    # So long that what waited for it would not be done in time.
    monkeypatch.setattr(server_process, "_LOOK_FOR_WORK", timedelta(seconds=3 * TIME_LIMIT_S), raising=False)
    server_process.look_seldom()


def test_a_bulk_of_tasks_waits_for_slots_only_and_one_that_is_cancelled_ends() -> None:
    done: list[int] = []
    begun, ended = asyncio.Event(), asyncio.Event()

    async def remove_logs(number: int) -> None:
        done.append(number)
        if len(done) == BULK:
            ended.set()

    async def wait_for_ever() -> None:
        begun.set()
        try:
            await asyncio.sleep(3 * TIME_LIMIT_S)
        finally:
            ended.set()

    async def work() -> None:
        async with docket() as tasks, made(tasks) as worker:
            for number in range(BULK):
                await tasks.add(remove_logs)(number)
            running = asyncio.create_task(worker.run_forever())
            try:
                await asyncio.wait_for(ended.wait(), TIME_LIMIT_S)
                ended.clear()
                execution = await tasks.add(wait_for_ever)()  # wakes the worker, which has nothing to do
                await asyncio.wait_for(begun.wait(), TIME_LIMIT_S)
                await tasks.cancel(execution.key)
                await asyncio.wait_for(ended.wait(), TIME_LIMIT_S)
            finally:
                running.cancel()
                with suppress(asyncio.CancelledError):
                    await running

    asyncio.run(work())
    assert sorted(done) == list(range(BULK))


def docket() -> Docket:
    return Docket(name=f"of-this-test-{uuid4().hex[:8]}", url="memory://")


def made(tasks: Docket) -> Worker:
    from prefect.server.api import background_workers

    make: Callable[[Docket], Worker] = background_workers.Worker  # pyright: ignore[reportPrivateImportUsage]
    worker = make(tasks)
    # Prefect looks for new deployments every few seconds, and then at those of the last few seconds and one more.
    assert worker.scheduling_resolution < timedelta(seconds=1)
    return worker
