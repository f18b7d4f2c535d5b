"""Records of runs for a page that is followed: a restricted key is not asked about at each look."""

import json
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any, cast

import pytest
from helpers.night_records import make_job, make_night, store_night

from prefect_robomaker.deployments.console import overview
from prefect_robomaker.deployments.console.batch_caches import BatchBriefs
from prefect_robomaker.deployments.console.run_records import SeenRecords
from prefect_robomaker.deployments.console.visit import Visit
from prefect_robomaker.deployments.endpoint.calling.access_keys import AccessKey
from prefect_robomaker.schemas.reports.run_record import RunRecord, StepRecord
from prefect_robomaker.tasks.service.service import Service

RED = AccessKey("RED", "word", "red", "submit", (), ("team=red",))


@pytest.fixture
def visit(service: Service) -> Visit:
    """A visit with a key that sees what has the tag `team=red`."""
    posters = SimpleNamespace(of=lambda _: set())
    known: Any = SimpleNamespace(service=service, briefs=BatchBriefs(service.catalog), posters=posters)
    return Visit(cast("Any", None), known, cast("Any", SimpleNamespace(key=RED)))


@pytest.fixture
def asked(service: Service, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """ARNs that the catalog was asked for."""
    found: list[str] = []
    get_many = service.catalog.get_many

    def counted(arns: Any, *rest: Any, **more: Any) -> Any:
        listed = list(arns)
        found.extend(listed)
        return get_many(listed, *rest, **more)

    monkeypatch.setattr(service.catalog, "get_many", counted)
    return found


@pytest.fixture
def night(service: Service, store_job: Callable[..., str]) -> RunRecord:
    """A night of two failed jobs of the red team, whose record is not stored yet."""
    record = make_night("F", runs=service.settings.home / "runs")
    ids = [
        store_job(verdict="FAIL", verdict_reason="quick: 5 s", tags={"team": "red"}, spec_run=record.run_id)
        for _ in range(2)
    ]
    jobs = [
        make_job(place, "F").model_copy(update={"label": each, "arn": service.arn("simulation-job", each)})
        for place, each in enumerate(ids)
    ]
    step = StepRecord(name="drive", operation="CreateSimulationJob", status="Completed", arn=jobs[0].arn)
    return record.model_copy(update={"jobs": jobs, "steps": [step]})


def test_whether_a_run_may_be_seen_is_asked_once_a_minute(
    service: Service, visit: Visit, night: RunRecord, asked: list[str]
) -> None:
    now_s = 1000.0
    records = SeenRecords(visit, lambda: now_s)
    assert records.of(night.run_id) is None
    store_night(night)
    for _ in range(3):
        seen = records.of(night.run_id)
        assert seen is not None, "a run that has just ended is there at the next look"
        assert seen.run_id == night.run_id
    once = len(asked)
    assert once > 0
    service.catalog.set_tags(night.jobs[1].arn or "", {"team": "blue"})
    now_s += 61
    assert records.of(night.run_id) is None
    assert len(asked) > once


def test_a_followed_first_page_does_not_ask_again(
    visit: Visit, night: RunRecord, asked: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    store_night(night)
    looks: list[Callable[[], Any]] = []
    monkeypatch.setattr(Visit, "follow", lambda _, look, every_s: looks.append(look))
    overview.follow(visit)
    [look] = looks
    assert "gentle" in json.dumps(list(look())), "the words of the run's record"
    first = len(asked)
    assert first >= len(night.jobs)
    assert list(look()) == []
    assert len(asked) == first
