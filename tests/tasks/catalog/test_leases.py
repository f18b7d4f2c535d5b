"""What job workers take their jobs with, beyond what the catalog's other tests show."""

from typing import Any

import pytest

from prefect_robomaker.schemas.wire.errors import ResourceNotFoundException
from prefect_robomaker.tasks.catalog import Catalog, ClientToken, FirstLease

BATCH = "simulation-job-batch"


def test_a_lease_that_ran_out_counts_as_a_lost_worker(catalog: Catalog, make_resource: Any, clock: Any) -> None:
    arn = catalog.create(make_resource(1), token=None).arn
    for number in range(3):
        assert catalog.claim(arn, f"host:{number}", 10)
        clock.advance(20)
    assert catalog.lost_workers(arn) == 2

    assert catalog.release(arn, "host:2")
    assert catalog.claim(arn, "host:3", 10)
    assert catalog.claim(arn, "host:3", 10)
    assert catalog.lost_workers(arn) == 2
    with pytest.raises(ResourceNotFoundException):
        catalog.lost_workers(f"{arn}0")


def test_the_leases_of_a_dead_process_end_at_once(catalog: Catalog, make_resource: Any) -> None:
    arns = [catalog.create(make_resource(number), token=None).arn for number in range(3)]
    owners = ["host_a:7:one", "host_a:7:two", "host_a:71:three"]
    for arn, owner in zip(arns, owners, strict=True):
        catalog.claim(arn, owner, 60)

    assert catalog.expire_leases("host_a:7:") == 2
    assert catalog.expire_leases("hostXa:71:") == 0
    assert [job.arn for job in catalog.unfinished(["simulation-job"])] == arns[:2]
    assert [catalog.claim(arn, "another", 60) for arn in arns] == [True, True, False]
    assert catalog.lost_workers(arns[0]) == 1


def test_jobs_of_a_live_batch_wait_for_its_worker(catalog: Catalog, make_resource: Any) -> None:
    batch = catalog.create(make_resource(0, kind=BATCH), token=None).arn
    job = catalog.create(make_resource(1, parent=batch), token=None).arn

    assert [each.arn for each in catalog.unfinished(["simulation-job", BATCH])] == [batch]
    catalog.transition(batch, "fail")
    assert [each.arn for each in catalog.unfinished(["simulation-job", BATCH])] == [job]


def test_a_job_that_is_ordered_for_oneself_is_never_free(catalog: Catalog, make_resource: Any, clock: Any) -> None:
    lease = FirstLease("host:1:a:robomaker run", 30, {"machine": "host"})
    token = ClientToken("CreateSimulationJob", "a-token", "a-hash")
    arn = catalog.create(make_resource(1), token=token, lease=lease).arn
    theirs = catalog.create(make_resource(2), token=None).arn
    ordered_at = clock()

    assert [job.arn for job in catalog.unfinished(["simulation-job"])] == [theirs]
    assert not catalog.claim(arn, "another", 30)
    assert catalog.claim(arn, lease.owner, 30)
    # An equal call finds it, and changes nothing about whose it is.
    again = FirstLease("host:2:b:robomaker run", 30, {"machine": "other"})
    assert catalog.create(make_resource(3), token=token, lease=again).arn == arn
    assert catalog.lease_of(arn)[0] == lease.owner

    mine, nobodys = (catalog.ownerships([arn, theirs])[each] for each in (arn, theirs))
    assert (mine.owner, mine.since, mine.is_held, mine.lost_owner) == (lease.owner, ordered_at, True, None)
    assert mine.needed_environment == {"machine": "host"}
    assert (nobodys.owner, nobodys.is_held, nobodys.needed_environment) == (None, False, None)
    assert [job.arn for job in catalog.ordered_for_oneself()] == [arn]


def test_who_held_a_job_stays_known(catalog: Catalog, make_resource: Any, clock: Any) -> None:
    arn = catalog.create(make_resource(1), token=None, lease=FirstLease("host:1:a", 30, {})).arn
    clock.advance(31)
    assert not catalog.ownerships([arn])[arn].is_held
    assert catalog.claim(arn, "host:2:b", 30)
    taken_at = clock()
    clock.advance(5)
    assert catalog.claim(arn, "host:2:b", 30)

    taken = catalog.ownerships([arn])[arn]
    assert (taken.owner, taken.since, taken.lost_owner) == ("host:2:b", taken_at, "host:1:a")
    assert catalog.release(arn, "host:2:b")
    released = catalog.ownerships([arn, f"{arn}0"])
    assert [(each.owner, each.is_held, each.is_released) for each in released.values()] == [("host:2:b", False, True)]


def test_jobs_that_are_left_out_make_no_room_for_themselves(catalog: Catalog, make_resource: Any) -> None:
    arns = [catalog.create(make_resource(number), token=None).arn for number in range(4)]

    found = catalog.unfinished(["simulation-job"], limit=2, without=arns[:2])
    assert [job.arn for job in found] == arns[2:]
