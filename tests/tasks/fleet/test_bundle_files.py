"""Files of orders are fetched once for all robots, and removed when no deployment has them."""

import threading
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from helpers.kept_orders import Table, open_rollout, order
from helpers.robot_orders import robot_order

from prefect_robomaker.schemas.wire.errors import ObjectNotFoundError
from prefect_robomaker.tasks.fleet.bundle_files import BundleFiles
from prefect_robomaker.tasks.service.service import Service


class FarStore:
    """A store whose files are not on this machine."""

    def __init__(self, store: Any) -> None:
        self._store = store
        self.fetched = 0

    def local_path(self, bucket: str, key: str) -> None:
        return None

    def get_file(self, bucket: str, key: str, path: Path) -> Any:
        self.fetched += 1
        time.sleep(0.05)  # so that the others ask meanwhile
        return self._store.get_file(bucket, key, path)


@pytest.fixture
def table(service: Service) -> Table:
    service.store.ensure_bucket("robomaker")
    service.store.put_bytes("robomaker", "robots/file.swu", b"content")
    table = Table("r1")
    table.sync(open_rollout(r1=order(1)))
    return table


def test_many_robots_at_once_have_it_fetched_once(service: Service, table: Table) -> None:
    far: Any = FarStore(service.store)
    files = BundleFiles(replace(service, store=far), table.keeper)
    opened = table.orders.open()["r1"]
    together = threading.Barrier(8)

    def read(_: int) -> bytes:
        together.wait()
        return files.path_of(opened).read_bytes()

    with ThreadPoolExecutor(8) as pool:
        assert set(pool.map(read, range(8))) == {b"content"}
    assert far.fetched == 1

    files.remove_others()
    assert files.path_of(opened).exists()
    path = files.path_of(opened)
    table.sync()
    files.remove_others()
    assert not path.exists()


def test_a_store_on_this_machine_is_read_where_it_is(service: Service, table: Table) -> None:
    path = BundleFiles(service, table.keeper).path_of(table.orders.open()["r1"])
    assert path.read_bytes() == b"content"
    assert "objects" in path.parts


def test_a_file_that_no_deployment_has_is_not_there(service: Service, table: Table) -> None:
    with pytest.raises(ObjectNotFoundError, match="order 8"):
        BundleFiles(service, table.keeper).path_of(robot_order())
