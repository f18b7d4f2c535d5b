"""The watch goes on when the catalog does not answer, and says so once."""

import logging
import threading
import time
from collections.abc import Mapping

import pytest
from helpers.kept_orders import Table, open_rollout, order
from helpers.processes import wait_for

from prefect_robomaker.schemas.wire.errors import ServiceUnavailableException
from prefect_robomaker.tasks.fleet.bundle_files import BundleFiles
from prefect_robomaker.tasks.fleet.kept_rollouts import OpenRollout
from prefect_robomaker.tasks.fleet.order_refresh import BUSY_S, IDLE_S, OrderWatch, ReadRollouts
from prefect_robomaker.tasks.service.service import Service


class WatchedTable(Table):
    """A table whose robots are in whatever the catalog says."""

    def __init__(self) -> None:
        super().__init__("r1")
        self.robots.refresh = lambda service: None  # type: ignore[method-assign]


def test_orders_come_again_once_the_catalog_answers(service: Service, caplog: pytest.LogCaptureFixture) -> None:
    table, known, looks = WatchedTable(), [], []

    def read(_: Service, before: Mapping[str, OpenRollout]) -> list[OpenRollout]:
        looks.append(1)
        known.append(set(before))
        if len(looks) < 4:
            raise ServiceUnavailableException("the catalog does not answer")
        return [open_rollout(r1=order(1))]

    files, tended = BundleFiles(service, table.keeper), []
    watch = OrderWatch(service, table.robots, table.keeper, files, read, tended.append)
    with caplog.at_level(logging.WARNING, "robomaker.robots"):
        watch.start()
        for number in range(1, 6):
            wait_for(lambda number=number: len(looks) >= number, "a look")
            watch.wake()
        wait_for(lambda: table.shown() == {"r1": ("deploy", 1)}, "the order")
        watch.stop()

    assert [record.message for record in caplog.records] == [
        "robots get no new orders: the catalog does not answer",
        "robots get orders again",
    ]
    assert [rollout.job for rollout in tended[0]] == ["job"], "those whose jobs have ended are tended"
    assert known[4] == {"job"}, "what has not changed need not be read again"


class Pauses(threading.Event):
    """Notes pauses instead of waiting; ends the watch after some."""

    def __init__(self, most: int) -> None:
        super().__init__()
        self.most = most
        self.waits: list[float] = []
        self.watch: OrderWatch | None = None

    def wait(self, timeout: float | None = None) -> bool:
        assert timeout is not None
        self.waits.append(timeout)
        if len(self.waits) >= self.most and self.watch is not None:
            self.watch._is_stopped = True
        return True


def paused(service: Service, read: ReadRollouts, *, is_woken: bool = False) -> list[float]:
    """The pauses after two looks."""
    table = WatchedTable()
    watch = OrderWatch(service, table.robots, table.keeper, BundleFiles(service, table.keeper), read, lambda _: None)
    pauses = Pauses(2)
    watch._woken = pauses
    pauses.watch = watch
    if is_woken:
        watch.wake()
    watch._watch()
    return pauses.waits


def test_a_job_that_was_asked_for_is_looked_for_often(service: Service) -> None:
    assert paused(service, lambda *_: []) == [IDLE_S, IDLE_S]
    assert paused(service, lambda *_: [], is_woken=True) == [BUSY_S, BUSY_S]


def test_pauses_are_longer_after_looks_that_cost_much_and_not_after_those_that_waited(service: Service) -> None:
    def waits(*_: object) -> list[OpenRollout]:
        time.sleep(0.1)
        return [open_rollout(r1=order(1))]

    def works(*_: object) -> list[OpenRollout]:
        until_s = time.thread_time() + 0.1
        while time.thread_time() < until_s:
            pass
        return [open_rollout(r1=order(1))]

    assert paused(service, waits) == [BUSY_S, BUSY_S]
    assert min(paused(service, works)) > 0.9
