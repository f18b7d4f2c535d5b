"""Nights whose processes are killed: the next process of the data home finishes them, as one night with one report."""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from helpers.endpoint_process import Serve
from helpers.paths import BUNDLES
from helpers.processes import kill_tree, process_worker, started, wait_for

from prefect_robomaker.schemas.reports.run_record import RunRecord
from prefect_robomaker.tasks.service.service import Service

pytestmark = [pytest.mark.deep, pytest.mark.timeout(1800)]

ROBOMAKER = [sys.executable, "-m", "prefect_robomaker.deployments.cli.main"]
SUITE = {"name": "General"}
MINE = {"PYTHONPATH": str(BUNDLES / "sleeper"), "PYTHONDONTWRITEBYTECODE": "1"}
"""Variables with which the night's application is found, and without which it is not."""


def state_of(client: Any, flow_run: Any) -> Any:
    """The state of a flow run in Prefect."""
    return client.read_flow_run(flow_run).state


def night(duration_s: float = 3.0, jobs: int = 6) -> str:
    """A night of two batches, the second of which follows the first."""

    def batch(seed: int, count: int) -> dict[str, Any]:
        request = {
            "maxJobDurationInSeconds": 300,
            "seed": seed,
            "robotApplications": [{"application": "watcher", "launchConfig": {"launchFile": "make_agent"}}],
            "simulationApplications": [
                {
                    "application": "room",
                    "launchConfig": {
                        "launchFile": "make_environment",
                        "environmentVariables": {"DURATION_S": str(duration_s)},
                    },
                }
            ],
        }
        return {"createSimulationJobRequests": [request] * count, "batchPolicy": {"maxConcurrency": 2}}

    room = {
        "name": "room", "environment": {"uri": "python://sleeper"}, "robotSoftwareSuite": SUITE,
        "simulationSoftwareSuite": {"name": "SimulationRuntime"},
    }  # fmt: skip
    watcher = {"name": "watcher", "environment": {"uri": "python://sleeper"}, "robotSoftwareSuite": SUITE}
    made = ["room", "watcher"]
    steps = {
        "room": {"operation": "CreateSimulationApplication", "input": room, "ifExists": "reuse"},
        "watcher": {"operation": "CreateRobotApplication", "input": watcher, "ifExists": "reuse"},
        "drive": {"operation": "StartSimulationJobBatch", "needs": made, "input": batch(1, jobs)},
        "after": {"operation": "StartSimulationJobBatch", "needs": [*made, "drive"], "input": batch(2, 1)},
    }
    return json.dumps({"version": 1, "name": "night", "steps": steps})


def begin_night(client: Any, pool: str) -> Any:
    """Makes a deployment of the night as `robomaker deploy --schedule` does, and has Prefect begin a run of it.

    Not by a schedule: a busy server would notice one too late.
    """
    from prefect_robomaker.flows.pipelines import RunPipeline
    from prefect_robomaker.tasks.execution.schedule_overlaps import OVERLAP, RUNS_AT_ONCE

    deployment = client.create_deployment(
        flow_id=client.create_flow(RunPipeline),
        name=pool,
        work_pool_name=pool,
        entrypoint="prefect_robomaker.flows.pipelines:RunPipeline",
        pull_steps=[],
        parameters={"text": night(), "origin": "night.yaml"},
        job_variables={"env": MINE},
        # The dead run may hold the only place.
        concurrency_limit=RUNS_AT_ONCE,
        concurrency_options=OVERLAP,
    )
    client.create_flow_run_from_deployment(deployment)
    return deployment


def runs_of(client: Any, deployment: Any) -> list[Any]:
    from prefect.client.schemas.filters import DeploymentFilter, DeploymentFilterId

    chosen = DeploymentFilter(id=DeploymentFilterId(any_=[deployment]))
    return sorted(client.read_flow_runs(deployment_filter=chosen), key=lambda run: run.created)


def in_the_middle(service: Service) -> str:
    """Waits until a batch has both done and running jobs; returns it."""

    def found() -> str | None:
        for batch in service.catalog.list("simulation-job-batch").resources:
            counts = service.catalog.count_children(batch.arn, "simulation-job")
            if counts.get("Completed", 0) >= 2 and counts.get("Running"):
                return batch.arn
        return None

    batch = wait_for(found, "the middle of the night", 600)
    assert batch is not None
    return batch


def record_of(service: Service) -> RunRecord:
    """The record of the only run, once there is one."""
    runs = service.settings.home / "runs"
    wait_for(lambda: list(runs.glob("*/run.json")), "the record of the night", 300)
    [path] = runs.glob("*/run.json")
    return RunRecord.model_validate_json(path.read_text())


def check_finished(service: Service, before: dict[str, Any]) -> RunRecord:
    """Checks that a night was finished, and that nothing of it was done twice."""
    record = record_of(service)
    assert (record.state, [step.status for step in record.steps]) == ("succeeded", ["Completed"] * 4), record.steps
    assert [job.status for job in record.jobs] == ["Completed"] * 7
    assert len(service.catalog.list("simulation-job-batch").resources) == 2
    assert len(service.catalog.list("simulation-job").resources) == 7
    for arn, resource in before.items():  # what had ended was not run again
        assert service.catalog.get(arn) == resource
    return record


def ended_jobs(service: Service) -> dict[str, Any]:
    found = service.catalog.list("simulation-job").resources
    return {job.arn: job for job in found if job.status == "Completed"}


@pytest.mark.parametrize("finisher", ["another Prefect worker", "robomaker serve"])
def test_a_night_whose_prefect_worker_is_killed_is_finished_by(
    finisher: str, service: Service, environ: dict[str, str], serve: Serve, tmp_path: Path
) -> None:
    from prefect.client.orchestration import get_client

    pool = f"nights-{tmp_path.name}"
    with get_client(sync_client=True) as client:
        with process_worker(pool, environ, tmp_path / "worker.log") as worker:
            wait_for(lambda: pool in {each.name for each in client.read_work_pools()}, "the worker's pool", 300)
            deployment = begin_night(client, pool)
            in_the_middle(service)
            kill_tree(worker.pid)
        before = ended_jobs(service)
        [dead] = runs_of(client, deployment)

        if finisher == "robomaker serve":
            with serve(**environ, **MINE) as served:
                served.wait_until_ready()
                record = check_finished(service, before)
        else:
            with process_worker(pool, environ, tmp_path / "other.log"):
                record = check_finished(service, before)
                [dead, continued] = runs_of(client, deployment)
                wait_for(lambda: state_of(client, continued.id).is_final(), "Prefect to know of its end")
            continued = client.read_flow_run(continued.id)
            assert continued.name == f"{record.run_id}, continued"
            state = state_of(client, continued.id)
            assert state.type.value == "COMPLETED", state.message

        state = state_of(client, dead.id)
        assert state.type.value == "CRASHED"
        assert f"{record.run_id}, continued" in (state.message or "")

    # History and report tell of one night with an interruption.
    [interruption] = record.interruptions
    assert interruption.lost is not None
    assert interruption.lost.program == "a run of a Prefect worker"
    assert record.report_path is not None
    assert "interrupted once" in record.report_path.read_text()
    command = [*ROBOMAKER, "history", "night"]
    told = subprocess.run(command, env={**os.environ, **environ}, capture_output=True, text=True)
    assert told.returncode == 0, told.stderr
    assert told.stdout.startswith("night: 1 run\n")
    assert "interrupted once" in told.stdout


def test_a_killed_run_whose_batch_a_person_performs_has_a_record(
    service: Service, environ: dict[str, str], tmp_path: Path
) -> None:
    path = tmp_path / "night.yaml"
    path.write_text(night())
    mine = {**environ, **MINE}
    with started([*ROBOMAKER, "run", str(path)], mine, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as run:
        batch = in_the_middle(service)
        kill_tree(run.pid)
    before = ended_jobs(service)

    done = subprocess.run(
        [*ROBOMAKER, "perform", batch], env={**os.environ, **mine}, capture_output=True, text=True, timeout=600
    )

    assert done.returncode == 0, done.stdout + done.stderr
    record = check_finished(service, before)
    assert [each.lost.program for each in record.interruptions if each.lost] == ["robomaker run"]


def test_a_night_that_was_cancelled_and_killed_ends_as_cancelled(
    service: Service, environ: dict[str, str], tmp_path: Path
) -> None:
    path = tmp_path / "night.yaml"
    path.write_text(night(duration_s=100.0))
    mine = {**environ, **MINE}
    with started([*ROBOMAKER, "run", str(path)], mine, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as run:
        wait_for(lambda: "Running" in {job.status for job in jobs(service)}, "a job to run", 300)
        [lock] = (service.settings.home / "runs").glob("*/running.lock")
        lock.with_name("cancel").touch()  # as a run that is told to end does at first, before it is killed
        kill_tree(run.pid)

    command = [*ROBOMAKER, "perform", lock.parent.name]
    done = subprocess.run(command, env={**os.environ, **mine}, capture_output=True, text=True, timeout=600)

    record = record_of(service)
    assert (record.state, done.returncode) == ("canceled", record.exit_code), done.stderr
    assert [step.status for step in record.steps] == ["Completed", "Completed", "Canceled", "Skipped"]
    assert {job.status for job in jobs(service)} == {"Canceled"}
    assert {path.name for path in lock.parent.iterdir()}.isdisjoint({"order.json", "running.lock", "cancel"})


def jobs(service: Service) -> list[Any]:
    return list(service.catalog.list("simulation-job").resources)
