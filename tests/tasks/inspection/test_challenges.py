"""A challenge that runs tells of each sabotage once that it runs, and once that a job has noticed it."""

from datetime import UTC, datetime
from types import SimpleNamespace
from typing import Any, cast

import pytest

from prefect_robomaker.schemas.wire.errors import ServiceUnavailableException
from prefect_robomaker.tasks.catalog import Page, Resource
from prefect_robomaker.tasks.inspection.challenges import SabotageNotes

MOMENT = datetime(2026, 3, 2, tzinfo=UTC)


def arm(number: int, sabotage: str | None, status: str, **document: Any) -> Resource:
    """A job of a challenge, in the state in which the catalog has it."""
    tags = {"challenged-job": str(number), **({"sabotage": sabotage} if sabotage else {})}
    new = Resource.new(arn=f"arn:{number}-{sabotage}", kind="simulation-job", id=f"sim-{number}-{sabotage}", tags=tags)
    known = {**vars(new), "status": status, "document": document}
    return Resource(**known, created_at=MOMENT, updated_at=MOMENT, revision=1)


@pytest.fixture
def looks() -> Any:
    """Lets a challenge look at jobs, the newest last, and returns what it tells."""
    told: list[str] = []
    found: list[Resource] = []

    def list_of(_: str, *, filters: dict[str, list[str]], **__: Any) -> Page:
        assert filters == {"parent": ["arn:batch"]}
        if not found:
            raise ServiceUnavailableException("the catalog is away")
        return Page(tuple(reversed(found)), None)

    notes = SabotageNotes(cast("Any", SimpleNamespace(list=list_of)), told.append)

    def look(*jobs: Resource) -> list[str]:
        found[:] = jobs
        told.clear()
        notes.look("arn:batch")
        return list(told)

    return look


def test_each_sabotage_is_told_when_it_runs_and_when_it_is_noticed(looks: Any) -> None:
    real = arm(1, None, "Completed", verdict="PASS")
    waiting = arm(1, "late", "Pending")
    assert looks(real, arm(1, "idle", "Running"), waiting) == ["sabotage idle: runs"]
    noticed = arm(1, "idle", "Completed", verdict="FAIL", verdictReason="to-bed: not there by 120 s")
    assert looks(real, noticed, waiting) == ["sabotage idle: noticed (to-bed: not there by 120 s)"]
    crashed = arm(1, "late", "Failed", failureCode="RobotApplicationCrash")
    assert looks(real, noticed, crashed) == ["sabotage late: runs", "sabotage late: noticed (a crash)"]
    assert looks(real, noticed, crashed) == []


@pytest.mark.parametrize(
    "jobs",
    [
        (arm(1, None, "Completed", verdict="FAIL"), arm(1, "idle", "Completed", verdict="FAIL")),
        (arm(1, None, "Running"), arm(1, "idle", "Completed", verdict="FAIL")),
        (arm(1, None, "Completed", verdict="PASS"), arm(1, "idle", "Completed", verdict="PASS")),
        (arm(1, None, "Completed", verdict="PASS"), arm(1, "idle", "Failed", failureCode="InternalServiceError")),
    ],
    ids=["the robot fails anyway", "not known yet", "missed", "broken"],
)
def test_nothing_is_noticed_by_other_ends(looks: Any, jobs: tuple[Resource, ...]) -> None:
    assert looks(*jobs) == ["sabotage idle: runs"]


def test_nothing_is_told_while_the_catalog_is_away(looks: Any) -> None:
    assert looks() == []
