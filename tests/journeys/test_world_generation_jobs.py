"""Generation jobs: what they make, how they are counted, listed and cancelled."""

import contextvars
import itertools
import json
import threading
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from helpers.known_worlds import make_worlds
from helpers.plan_templates import TEMPLATES
from helpers.processes import wait_for
from helpers.small_flat import BODY

from prefect_robomaker.schemas.wire.arns import world_id
from prefect_robomaker.schemas.wire.errors import (
    IdempotentParameterMismatchException,
    InvalidParameterException,
    ResourceNotFoundException,
    WorldGenerationError,
)
from prefect_robomaker.tasks.execution.leases.giving_up import MAX_LOST_WORKERS
from prefect_robomaker.tasks.execution.task_pool import step_runner
from prefect_robomaker.tasks.operations.registry import call, registry
from prefect_robomaker.tasks.service.service import Service
from prefect_robomaker.tasks.storage import read_manifest
from prefect_robomaker.tasks.worlds.builders import WorldBuilders
from prefect_robomaker.tasks.worlds.generation import generate_world

Generate = Callable[..., dict[str, Any]]
KNOWN = pytest.mark.usefixtures("known_worlds")
"""Used by tests that are not about how worlds are built."""


@pytest.fixture
def submit(service: Service, template: str) -> Callable[..., str]:
    """Stores a generation job that does not run."""

    def run(floorplans: int = 1, **members: Any) -> str:
        count = {"floorplanCount": floorplans, "interiorCountPerFloorplan": 1}
        request = {"template": template, "worldCount": count, "seed": 7, **members}
        return call("CreateWorldGenerationJob", request, service)["arn"]

    return run


def summaries(service: Service, **filters: str) -> list[dict[str, Any]]:
    given = {"filters": [{"name": name, "values": [value]} for name, value in filters.items()]} if filters else {}
    return call("ListWorldGenerationJobs", given, service)["worldGenerationJobSummaries"]


def test_interiors_of_one_floor_plan_share_it(service: Service, generate: Callable[..., dict[str, Any]]) -> None:
    job = generate(floorplans=1, interiors=2, worldTags={"night": "1"})

    assert job["status"] == "Completed"
    assert job["finishedWorldsSummary"]["finishedCount"] == 2
    worlds = [service.catalog.get(arn) for arn in job["finishedWorldsSummary"]["succeededWorlds"]]
    plans = []
    for world in worlds:
        bundle = world.document["bundle"]
        names = {file.path for file in read_manifest(service.store, **bundle).files}
        pictures = {name for name in names if name.startswith(("textures/", "meshes/"))}
        described = {"world.json", "world_description.json", "floorplan.svg"}
        assert names - pictures == {*described, "world.xml", "map.pgm", "map.yaml"}
        assert pictures
        plans.append(json.loads(service.store.get_bytes(bundle["bucket"], bundle["prefix"] + "/world.json")))
    assert plans[0]["floorplan"]["walls"] == plans[1]["floorplan"]["walls"]
    assert plans[0]["furniture"] != plans[1]["furniture"]
    assert call("DescribeWorld", {"world": worlds[0].arn}, service)["tags"] == {"night": "1"}


@KNOWN
@pytest.mark.parametrize(("members", "plans"), [pytest.param({"diversity": 0}, 1, marks=pytest.mark.deep), ({}, 4)])
def test_floor_plans_of_a_job_differ_unless_none_are_to(
    service: Service, submit: Callable[..., str], tmp_path: Path, members: dict[str, int], plans: int
) -> None:
    body = TEMPLATES["guide"].model_dump(mode="json", exclude_unset=True)
    flat = call("CreateWorldTemplate", {"templateBody": body}, service)["arn"]
    job = submit(4, template=flat, **members)
    make_worlds(service, job, 4, tmp_path)
    made = call("DescribeWorldGenerationJob", {"job": job}, service)["finishedWorldsSummary"]
    assert (made["finishedCount"], made["planCount"]) == (4, plans)


@KNOWN
def test_the_same_seed_gives_the_same_worlds(service: Service, generate: Callable[..., dict[str, Any]]) -> None:
    first, second = generate(), generate()

    bundles = [
        service.catalog.get(job["finishedWorldsSummary"]["succeededWorlds"][0]).document["bundle"]
        for job in (first, second)
    ]
    assert first["arn"] != second["arn"]
    assert bundles[0] == bundles[1]


@KNOWN
def test_the_body_is_kept_as_it_was_when_the_job_was_made(
    service: Service, generate: Callable[..., dict[str, Any]], template: str
) -> None:
    job = generate()
    service.catalog.update(template, lambda document: {**document, "templateBody": "{}"})

    body = call("GetWorldTemplateBody", {"generationJob": job["arn"]}, service)["templateBody"]

    assert json.loads(body) == BODY


def test_a_cancelled_job_keeps_no_promise_but_ends(service: Service, template: str, prefect_server: str) -> None:
    count = {"floorplanCount": 1, "interiorCountPerFloorplan": 1}
    job = call("CreateWorldGenerationJob", {"template": template, "worldCount": count}, service)
    service.catalog.request_cancel(job["arn"])

    ended = registry()["CreateWorldGenerationJob"].perform(job["arn"], service)

    assert ended["status"] == "Canceled"


def test_a_client_token_makes_creation_repeatable(service: Service, template: str) -> None:
    count = {"floorplanCount": 1, "interiorCountPerFloorplan": 1}
    request = {"template": template, "worldCount": count, "clientRequestToken": "once"}

    first, again = (call("CreateWorldGenerationJob", request, service) for _ in range(2))

    assert first == again
    with pytest.raises(IdempotentParameterMismatchException):
        call("CreateWorldGenerationJob", {**request, "worldTags": {"other": "1"}}, service)


def test_an_unknown_template_is_not_found(service: Service) -> None:
    arn = "arn:aws:robomaker:us-east-1:000000000000:world-template/template-000000000000"
    count = {"floorplanCount": 1, "interiorCountPerFloorplan": 1}

    with pytest.raises(ResourceNotFoundException, match="template-000000000000"):
        call("CreateWorldGenerationJob", {"template": arn, "worldCount": count}, service)


@pytest.mark.parametrize(("floorplans", "interiors"), [(17, 3), (2**31 - 1, 2**31 - 1)])
def test_a_job_for_too_many_worlds_is_taken_and_fails(generate: Generate, floorplans: int, interiors: int) -> None:
    job = generate(floorplans, interiors)

    assert (job["status"], job["failureCode"]) == ("Failed", "AllWorldGenerationFailed")
    assert f"{floorplans * interiors} worlds; a job may make at most 50" in job["failureReason"]
    assert job["worldCount"] == {"floorplanCount": floorplans, "interiorCountPerFloorplan": interiors}
    assert job["finishedWorldsSummary"]["finishedCount"] == 0


def test_how_many_worlds_a_job_may_make_is_a_setting(service: Service, submit: Callable[..., str]) -> None:
    strict = replace(service, settings=service.settings.model_copy(update={"max_worlds_per_job": 1}))

    job = registry()["CreateWorldGenerationJob"].perform(submit(2), strict)

    assert job["status"] == "Failed"
    assert "2 worlds; a job may make at most 1 " in job["failureReason"]


@pytest.mark.parametrize("count", [{}, {"floorplanCount": 1}, {"floorplanCount": -1, "interiorCountPerFloorplan": 1}])
def test_a_count_that_makes_no_sense_is_refused(service: Service, template: str, count: dict[str, int]) -> None:
    with pytest.raises(InvalidParameterException, match="worldCount"):
        call("CreateWorldGenerationJob", {"template": template, "worldCount": count}, service)
    assert service.catalog.list("world-generation-job").resources == ()


@KNOWN
def test_jobs_are_listed_by_status_and_template(
    service: Service, template: str, generate: Generate, submit: Callable[..., str]
) -> None:
    done, pending = generate(), submit()
    other = call("CreateWorldTemplate", {"templateBody": BODY}, service)["arn"]
    elsewhere = submit(template=other)

    assert [job["arn"] for job in summaries(service)] == [elsewhere, pending, done["arn"]]
    assert [job["arn"] for job in summaries(service, status="Pending")] == [elsewhere, pending]
    assert [job["arn"] for job in summaries(service, templateId=template.split("/")[1])] == [pending, done["arn"]]
    (summary,) = summaries(service, status="Completed")
    assert summary == {
        **{member: done[member] for member in ("arn", "template", "createdAt", "status", "worldCount")},
        "succeededWorldCount": 1,
        "failedWorldCount": 0,
    }
    with pytest.raises(InvalidParameterException, match=r"'template'.*templateId"):
        summaries(service, template="template-x")


def test_failures_are_told_while_the_job_runs(
    service: Service, submit: Callable[..., str], prefect_server: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    arn = submit(2)
    told = []

    def fail(self: WorldBuilders, *arguments: object) -> str:
        told.append(call("DescribeWorldGenerationJob", {"job": arn}, service))
        raise WorldGenerationError("no such flat")

    monkeypatch.setattr(WorldBuilders, "build", fail)
    monkeypatch.setattr("os.cpu_count", lambda: 1)

    job = registry()["CreateWorldGenerationJob"].perform(arn, service)

    assert [each["status"] for each in told] == ["Running", "Running"]
    counts = [each["finishedWorldsSummary"]["failureSummary"]["totalFailureCount"] for each in (*told, job)]
    assert counts == [0, 1, 2]
    assert (job["status"], job["failureCode"]) == ("Failed", "AllWorldGenerationFailed")
    assert [each["failedWorldCount"] for each in summaries(service)] == [2]


def test_a_job_without_a_job_worker_is_cancelled_at_once(service: Service, submit: Callable[..., str]) -> None:
    arn = submit()

    for _ in range(2):
        assert call("CancelWorldGenerationJob", {"job": arn}, service) == {}
        job = call("DescribeWorldGenerationJob", {"job": arn}, service)
        assert job["status"] == "Canceled"
        assert "failureCode" not in job


@KNOWN
def test_cancelling_a_running_job_keeps_the_worlds_it_has_made(
    service: Service, submit: Callable[..., str], prefect_server: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    arn = submit(40)
    perform = registry()["CreateWorldGenerationJob"].perform
    build, begun = WorldBuilders.build, itertools.count()

    def hold(self: WorldBuilders, body: str, *seeds_and_folder: Any) -> str:
        """Builds the first world at once, and others when the job is cancelled; the same one for all seeds."""
        if next(begun):
            wait_for(lambda: service.catalog.cancel_requested(arn), "the cancellation")
        return build(self, body, 1, 1, seeds_and_folder[-1])

    monkeypatch.setattr(WorldBuilders, "build", hold)
    # Prefect finds its server by the context.
    worker = threading.Thread(target=contextvars.copy_context().run, args=(perform, arn, service))
    worker.start()

    def describe() -> dict[str, Any]:
        return call("DescribeWorldGenerationJob", {"job": arn}, service)

    wait_for(lambda: describe()["finishedWorldsSummary"]["succeededWorlds"], "a world")
    call("CancelWorldGenerationJob", {"job": arn}, service)
    at_once = describe()["status"]
    worker.join(200)

    assert not worker.is_alive()
    assert at_once in ("Canceling", "Canceled")
    job = describe()
    assert job["status"] == "Canceled"
    worlds = job["finishedWorldsSummary"]["succeededWorlds"]
    assert 0 < len(worlds) < 40
    for world in worlds:
        assert read_manifest(service.store, **service.catalog.get(world).document["bundle"]).files
    assert summaries(service)[0]["succeededWorldCount"] == len(worlds)


@KNOWN
def test_cancelling_what_has_ended_changes_nothing(service: Service, generate: Generate) -> None:
    job = generate()

    assert call("CancelWorldGenerationJob", {"job": job["arn"]}, service) == {}

    assert call("DescribeWorldGenerationJob", {"job": job["arn"]}, service) == job
    with pytest.raises(ResourceNotFoundException, match="world-generation-job"):
        call("CancelWorldGenerationJob", {"job": job["template"]}, service)


@KNOWN
def test_a_job_that_makes_worlds_outlives_any_number_of_dead_workers(
    service: Service, template: str, tmp_path: Path, prefect_server: str
) -> None:
    count = {"floorplanCount": 1, "interiorCountPerFloorplan": 2}
    request = {"template": template, "worldCount": count, "seed": 7}
    job = call("CreateWorldGenerationJob", request, service)["arn"]
    stored = service.catalog.transition(job, "start")
    first = service.arn("world", world_id(stored.id, 1))
    with WorldBuilders(1, tmp_path / "builders.log") as builders:
        assert generate_world(service, stored, 0, first, builders, step_runner()) is None
    for number in range(MAX_LOST_WORKERS - 1):  # one more fails it
        assert service.catalog.claim(job, f"dies-{number}", -1)

    ended = registry()["CreateWorldGenerationJob"].perform(job, service)

    assert ended["status"] == "Completed"
    assert service.catalog.lost_workers(job) == 0
