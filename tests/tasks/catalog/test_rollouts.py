"""Rollouts in the catalog: their revisions, the numbers of orders, and events that wait."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import pytest

from prefect_robomaker.schemas.wire.errors import ResourceNotFoundException
from prefect_robomaker.tasks.catalog import Catalog, NewResource

MakeResource = Callable[..., NewResource]
FLEETS = ("yard", "dock")


@pytest.fixture
def jobs(catalog: Catalog, make_resource: MakeResource) -> list[str]:
    """Two deployment jobs, each of a fleet of its own."""
    made = (make_resource(number, kind="deployment-job", parent=fleet) for number, fleet in enumerate(FLEETS))
    return [catalog.create(job, token=None).arn for job in made]


def test_a_rollout_is_changed_by_one_of_several(catalog: Catalog, jobs: list[str]) -> None:
    assert catalog.rollout(jobs[0]) is None
    assert catalog.begin_rollout(jobs[0], {"file": "a"}, {"step": 0})
    assert not catalog.begin_rollout(jobs[0], {"file": "b"}, {"step": 9})

    with ThreadPoolExecutor(8) as pool:
        won = list(pool.map(lambda step: catalog.replace_rollout(jobs[0], 1, {"step": step}, is_open=True), range(8)))

    assert won.count(True) == 1
    found = catalog.rollout(jobs[0])
    assert found is not None
    assert (found.revision, found.delivery, found.rollout) == (2, {"file": "a"}, {"step": won.index(True)})


def test_open_rollouts_are_found_by_fleet(catalog: Catalog, jobs: list[str]) -> None:
    for job in reversed(jobs):
        catalog.begin_rollout(job, {}, {})

    assert list(catalog.open_rollouts().items()) == [(jobs[0], 1), (jobs[1], 1)]
    assert catalog.open_rollouts("dock") == {jobs[1]: 1}

    catalog.replace_rollout(jobs[1], 1, {}, is_open=False)
    assert catalog.open_rollouts() == {jobs[0]: 1}


def test_events_wait_in_order_until_they_are_applied(catalog: Catalog, jobs: list[str]) -> None:
    catalog.begin_rollout(jobs[0], {}, {})
    for number in range(3):
        catalog.add_event(jobs[0], {"number": number}, 100.5 + number)
    catalog.add_event(jobs[1], {"number": 9}, 1.0)
    waiting = catalog.events(jobs[0])
    assert [(each.event["number"], each.at_s) for each in waiting] == [(0, 100.5), (1, 101.5), (2, 102.5)]

    applied = [each.sequence for each in waiting[:2]]
    assert not catalog.replace_rollout(jobs[0], 7, {}, is_open=True, applied=applied), "others changed it"
    assert len(catalog.events(jobs[0])) == 3
    assert catalog.replace_rollout(jobs[0], 1, {}, is_open=True, applied=applied)

    assert [each.event["number"] for each in catalog.events(jobs[0])] == [2]
    assert catalog.jobs_with_events() == sorted(jobs)
    assert [each.event["number"] for each in catalog.events(jobs[1])] == [9]


def test_numbers_of_orders_grow_and_never_return(catalog: Catalog, jobs: list[str]) -> None:
    with ThreadPoolExecutor(4) as pool:
        drawn = [each for some in pool.map(lambda _: catalog.number_orders(jobs[0], 3), range(8)) for each in some]
    assert len(set(drawn)) == 24
    assert min(drawn) >= 1

    catalog.delete(jobs[0])

    (later,) = catalog.number_orders(jobs[1], 1)
    assert max(drawn) < later <= 2**31 - 1


def test_events_about_an_order_go_where_it_was_moved(catalog: Catalog, jobs: list[str]) -> None:
    moved, kept = catalog.number_orders(jobs[0], 2)
    catalog.move_orders([moved], jobs[1])

    assert catalog.add_event(jobs[0], {}, 1.0, order=moved) == jobs[1]
    assert catalog.add_event(jobs[0], {}, 1.0, order=kept) == jobs[0]
    assert [len(catalog.events(job)) for job in jobs] == [1, 1]


def test_what_belongs_to_no_job_is_refused(catalog: Catalog, jobs: list[str]) -> None:
    catalog.begin_rollout(jobs[0], {}, {})
    catalog.delete(jobs[0])

    assert catalog.rollout(jobs[0]) is None
    for refused in (
        lambda: catalog.begin_rollout(jobs[0], {}, {}),
        lambda: catalog.add_event(jobs[0], {}, 1.0),
        lambda: catalog.number_orders(jobs[0], 1),
    ):
        with pytest.raises(ResourceNotFoundException):
            refused()
