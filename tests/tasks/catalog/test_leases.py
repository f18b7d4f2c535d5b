"""What job workers take their jobs with, beyond what the catalog's other tests show."""

from typing import Any

import pytest
from sqlalchemy import text

from prefect_robomaker.schemas.wire.errors import ResourceNotFoundException
from prefect_robomaker.tasks.catalog import Catalog

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


def test_a_catalog_from_before_losses_were_counted_opens(url: str, clock: Any, make_resource: Any) -> None:
    first = Catalog.open(url, clock=clock)
    arn = first.create(make_resource(1), token=None).arn
    with first._engine.begin() as connection:
        connection.execute(text("ALTER TABLE resources DROP COLUMN lost_performers"))
        connection.execute(text("DELETE FROM schema_version WHERE version >= 3"))
    first.close()

    second = Catalog.open(url, clock=clock)
    assert second.lost_workers(arn) == 0
    second.close()
