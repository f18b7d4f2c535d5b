"""Cancelling simulation jobs, with real processes."""

import json
from collections.abc import Callable
from hashlib import sha256
from typing import Any

import pytest
from helpers.job_worker_process import AwaitStatus, PerformElsewhere
from helpers.processes import wait_for, working_below

from prefect_robomaker.schemas.wire.errors import ObjectNotFoundError, ResourceNotFoundException
from prefect_robomaker.tasks.jobs import job_runs
from prefect_robomaker.tasks.operations.registry import call
from prefect_robomaker.tasks.runtime.limits.logs import STDOUT_LOG
from prefect_robomaker.tasks.service.service import Service
from prefect_robomaker.tasks.storage import read_manifest

Order = Callable[..., dict[str, Any]]
LONG = {"DURATION_S": "1000"}


def place_of(service: Service, arn: str) -> dict[str, str]:
    return service.catalog.get(arn).document["outputs"]


@pytest.mark.deep
def test_a_job_that_another_process_performs_ends_and_keeps_its_outputs(
    service: Service, order: Order, perform_elsewhere: PerformElsewhere, await_status: AwaitStatus
) -> None:
    arn = call("CreateSimulationJob", order({**LONG, "SPAWN": "1"}), service)["arn"]
    with perform_elsewhere(arn) as worker:
        await_status(arn, "Running")
        wait_for(lambda: len(working_below(service.settings.home)) >= 2, "the run and the program it starts")

        assert call("CancelSimulationJob", {"job": arn}, service) == {}
        job = await_status(arn, "Canceled")
        assert worker.wait(200) == 0

    assert not working_below(service.settings.home)
    assert "failureCode" not in job
    assert "failureReason" not in job
    paths = {file.path for file in read_manifest(service.store, **place_of(service, arn)).files}
    assert {"result.json", "logs/stdout.log"} <= paths


def test_a_job_without_a_job_worker_ends_at_once(service: Service, order: Order) -> None:
    arn = call("CreateSimulationJob", order(), service)["arn"]

    call("CancelSimulationJob", {"job": arn}, service)

    job = call("DescribeSimulationJob", {"job": arn}, service)
    assert job["status"] == "Canceled"
    assert not {"failureCode", "failureReason", "lastStartedAt", "networkInterface"} & set(job)
    job_runs.perform_job(arn, service)
    assert call("DescribeSimulationJob", {"job": arn}, service) == job


@pytest.mark.parametrize(("duration_s", "variables"), [(1, LONG), (60, {"DURATION_S": "0.2", "VERDICT": "PASS"})])
def test_a_cancel_that_was_answered_in_the_moment_of_the_end_counts(
    service: Service, order: Order, monkeypatch: pytest.MonkeyPatch, duration_s: int, variables: dict[str, str]
) -> None:
    request = order(variables) | {"maxJobDurationInSeconds": duration_s}
    arn = call("CreateSimulationJob", request, service)["arn"]
    launcher = job_runs.launcher()

    class CancelledAtTheEnd:
        def run(self, *arguments: Any, **options: Any) -> Any:
            ended = launcher.run(*arguments, **options)
            assert ended.status == "Completed"
            call("CancelSimulationJob", {"job": arn}, service)
            return ended

    monkeypatch.setattr(job_runs, "launcher", CancelledAtTheEnd)
    job_runs.perform_job(arn, service)

    job = call("DescribeSimulationJob", {"job": arn}, service)
    assert (job["status"], job.get("failureCode")) == ("Canceled", None)
    place = place_of(service, arn)
    result = json.loads(service.store.get_bytes(place["bucket"], f"{place['prefix']}/result.json"))
    assert result["verdict"] == "NONE"
    assert service.catalog.get(arn).document["verdict"] is None


@pytest.mark.parametrize(
    ("method", "when", "verdict", "says"),
    [
        pytest.param("put_files", "before", "NONE", "Canceled", marks=pytest.mark.deep),
        ("put_files", "after", "NONE", "Canceled"),
        ("put_bytes", "before", "PASS", "Completed"),  # the manifest is on its way
        pytest.param("put_bytes", "after", "PASS", "Completed", marks=pytest.mark.deep),
    ],
)
def test_a_cancel_that_was_answered_while_outputs_are_stored_counts(
    service: Service, order: Order, monkeypatch: pytest.MonkeyPatch, method: str, when: str, verdict: str, says: str
) -> None:
    arn = call("CreateSimulationJob", order({"DURATION_S": "0.2", "VERDICT": "PASS"}), service)["arn"]
    store = getattr(service.store, method)

    def cancelled_meanwhile(*arguments: Any, **options: Any) -> Any:
        answer = store(*arguments, **options) if when == "after" else None
        assert call("DescribeSimulationJob", {"job": arn}, service)["status"] == "Terminating"
        assert call("CancelSimulationJob", {"job": arn}, service) == {}
        return answer or store(*arguments, **options)

    monkeypatch.setattr(service.store, method, cancelled_meanwhile)
    job_runs.perform_job(arn, service)

    job = call("DescribeSimulationJob", {"job": arn}, service)
    assert (job["status"], job.get("failureCode")) == ("Canceled", None)
    place = place_of(service, arn)
    manifest = read_manifest(service.store, **place)
    assert manifest.about["status"] == says
    stored = {
        file.path: service.store.get_bytes(place["bucket"], f"{place['prefix']}/{file.path}") for file in manifest.files
    }
    assert {path: sha256(content).hexdigest() for path, content in stored.items()} == {
        file.path: file.sha256 for file in manifest.files
    }
    assert json.loads(stored["result.json"])["verdict"] == verdict
    assert service.catalog.get(arn).document["verdict"] is None
    assert not list((service.settings.home / "jobs").iterdir())


def test_cancelling_a_job_that_has_ended_changes_nothing(service: Service, order: Order) -> None:
    arn = call("CreateSimulationJob", order(), service)["arn"]
    job_runs.perform_job(arn, service)
    ended = call("DescribeSimulationJob", {"job": arn}, service)
    assert ended["status"] == "Completed"

    assert call("CancelSimulationJob", {"job": arn}, service) == {}

    assert call("DescribeSimulationJob", {"job": arn}, service) == ended


@pytest.mark.deep
def test_what_a_dead_worker_run_left_is_stored_without_a_manifest(
    service: Service, order: Order, perform_elsewhere: PerformElsewhere, await_status: AwaitStatus
) -> None:
    arn = call("CreateSimulationJob", order(LONG), service)["arn"]
    with perform_elsewhere(arn) as worker:
        await_status(arn, "Running")
        wait_for(lambda: any(log.stat().st_size for log in service.settings.home.rglob(STDOUT_LOG)), "its first words")
        worker.kill()
        wait_for(lambda: not working_below(service.settings.home), "the end of the run")
    wait_for(lambda: service.catalog.lease_of(arn)[1], "the end of the job worker's lease")

    call("CancelSimulationJob", {"job": arn}, service)

    assert call("DescribeSimulationJob", {"job": arn}, service)["status"] == "Canceled"
    place = place_of(service, arn)
    assert service.store.get_bytes(place["bucket"], f"{place['prefix']}/logs/stdout.log")
    with pytest.raises(ObjectNotFoundError):
        read_manifest(service.store, **place)
    assert not list((service.settings.home / "jobs").iterdir())


@pytest.mark.parametrize("operation", ["CancelSimulationJob", "RestartSimulationJob"])
def test_a_job_that_does_not_exist_is_not_found(service: Service, template: str, operation: str) -> None:
    with pytest.raises(ResourceNotFoundException, match="sim-000000000000"):
        call(operation, {"job": service.arn("simulation-job", "sim-000000000000")}, service)
    with pytest.raises(ResourceNotFoundException, match="is a world-template; give the ARN of a simulation-job"):
        call(operation, {"job": template}, service)
    assert not service.catalog.cancel_requested(template)
