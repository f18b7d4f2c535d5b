"""Who orders a run carries it out, in his own environment, though `robomaker serve` waits for jobs on the same home."""

import json
import os
import socket
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from helpers.browser import NEEDS_BROWSER, browsing
from helpers.endpoint_process import Serve
from helpers.paths import BUNDLES
from helpers.processes import process_worker, started, wait_for

from prefect_robomaker.schemas.job_owners import JobStanding
from prefect_robomaker.schemas.reports.run_record import RunRecord
from prefect_robomaker.tasks.jobs.job_owners import standing_of
from prefect_robomaker.tasks.service.service import Service

ROBOMAKER = [sys.executable, "-m", "prefect_robomaker.deployments.cli.main"]
SUITE = {"name": "General"}
MINE = {"PYTHONPATH": str(BUNDLES / "sleeper"), "PYTHONDONTWRITEBYTECODE": "1"}
"""Variables with which the caller's application is found, and without which it is not."""


@pytest.fixture
def spec(tmp_path: Path) -> Callable[..., Path]:
    """Writes a specification of a batch whose applications only the caller has."""

    def write(jobs: int = 3, duration_s: float = 0.2) -> Path:
        request = {
            "maxJobDurationInSeconds": 300,
            "seed": 1,
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
        room = {
            "name": "room", "environment": {"uri": "python://sleeper"}, "robotSoftwareSuite": SUITE,
            "simulationSoftwareSuite": {"name": "SimulationRuntime"},
        }  # fmt: skip
        watcher = {"name": "watcher", "environment": {"uri": "python://sleeper"}, "robotSoftwareSuite": SUITE}
        drive = {"createSimulationJobRequests": [request] * jobs, "batchPolicy": {"maxConcurrency": 2}}
        steps = {
            "room": {"operation": "CreateSimulationApplication", "input": room, "ifExists": "reuse"},
            "watcher": {"operation": "CreateRobotApplication", "input": watcher, "ifExists": "reuse"},
            "drive": {"operation": "StartSimulationJobBatch", "needs": ["room", "watcher"], "input": drive},
        }
        path = tmp_path / "mine.yaml"
        path.write_text(json.dumps({"version": 1, "name": "mine", "steps": steps}))
        return path

    return write


def batch_of(service: Service) -> str:
    """ARN of the only batch, once it is stored."""
    wait_for(lambda: service.catalog.list("simulation-job-batch").resources, "the batch", 300)
    return service.catalog.list("simulation-job-batch").resources[0].arn


def standing(service: Service, arn: str) -> JobStanding:
    found = standing_of(service.catalog.get(arn), service)
    assert found is not None
    return found


@pytest.mark.endurance  # the same rule as below, by another program
def test_serve_leaves_a_night_to_its_prefect_worker(
    service: Service, environ: dict[str, str], spec: Any, serve: Serve, tmp_path: Path
) -> None:
    from prefect.client.orchestration import get_client

    pool, path = f"nights-{tmp_path.name}", spec()
    with serve(**environ) as served, process_worker(pool, environ, tmp_path / "worker.log"):
        served.wait_until_ready()
        with get_client(sync_client=True) as client:
            wait_for(lambda: pool in {each.name for each in client.read_work_pools()}, "the worker's pool", 300)
            night = begin_night(client, pool, path)
            state = wait_for(lambda: final_state(client, night), "the end of the night", 600)

    assert state.type.value == "COMPLETED", state.message
    batch = batch_of(service)
    assert service.catalog.get(batch).status == "Completed"
    assert standing(service, batch).owner.program == "a run of a Prefect worker"


def begin_night(client: Any, pool: str, spec: Path) -> Any:
    """Orders a run of a deployment whose variables have the application; returns the flow run's id."""
    from prefect_robomaker.flows.pipelines import RunPipeline

    deployment = client.create_deployment(
        flow_id=client.create_flow(RunPipeline),
        name=pool,
        work_pool_name=pool,
        entrypoint="prefect_robomaker.flows.pipelines:RunPipeline",
        pull_steps=[],
        job_variables={"env": MINE},
    )
    members = {"text": spec.read_text(), "origin": spec.name}
    return client.create_flow_run_from_deployment(deployment, parameters=members).id


def final_state(client: Any, run: Any) -> Any:
    state = client.read_flow_run(run).state
    return state if state is not None and state.is_final() else None


def killed_run(service: Service, spec: Path, environ: dict[str, str]) -> str:
    """Kills a run in the middle of its batch; returns the batch."""
    with started([*ROBOMAKER, "run", str(spec)], environ, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as run:
        batch = batch_of(service)
        wait_for(lambda: "Running" in service.catalog.count_children(batch, "simulation-job"), "a job to run", 300)
        run.kill()
    return batch


@pytest.mark.endurance  # test_serve.py has it by jobs, and test_dead_nights.py by a night
def test_serve_goes_on_with_what_a_dead_run_left_if_it_has_what_that_needs(
    service: Service, environ: dict[str, str], spec: Any, serve: Serve
) -> None:
    batch = killed_run(service, spec(duration_s=10.0), {**environ, **MINE})
    with serve(**environ, **MINE) as served:
        served.wait_until_ready()
        wait_for(lambda: service.catalog.get(batch).status == "Completed", "the end of the batch", 600)

    assert service.catalog.count_children(batch, "simulation-job") == {"Completed": 3}
    found = standing(service, batch)
    assert found.lost is not None
    # The endpoint takes up its jobs itself, or the process does in which it finishes the run.
    assert found.owner.program in ("robomaker serve", "a continued run")
    assert found.lost.program == "robomaker run"
    assert f"as {found.lost} had died" in found.in_words()


@pytest.mark.deep
@NEEDS_BROWSER
@pytest.mark.timeout(1200)
def test_serve_leaves_a_run_to_who_started_it_or_to_the_command_that_it_tells(
    service: Service, environ: dict[str, str], spec: Any, serve: Serve, tmp_path: Path
) -> None:
    mine = {**environ, **MINE, "ROBOMAKER_NICE": "3"}
    batch = killed_run(service, spec(duration_s=10.0), mine)
    name = batch.rpartition("/")[2]
    with serve(**environ) as served, browsing(tmp_path / "profile") as browser, browser.page() as page:
        served.wait_until_ready()
        left = wait_for(lambda: served.worker().get("left"), "a job that is left", 300)
        assert left is not None
        assert list(left) == [batch]
        assert f"{name} was carried out by robomaker run" in served.log.read_text()

        page.load(f"{served.url}/console/batches/{name}", 1280)
        text = page.wait_for_text("which has died", "ROBOMAKER_NICE is 0, not 3", "package sleeper is not installed")
        doctor = subprocess.run(
            [*ROBOMAKER, "doctor", "-o", "json"], env={**os.environ, **environ}, capture_output=True, text=True
        )
        [finding] = [each for each in json.loads(doctor.stdout)["findings"] if each["subject"] == "left jobs"]
        assert finding["health"] == "warning"
        assert batch in finding["found"]
        command = finding["remedy"].partition(": ")[2]
        assert command in text
        assert command.endswith(f" ROBOMAKER_NICE=3 robomaker perform {batch}")

        # Word by word as doctor says it, in a shell that has nothing else.
        typed = command.replace(" robomaker ", f" {' '.join(ROBOMAKER)} ")
        done = subprocess.run(typed, shell=True, env={**os.environ, **environ}, capture_output=True, text=True)
        page.load(f"{served.url}/console/batches/{name}", 1280)
        page.wait_for_text("Carried out by robomaker perform", "had died")
        [path] = (service.settings.home / "runs").glob("*/run.json")
        a_run_that_lives_is_left_to_its_process(spec(duration_s=0.2), environ)

    assert done.returncode == 0, done.stdout + done.stderr
    assert service.catalog.count_children(batch, "simulation-job") == {"Completed": 3}
    record = RunRecord.model_validate_json(path.read_text())
    assert (record.state, [step.status for step in record.steps]) == ("succeeded", ["Completed"] * 3), record.steps
    assert [each.lost.program for each in record.interruptions if each.lost] == ["robomaker run"]


def a_run_that_lives_is_left_to_its_process(spec: Path, environ: dict[str, str]) -> None:
    command = [*ROBOMAKER, "run", str(spec), "-o", "json"]
    with started(command, {**environ, **MINE}, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as run:
        out, err = run.communicate(timeout=300)

    assert run.returncode == 0, out + err
    record = RunRecord.model_validate_json(out)
    assert [job.status for job in record.jobs] == ["Completed"] * 3
    owners = [job.carried_out_by for job in record.jobs]
    assert [(owner.program, owner.process_id) for owner in owners if owner] == [("robomaker run", run.pid)] * 3
    report = (record.run_dir / "report.html").read_text()
    assert f"robomaker run on {socket.gethostname()}: 3 jobs" in report
