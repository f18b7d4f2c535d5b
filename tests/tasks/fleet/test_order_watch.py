"""The watch goes on when the catalog does not answer, and says so once."""

import logging
from collections.abc import Mapping

import pytest
from helpers.kept_orders import Table, open_rollout, order
from helpers.processes import wait_for

from prefect_robomaker.schemas.wire.errors import ServiceUnavailableException
from prefect_robomaker.tasks.fleet.bundle_files import BundleFiles
from prefect_robomaker.tasks.fleet.order_watch import OrderWatch
from prefect_robomaker.tasks.fleet.stored_rollouts import OpenRollout
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
