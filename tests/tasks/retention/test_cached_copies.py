"""Copies that are cached: those go that nothing has used for long, and the answer says how much that is."""

import os
from datetime import timedelta
from pathlib import Path

from prefect_robomaker.schemas.reports.retention import GcItem, RetentionPolicy
from prefect_robomaker.tasks.retention.collection import collect, plan_collection
from prefect_robomaker.tasks.service.service import Service

MONTH = RetentionPolicy(older_than=timedelta(days=30))


def copy_used(service: Service, cache: str, name: str, days: int) -> Path:
    """A copy of two files that was last used so many days ago."""
    folder = service.folder("cache", cache, name, "package")
    (folder / "model.xml").write_bytes(b"x" * 1000)
    (folder.parent / "about").write_bytes(b"y" * 234)
    used = (service.clock() - timedelta(days=days)).timestamp()
    os.utime(folder.parent, (used, used))
    return folder.parent


def copies(items: list[GcItem]) -> list[tuple[str, int, int]]:
    return [(item.id, item.objects, item.size_bytes) for item in items if item.kind == "copies"]


def test_copies_go_that_nothing_used_for_long(service: Service) -> None:
    old = [copy_used(service, "applications", "a", 40), copy_used(service, "applications", "b", 31)]
    young, world = copy_used(service, "applications", "c", 29), copy_used(service, "worlds", "w", 40)
    expected = [("cache/applications", 4, 2468), ("cache/worlds", 2, 1234)]

    assert copies(plan_collection(MONTH, service).items) == expected
    assert all(path.exists() for path in (*old, world))
    told = collect(MONTH, service)

    assert (copies(told.items), told.problems) == (expected, [])
    assert [path.exists() for path in (*old, young, world)] == [False, False, True, False]
    assert copies(collect(MONTH, service).items) == []


def test_what_a_job_may_still_read_stays_whatever_the_age_is(service: Service) -> None:
    copy_used(service, "applications", "a", 13)
    copy_used(service, "applications", "b", 15)

    told = collect(RetentionPolicy(older_than=timedelta(0)), service)

    assert [path.name for path in (service.settings.home / "cache" / "applications").glob("[!.]*")] == ["a"]
    assert copies(told.items) == [("cache/applications", 2, 1234)]


def test_without_an_age_copies_stay(service: Service) -> None:
    copy_used(service, "worlds", "w", 400)

    assert copies(collect(RetentionPolicy(keep_runs=0), service).items) == []
