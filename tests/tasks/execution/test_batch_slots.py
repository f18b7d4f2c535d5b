import time
from collections.abc import Iterator

import pytest
from helpers.processes import wait_for
from prefect.client.orchestration import SyncPrefectClient, get_client

from prefect_robomaker.tasks.execution.batch_slots import Slots

pytestmark = pytest.mark.usefixtures("prefect_server")


@pytest.fixture
def client(prefect_server: str) -> Iterator[SyncPrefectClient]:
    with get_client(sync_client=True) as client:
        yield client


def never() -> bool:
    return False


def test_the_limit_shows_on_the_server_while_it_is_used(client: SyncPrefectClient) -> None:
    with Slots("shows", 3, 2) as slots:
        limit = client.read_global_concurrency_limit_by_name("shows")
        with slots.hold(never) as held:
            assert held
        assert (limit.limit, limit.active_slots) == (3, 2)
        slots.remove()

    assert "shows" not in {limit.name for limit in client.read_global_concurrency_limits()}


def test_a_worker_that_takes_over_does_not_wait_for_the_slots_of_a_dead_one() -> None:
    with Slots("taken-over", 2, 2), Slots("taken-over", 2, 2) as successor:
        with successor.hold(never) as first, successor.hold(never) as second:
            assert (first, second) == (True, True)
        successor.remove()


def test_a_limit_that_is_lowered_on_the_server_is_obeyed(client: SyncPrefectClient) -> None:
    with Slots("lowered", 2, 2, look_s=0.2) as slots:
        client.upsert_global_concurrency_limit_by_name("lowered", 1)
        wait_for(lambda: client.read_global_concurrency_limit_by_name("lowered").active_slots == 1, "one slot")

        with slots.hold(never) as first:
            gave_up = time.monotonic() + 1.0
            with slots.hold(lambda: time.monotonic() > gave_up) as second:
                assert (first, second) == (True, False)
        slots.remove()


def test_slots_that_the_server_has_given_to_others_are_taken_anew(client: SyncPrefectClient) -> None:
    with Slots("lost", 2, 2, look_s=0.2) as slots:
        for lease in list(slots._free):  # as after the machine slept
            client.release_concurrency_slots_with_lease(lease)
        slots._renew()

        wait_for(lambda: client.read_global_concurrency_limit_by_name("lost").active_slots == 2, "two slots")
        with slots.hold(never) as first, slots.hold(never) as second:
            assert (first, second) == (True, True)
        slots.remove()
