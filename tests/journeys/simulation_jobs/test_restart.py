"""Restarting simulation jobs, with real processes."""

import shutil
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from helpers.job_worker_process import AwaitStatus, PerformElsewhere
from helpers.paths import BUNDLES
from helpers.processes import wait_for, working_below

from prefect_robomaker.schemas.wire.errors import InvalidParameterException, StorageFullError
from prefect_robomaker.tasks.jobs import job_runs
from prefect_robomaker.tasks.operations.registry import call
from prefect_robomaker.tasks.runtime.limits.logs import STDOUT_LOG
from prefect_robomaker.tasks.service.service import Service, Timing
from prefect_robomaker.tasks.storage import pack_tar_gz, read_manifest

Order = Callable[..., dict[str, Any]]
LONG = {"DURATION_S": "200"}


def restart(service: Service, arn: str) -> None:
    assert call("RestartSimulationJob", {"job": arn}, service) == {}


def log_of(service: Service, place: dict[str, str]) -> str:
    return service.store.get_bytes(place["bucket"], f"{place['prefix']}/logs/stdout.log").decode()


def change_applications(service: Service, folder: Path, was: str, becomes: str) -> None:
    """Gives both applications another archive."""
    shutil.copytree(BUNDLES / "sleeper", folder, ignore=shutil.ignore_patterns("__pycache__"))
    module = folder / "sleeper" / "__init__.py"
    module.write_text(module.read_text().replace(was, becomes))
    archive = folder.with_suffix(".tar.gz")
    pack_tar_gz(folder, archive)
    service.store.put_file("applications", archive.name, archive)
    source = [{"s3Bucket": "applications", "s3Key": archive.name}]
    content = {"sources": source, "robotSoftwareSuite": {"name": "General"}}
    call("UpdateRobotApplication", {"application": "watcher", **content}, service)
    content["simulationSoftwareSuite"] = {"name": "SimulationRuntime"}
    call("UpdateSimulationApplication", {"application": "sleeper", **content}, service)


@pytest.mark.deep
def test_a_restarted_job_runs_again_from_the_start_with_what_its_applications_are_by_then(
    service: Service, order: Order, perform_elsewhere: PerformElsewhere, await_status: AwaitStatus, tmp_path: Path
) -> None:
    arn = call("CreateSimulationJob", order(LONG, maxJobDurationInSeconds=20), service)["arn"]
    with perform_elsewhere(arn) as worker:
        first = await_status(arn, "Running")
        wait_for(lambda: any(log.stat().st_size for log in service.settings.home.rglob(STDOUT_LOG)), "its first words")
        old = working_below(service.settings.home)
        change_applications(service, tmp_path / "changed", "agent watches", "agent guards")
        time.sleep(2)

        restart(service, arn)
        assert call("DescribeSimulationJob", {"job": arn}, service)["status"] == "Restarting"
        with pytest.raises(InvalidParameterException, match=r"job: arn:.* is Restarting; only a job that is Running"):
            restart(service, arn)
        second = await_status(arn, "Running")
        assert not old & working_below(service.settings.home)
        job = await_status(arn, "Completed", "Failed")
        assert job["status"] == "Completed", job["failureReason"]
        worker.wait(200)

    assert job["simulationTimeMillis"] >= 20_000, "the limit of 20 s counts from the restart"
    assert second["lastStartedAt"] > first["lastStartedAt"]
    assert second["networkInterface"] == first["networkInterface"]
    document = service.catalog.get(arn).document
    [earlier] = document["earlierRuns"]
    assert document["runId"] != earlier["runId"]
    assert document["outputs"]["prefix"].endswith(f"/{job['name']}/{document['runId']}")
    assert f"agent watches {job['name']}" in log_of(service, earlier["outputs"])
    assert f"agent guards {job['name']}" in log_of(service, document["outputs"])
    assert read_manifest(service.store, **earlier["outputs"]).about["restarted"] is True
    assert read_manifest(service.store, **document["outputs"]).about["status"] == "Completed"
    assert not list((service.settings.home / "jobs").iterdir())


def test_a_restarted_job_can_be_cancelled(service: Service, order: Order, await_status: AwaitStatus) -> None:
    arn = call("CreateSimulationJob", order(LONG, maxJobDurationInSeconds=600), service)["arn"]
    worker = threading.Thread(target=job_runs.perform_job, args=(arn, service), daemon=True)
    worker.start()
    await_status(arn, "Running")
    restart(service, arn)
    call("CancelSimulationJob", {"job": arn}, service)
    with pytest.raises(InvalidParameterException, match="is being cancelled"):
        restart(service, arn)
    await_status(arn, "Canceled")
    worker.join(200)
    assert not worker.is_alive()
    assert not working_below(service.settings.home)


def test_only_a_running_job_is_restarted(service: Service, order: Order) -> None:
    arn = call("CreateSimulationJob", order(), service)["arn"]
    with pytest.raises(InvalidParameterException, match=r"job: arn:.* is Pending; only a job that is Running"):
        restart(service, arn)

    job_runs.perform_job(arn, service)

    with pytest.raises(InvalidParameterException, match="is Completed"):
        restart(service, arn)


def test_a_job_whose_worker_died_is_restarted_by_the_next(service: Service, order: Order) -> None:
    arn = call("CreateSimulationJob", order(), service)["arn"]
    service.catalog.transition(arn, "prepare", document_changes={"runId": "2026-01-02T03-04-05-000000Z"})
    service.catalog.transition(arn, "start", document_changes={"lastStartedAt": "2026-01-02T03:04:05+00:00"})

    restart(service, arn)
    assert call("DescribeSimulationJob", {"job": arn}, service)["status"] == "Restarting"
    job_runs.perform_job(arn, service)

    job = call("DescribeSimulationJob", {"job": arn}, service)
    assert job["status"] == "Completed"
    assert job["lastStartedAt"].year > 2025
    assert service.catalog.get(arn).document["outputs"]


@pytest.fixture
def restart_at_the_end(service: Service, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Restarts each job when its first run has just ended by itself; returns the ids of all runs."""
    real, runs = job_runs.launcher(), []

    class Slow:
        def run(self, plan: Any, stop: Any, **options: Any) -> Any:
            outcome = real.run(plan, stop, **options)
            runs.append(plan.run_id)
            if len(runs) == 1:
                restart(service, plan.job_arn)
            return outcome

    monkeypatch.setattr(job_runs, "launcher", Slow)
    return runs


def test_no_restart_is_lost_when_the_run_ends_at_the_same_moment(
    service: Service, order: Order, restart_at_the_end: list[str]
) -> None:
    arn = call("CreateSimulationJob", order(), service)["arn"]

    job_runs.perform_job(arn, service)

    assert call("DescribeSimulationJob", {"job": arn}, service)["status"] == "Completed"
    document = service.catalog.get(arn).document
    assert [document["earlierRuns"][0]["runId"], document["runId"]] == restart_at_the_end
    assert document["earlierRuns"][0]["status"] == "Completed"


@pytest.mark.parametrize("timing", [Timing(store_patience_s=0.0)], ids=["without patience"])
def test_outputs_of_an_earlier_run_that_cannot_be_stored_stay_and_the_restart_goes_on(
    service: Service, order: Order, restart_at_the_end: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    arn = call("CreateSimulationJob", order(), service)["arn"]
    put_files = service.store.put_files

    def full_at_first(*arguments: Any, **options: Any) -> Any:
        if len(restart_at_the_end) == 1:
            raise StorageFullError("no space left")
        return put_files(*arguments, **options)

    monkeypatch.setattr(service.store, "put_files", full_at_first)
    job_runs.perform_job(arn, service)

    assert call("DescribeSimulationJob", {"job": arn}, service)["status"] == "Completed"
    [earlier] = service.catalog.get(arn).document["earlierRuns"]
    assert "no space left" in earlier["notStored"]
    kept = list((service.settings.home / "jobs" / arn.rsplit("/", 1)[1]).iterdir())
    assert [folder.name for folder in kept] == [earlier["runId"]]
    assert (kept[0] / "output" / "result.json").is_file()
