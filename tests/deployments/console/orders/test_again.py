"""Running again what failed, from the pages of batches and runs."""

import json
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest

from prefect_robomaker.deployments.endpoint.calling.access_keys import AccessKey
from prefect_robomaker.deployments.endpoint.calling.audit_log import AuditLog
from prefect_robomaker.schemas.reports.run_record import JobRecord, RunRecord, StepRecord
from prefect_robomaker.tasks.inspection.run_records import write_record
from prefect_robomaker.tasks.operations.registry import call
from prefect_robomaker.tasks.service.service import Service

Enter = Callable[..., Any]
MOMENT = datetime(2026, 3, 2, tzinfo=UTC)
ADMIN = AccessKey("ADMIN", "word", "admin")
READER = AccessKey("READ", "word", "reader", "read")
RED = AccessKey("RED", "word", "red", "submit", (), ("team=red",))


def order(team: str) -> dict[str, Any]:
    return {
        "maxJobDurationInSeconds": 60,
        "iamRole": "arn:aws:iam::000000000000:role/test",
        "tags": {"team": team},
        "robotApplications": [
            {
                "application": "scout",
                "launchConfig": {"command": ["./drive"], "environmentVariables": {"ROOM": "${{ x }}"}},
            }
        ],
    }


def id_of(arn: str) -> str:
    return arn.rpartition("/")[2]


def batches(service: Service) -> set[str]:
    return {each.id for each in service.catalog.list("simulation-job-batch").resources}


@pytest.fixture
def ended(service: Service) -> Callable[..., str]:
    """Stores a batch that was cancelled before its requests began; returns its ARN."""

    def make(team: str = "red") -> str:
        requests = [order(team), order(team)]
        members = {"createSimulationJobRequests": requests, "tags": {"team": team}}
        arn = call("StartSimulationJobBatch", members, service)["arn"]
        for event in ("start", "complete"):
            service.catalog.transition(arn, event)
        return arn

    return make


def test_what_failed_of_a_batch_is_run_again_as_a_batch(enter: Enter, ended: Any, service: Service) -> None:
    arn, visitor = ended(), enter()
    before = batches(service)
    assert f"/console/batches/{id_of(arn)}/again" in visitor.get(f"/batches/{id_of(arn)}").text
    answer = visitor.send(f"/batches/{id_of(arn)}/again")
    [made] = batches(service) - before
    assert (answer.status_code, answer.headers["location"]) == (303, f"/console/batches/{made}")
    request = service.catalog.get(service.arn("simulation-job-batch", made)).document["request"]
    assert request["createSimulationJobRequests"] == [order("red")] * 2


def test_a_batch_that_goes_on_is_not_run_again(enter: Enter, store_batch: Any, service: Service) -> None:
    arn, visitor = store_batch(2), enter()
    before = batches(service)
    page = visitor.get(f"/batches/{id_of(arn)}").text
    assert ("/cancel" in page, "/again" in page) == (True, False)
    refused = visitor.send(f"/batches/{id_of(arn)}/again")
    assert (refused.status_code, "the batch is InProgress" in refused.text) == (400, True)
    assert batches(service) == before


@pytest.mark.parametrize(("key", "team", "status"), [(READER, "red", 403), (RED, "blue", 404), (RED, "red", 303)])
def test_who_may_run_a_batch_again(
    enter: Enter, ended: Any, service: Service, key: AccessKey, team: str, status: int
) -> None:
    arn = ended(team)
    before = batches(service)
    assert enter(key).send(f"/batches/{id_of(arn)}/again").status_code == status
    assert (batches(service) == before) == (status != 303)


def test_a_refusal_to_run_a_batch_again_is_in_the_audit_log(
    enter: Enter, ended: Any, store_batch: Any, service: Service, tmp_path: Path
) -> None:
    going, red, blue = store_batch(2), ended(), ended("blue")
    with AuditLog(tmp_path / "audit", service.clock) as audit_log:
        admin, of_red = (enter(key, audit_log=audit_log) for key in (ADMIN, RED))
        admin.send(f"/batches/{id_of(going)}/again")
        of_red.send(f"/batches/{id_of(blue)}/again")
        of_red.send(f"/batches/{id_of(red)}/again")
    lines = [json.loads(line) for line in (tmp_path / "audit").read_text().splitlines()]
    assert {line["operation"] for line in lines} == {"StartSimulationJobBatch"}
    assert [(line["caller"], line["outcome"]) for line in lines] == [
        ("admin", "InvalidParameterException"),
        ("red", "ResourceNotFoundException"),
        ("red", "ok"),
    ]
    assert [line["resources"] for line in lines[:2]] == [[going], []]


def write_run(service: Service, arn: str, job: JobRecord) -> Path:
    """Writes the record of a run that ordered a batch; returns its folder."""
    folder = service.folder("runs", "night-20260302T000000000")
    step = StepRecord(name="drive", operation="StartSimulationJobBatch", status="Completed", arn=arn)
    record = RunRecord(
        run_id=folder.name,
        name="night",
        spec_path="night.yaml",
        state="broken",
        exit_code=3,
        started_at=MOMENT,
        ended_at=MOMENT,
        run_dir=folder,
        jobs=[job],
        steps=[step],
    )
    write_record(record)
    return folder


def test_what_failed_of_a_run_is_ordered_again(enter: Enter, ended: Any, runs: Any, service: Service) -> None:
    arn, visitor = ended("blue"), enter()
    folder = write_run(service, arn, JobRecord(label="request 1", status="NotCreated"))
    assert f"/console/runs/{folder.name}/again" in visitor.get(f"/runs/{folder.name}").text
    answer = visitor.send(f"/runs/{folder.name}/again")
    [ordered] = runs.orders
    assert (answer.status_code, ordered.rerun_of.run_id) == (303, folder.name)
    assert ordered.command == ["robomaker", "rerun", folder.name, "--failed"]
    assert "$${{ x }}" in ordered.text
    for key in (READER, RED):
        assert enter(key).send(f"/runs/{folder.name}/again").status_code in (403, 404)
    assert len(runs.orders) == 1


def test_links_of_a_report_lead_to_files_of_its_jobs(enter: Enter, ended: Any, service: Service) -> None:
    place = "file:///out/sim-1/2026 a"
    job = JobRecord(
        label="sim-1", status="Completed", arn=service.arn("simulation-job", "sim-1"), output_uri="file:///out/sim-1/a"
    )
    folder = write_run(service, ended(), job)
    moved = "file:///home-before/out/sim-1/a/result.json"
    places = ("file:///out/sim-1/a/logs/a%20b.log", place, moved, "https://example.org/")
    links = [f'<a href="{each}">' for each in places]
    (folder / "report.html").write_text("".join(links))
    shown = enter().get(f"/runs/{folder.name}/report").text
    assert 'href="/console/jobs/sim-1/files/logs/a%20b.log"' in shown
    assert 'href="/console/jobs/sim-1/files/result.json"' in shown, "the home may have been moved"
    assert 'href="https://example.org/"' in shown
    assert 'href="file:' not in shown
