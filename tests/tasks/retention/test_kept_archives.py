"""Kept archives of applications: those that no job names go, and no others."""

from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from helpers.swing_fixtures import Simulate, upload_swinger

from prefect_robomaker.schemas.reports.retention import GcItem, RetentionPolicy
from prefect_robomaker.tasks.operations.registry import call
from prefect_robomaker.tasks.retention.collection import collect, plan_collection
from prefect_robomaker.tasks.retention.kept_archives import collect_archives
from prefect_robomaker.tasks.service.service import Service
from prefect_robomaker.tasks.simulations.inputs.kept_archives import kept_archives

POLICY = RetentionPolicy(older_than=timedelta(days=30))


def later(service: Service, days: int) -> Service:
    """The service some days from now."""
    return replace(service, clock=lambda: datetime.now(UTC) + timedelta(days=days))


def of_archives(items: list[GcItem]) -> list[tuple[int, str | None]]:
    return [(item.objects, item.problem) for item in items if item.id == "kept-archives"]


@pytest.fixture
def two(service: Service, swing: Simulate, tmp_path: Path) -> tuple[str, str]:
    """The ARNs of two jobs, between which the archive was overwritten."""
    first = swing(duration_s=4, TIME_LIMIT_S="1")["arn"]
    upload_swinger(service, tmp_path, b"new weights")
    second = swing(duration_s=4, TIME_LIMIT_S="1")["arn"]
    assert len(list(kept_archives(service))) == 2
    return first, second


def test_an_archive_stays_as_long_as_a_job_names_it(service: Service, two: tuple[str, str]) -> None:
    first, _ = two
    service = later(service, 60)
    assert of_archives(plan_collection(POLICY, service).items) == []
    service.catalog.delete(first)
    assert of_archives(plan_collection(POLICY, service).items) == [(1, None)]
    assert len(list(kept_archives(service))) == 2, "a plan removes nothing"
    collected = collect(POLICY, service)
    assert of_archives(collected.items) == [(1, None)]
    [left] = kept_archives(service)
    etag = call("DescribeRobotApplication", {"application": "pusher"}, service)["sources"][0]["etag"]
    assert left.key.rpartition("/")[2] != etag, "the application is older than the archive of the second job"


def test_a_plan_counts_the_jobs_that_would_go_as_gone(service: Service, two: tuple[str, str]) -> None:
    items = collect_archives(timedelta(days=30), frozenset(two), later(service, 60), act=False)
    assert of_archives(items) == [(2, None)]
    assert items[0].size_bytes == sum(each.size_bytes for each in kept_archives(service))


def test_a_young_archive_stays_since_its_job_may_not_name_it_yet(service: Service, two: tuple[str, str]) -> None:
    for arn in two:
        service.catalog.delete(arn)
    for older_than in (None, timedelta(0), timedelta(days=30)):
        assert collect_archives(older_than, frozenset(), service, act=True) == []
    service = later(service, 2)
    assert collect_archives(timedelta(days=30), frozenset(), service, act=True) == []
    assert of_archives(collect_archives(None, frozenset(), service, act=True)) == [(2, None)]
    assert list(kept_archives(service)) == []
