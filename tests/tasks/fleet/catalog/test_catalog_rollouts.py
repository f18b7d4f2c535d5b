"""Rollouts in the catalog: their revisions, the numbers of orders, and events that wait."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from datetime import datetime

import pytest
from sqlalchemy import create_engine
from sqlalchemy.pool import NullPool

from prefect_robomaker.schemas.wire.errors import ResourceNotFoundException
from prefect_robomaker.tasks.catalog import Catalog, NewResource
from prefect_robomaker.tasks.fleet.catalog_rollouts import Rollouts
from prefect_robomaker.tasks.fleet.tables import TABLES

MakeResource = Callable[..., NewResource]
FLEETS = ("yard", "dock")


@pytest.fixture
def jobs(catalog: Catalog, make_resource: MakeResource) -> list[str]:
    """Two deployment jobs, each of a fleet of its own."""
    made = (make_resource(number, kind="deployment-job", parent=fleet) for number, fleet in enumerate(FLEETS))
    return [catalog.create(job, token=None).arn for job in made]


@pytest.fixture
def rollouts(catalog: Catalog) -> Rollouts:
    return Rollouts(catalog)


def test_a_rollout_is_changed_by_one_of_several(rollouts: Rollouts, jobs: list[str]) -> None:
    assert rollouts.rollout(jobs[0]) is None
    assert rollouts.begin_rollout(jobs[0], {"file": "a"}, {"step": 0})
    assert not rollouts.begin_rollout(jobs[0], {"file": "b"}, {"step": 9})

    with ThreadPoolExecutor(8) as pool:
        won = list(pool.map(lambda step: rollouts.replace_rollout(jobs[0], 1, {"step": step}, is_open=True), range(8)))

    assert won.count(True) == 1
    found = rollouts.rollout(jobs[0])
    assert found is not None
    assert (found.revision, found.delivery, found.rollout) == (2, {"file": "a"}, {"step": won.index(True)})


def test_open_rollouts_are_found_by_fleet(rollouts: Rollouts, jobs: list[str]) -> None:
    for job in reversed(jobs):
        rollouts.begin_rollout(job, {}, {})

    assert list(rollouts.open_rollouts().items()) == [(jobs[0], 1), (jobs[1], 1)]
    assert rollouts.open_rollouts("dock") == {jobs[1]: 1}

    rollouts.replace_rollout(jobs[1], 1, {}, is_open=False)
    assert rollouts.open_rollouts() == {jobs[0]: 1}


def test_events_wait_in_order_until_they_are_applied(rollouts: Rollouts, jobs: list[str]) -> None:
    rollouts.begin_rollout(jobs[0], {}, {})
    for number in range(3):
        rollouts.add_event(jobs[0], {"number": number}, 100.5 + number)
    rollouts.add_event(jobs[1], {"number": 9}, 1.0)
    waiting = rollouts.events(jobs[0])
    assert [(each.event["number"], each.at_s) for each in waiting] == [(0, 100.5), (1, 101.5), (2, 102.5)]

    applied = [each.sequence for each in waiting[:2]]
    assert not rollouts.replace_rollout(jobs[0], 7, {}, is_open=True, applied=applied), "others changed it"
    assert len(rollouts.events(jobs[0])) == 3
    assert rollouts.replace_rollout(jobs[0], 1, {}, is_open=True, applied=applied)

    assert [each.event["number"] for each in rollouts.events(jobs[0])] == [2]
    assert rollouts.jobs_with_events() == sorted(jobs)
    assert [each.event["number"] for each in rollouts.events(jobs[1])] == [9]


def test_numbers_of_orders_grow_and_never_return(catalog: Catalog, rollouts: Rollouts, jobs: list[str]) -> None:
    with ThreadPoolExecutor(4) as pool:
        drawn = [each for some in pool.map(lambda _: rollouts.number_orders(jobs[0], 3), range(8)) for each in some]
    assert len(set(drawn)) == 24
    assert min(drawn) >= 1

    catalog.delete(jobs[0])

    (later,) = rollouts.number_orders(jobs[1], 1)
    assert max(drawn) < later <= 2**31 - 1


def test_events_about_an_order_go_where_it_was_moved(rollouts: Rollouts, jobs: list[str]) -> None:
    moved, kept = rollouts.number_orders(jobs[0], 2)
    rollouts.move_orders([moved], jobs[1])

    assert rollouts.add_event(jobs[0], {}, 1.0, order=moved) == jobs[1]
    assert rollouts.add_event(jobs[0], {}, 1.0, order=kept) == jobs[0]
    assert [len(rollouts.events(job)) for job in jobs] == [1, 1]


def test_what_belongs_to_no_job_is_refused(catalog: Catalog, rollouts: Rollouts, jobs: list[str]) -> None:
    rollouts.begin_rollout(jobs[0], {}, {})
    catalog.delete(jobs[0])

    assert rollouts.rollout(jobs[0]) is None
    for refused in (
        lambda: rollouts.begin_rollout(jobs[0], {}, {}),
        lambda: rollouts.add_event(jobs[0], {}, 1.0),
        lambda: rollouts.number_orders(jobs[0], 1),
    ):
        with pytest.raises(ResourceNotFoundException):
            refused()


def test_a_catalog_that_was_made_without_the_wing_gets_its_tables(url: str, clock: Callable[[], datetime]) -> None:
    Catalog.open(url, clock=clock).close()
    engine = create_engine(url, poolclass=NullPool)
    for table in reversed(TABLES):
        table.drop(engine)

    catalog = Catalog.open(url, clock=clock)

    assert Rollouts(catalog).open_rollouts() == {}
    assert Rollouts(catalog).jobs_with_events() == []
    catalog.close()
