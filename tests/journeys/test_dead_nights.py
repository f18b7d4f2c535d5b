"""Nights whose processes are killed: the next process of the data home finishes them, as one night with one report."""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any
from uuid import UUID, uuid4

import pytest
from helpers.bare_prefect_server import bare_prefect_server
from helpers.endpoint_process import Serve
from helpers.mortal_prefect import MortalPrefectServer
from helpers.paths import BUNDLES
from helpers.processes import alive, descendants, kill_tree, process_worker, started, wait_for

from prefect_robomaker.schemas.reports.run_record import RunRecord
from prefect_robomaker.tasks.service.service import Service

pytestmark = [pytest.mark.deep, pytest.mark.timeout(1800)]

ROBOMAKER = [sys.executable, "-m", "prefect_robomaker.deployments.cli.main"]
SUITE = {"name": "General"}
CONTAINER = ["unshare", "--pid", "--fork", "--mount-proc"]
"""Words before a command that is then the first process of a container: all others end with it."""

GRACE_S = 180.0
"""How long systemd leaves a Prefect worker to end: `TimeoutStopSec` in `robomaker-worker.service`."""

MINE = {"PYTHONPATH": str(BUNDLES / "sleeper"), "PYTHONDONTWRITEBYTECODE": "1"}
"""Variables with which the night's application is found, and without which it is not."""


def new_pool() -> str:
    """A name that no other test gives its work pool; all of them have one server."""
    return f"nights-{uuid4().hex[:8]}"


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


def deploy_night(client: Any, name: str, pool: str | None) -> Any:
    """Makes a deployment of the night as `robomaker deploy --schedule` does; returns its id."""
    from prefect_robomaker.flows.pipelines import RunPipeline
    from prefect_robomaker.tasks.execution.schedule_overlaps import OVERLAP, RUNS_AT_ONCE

    return client.create_deployment(
        flow_id=client.create_flow(RunPipeline),
        name=name,
        work_pool_name=pool,
        entrypoint="prefect_robomaker.flows.pipelines:RunPipeline",
        pull_steps=[],
        parameters={"text": night(), "origin": "night.yaml"},
        job_variables={"env": MINE},
        # The dead run may hold the only place.
        concurrency_limit=RUNS_AT_ONCE,
        concurrency_options=OVERLAP,
    )


def begin_night(client: Any, pool: str) -> Any:
    """Has Prefect begin a run of the night's deployment. Not by a schedule: a busy server would notice one too late."""
    deployment = deploy_night(client, pool, pool)
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


def record_folder(service: Service) -> Path:
    """The folder of the only run."""
    [folder] = (path.parent for path in (service.settings.home / "runs").glob("*/order.json"))
    return folder


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


def kill_a_night(client: Any, pool: str, service: Service, environ: dict[str, str], folder: Path) -> tuple[Any, str]:
    """Begins a night by a Prefect worker, and kills both in the middle.

    Returns:
        The deployment's id, and the ARN of the batch that was running.
    """
    with process_worker(pool, environ, folder / "worker.log") as worker:
        wait_for(lambda: pool in {each.name for each in client.read_work_pools()}, "the worker's pool", 300)
        deployment = begin_night(client, pool)
        batch = in_the_middle(service)
        kill_tree(worker.pid)
    return deployment, batch


def engine_of(run: UUID, environ: dict[str, str]) -> tuple[list[str], dict[str, str]]:
    """The process that a Prefect worker starts for a flow run: its command, and its variables."""
    variables = {**environ, **MINE, "PREFECT__FLOW_RUN_ID": str(run)}
    return [sys.executable, "-m", "prefect.engine"], variables


def kill_a_flow_run(client: Any, service: Service, environ: dict[str, str]) -> tuple[Any, str]:
    """Begins a night in the process that a Prefect worker starts, and kills it in the middle; there is no worker.

    Returns:
        The deployment's id, and the ARN of the batch that was running.
    """
    from prefect.states import Pending

    deployment = deploy_night(client, new_pool(), None)
    run = client.create_flow_run_from_deployment(deployment)
    assert client.set_flow_run_state(run.id, Pending()).status.value == "ACCEPT"
    with started(*engine_of(run.id, environ)) as process:
        batch = in_the_middle(service)
        kill_tree(process.pid)
    return deployment, batch


@pytest.mark.parametrize("place", [pytest.param("a process", marks=pytest.mark.endurance), "a container"])
def test_the_next_night_finishes_the_dead_one(
    place: str, service: Service, environ: dict[str, str], tmp_path: Path
) -> None:
    """The next night is executed as a work pool does it; no Prefect worker has the home, as with container pools."""
    from prefect.client.orchestration import get_client
    from prefect.states import Pending

    in_container = place == "a container"
    if in_container and subprocess.run([*CONTAINER, "true"], capture_output=True, check=False).returncode:
        pytest.skip("this user may make no namespaces of processes")
    with get_client(sync_client=True) as client:
        deployment, _ = kill_a_flow_run(client, service, environ)
        before = ended_jobs(service)
        dead = record_folder(service)
        # Short, so that a container would end before the dead night is finished.
        steps = {"list": {"operation": "ListWorlds"}}
        text = night(duration_s=15.0, jobs=2) if not in_container else json.dumps(
            {"version": 1, "name": "short", "steps": steps}
        )  # fmt: skip
        following = client.create_flow_run_from_deployment(deployment, parameters={"text": text})

        def has_place() -> bool:
            return client.set_flow_run_state(following.id, Pending()).status.value == "ACCEPT"

        wait_for(has_place, "the dead night to give back its place", 300)
        command, mine = engine_of(following.id, environ)
        with started([*CONTAINER, *command] if in_container else command, mine, cwd=tmp_path) as executing:
            executing.wait(900)
        wait_for(lambda: (dead / "run.json").exists(), "the dead night's record", 0.0 if in_container else 300.0)
        assert state_of(client, following.id).is_completed()

    record = RunRecord.model_validate_json((dead / "run.json").read_text())
    assert (record.state, [job.status for job in record.jobs]) == ("succeeded", ["Completed"] * 7)
    assert [each.lost.program for each in record.interruptions if each.lost] == ["a run of a Prefect worker"]
    for arn, resource in before.items():
        assert service.catalog.get(arn) == resource


def test_a_job_worker_finishes_the_dead_night_whose_batch_it_works_for(
    service: Service, environ: dict[str, str]
) -> None:
    from prefect.client.orchestration import get_client

    with get_client(sync_client=True) as client:
        _, batch = kill_a_flow_run(client, service, environ)
    before = ended_jobs(service)
    command = [*ROBOMAKER, "work", batch]
    with started(command, {**environ, **MINE}, stdout=subprocess.PIPE, stderr=subprocess.STDOUT) as working:
        record = check_finished(service, before)
        told, _ = working.communicate(timeout=600)
    assert working.returncode == 0, told
    assert [each.lost.program for each in record.interruptions if each.lost] == ["a run of a Prefect worker"]


@pytest.mark.endurance  # below, one at a plain server is finished by a Prefect worker, and another by `robomaker serve`
@pytest.mark.parametrize("finisher", ["another Prefect worker", "robomaker serve"])
def test_a_night_whose_prefect_worker_is_killed_is_finished_by(
    finisher: str, service: Service, environ: dict[str, str], serve: Serve, tmp_path: Path
) -> None:
    from prefect.client.orchestration import get_client

    pool = new_pool()
    with get_client(sync_client=True) as client:
        deployment, _ = kill_a_night(client, pool, service, environ, tmp_path)
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

    told_as_one_night(record, environ)


def told_as_one_night(record: RunRecord, environ: dict[str, str]) -> None:
    """History and report tell of one night with an interruption."""
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


def test_a_night_at_a_plain_prefect_server_is_named_and_then_finished_by_the_next_prefect_worker(
    service: Service, environ: dict[str, str], tmp_path_factory: pytest.TempPathFactory, tmp_path: Path
) -> None:
    """The server is Prefect's as it comes, kept by others, and no process but Prefect workers has the data home."""
    from prefect.client.orchestration import SyncPrefectClient

    pool = new_pool()
    with bare_prefect_server(tmp_path_factory.mktemp("plain")) as (plain, _):
        theirs = {**environ, "PREFECT_API_URL": f"{plain}/api"}
        with SyncPrefectClient(theirs["PREFECT_API_URL"]) as client:
            deployment, _ = kill_a_night(client, pool, service, theirs, tmp_path)
            before = ended_jobs(service)
            dead = record_folder(service)
            doctor = [*ROBOMAKER, "doctor", "-o", "json"]
            told = subprocess.run(doctor, env={**os.environ, **theirs}, capture_output=True, text=True)
            findings = {each["subject"]: each for each in json.loads(told.stdout)["findings"]}
            assert dead.name in findings["broken-off runs"]["found"]
            assert findings["broken-off runs"]["health"] != "ok"
            with process_worker(pool, theirs, tmp_path / "other.log"):
                record = check_finished(service, before)
                [first, continued] = runs_of(client, deployment)
                assert continued.name == f"{record.run_id}, continued"
                wait_for(lambda: state_of(client, continued.id).is_final(), "Prefect to know of its end")
                assert state_of(client, continued.id).is_completed()
            wait_for(lambda: state_of(client, first.id).is_crashed(), "the dead run to be closed")
            assert f"{record.run_id}, continued" in state_of(client, first.id).message
    assert [each.lost.program for each in record.interruptions if each.lost] == ["a run of a Prefect worker"]


@pytest.mark.endurance  # test_ownership.py has it with the command that `robomaker doctor` tells
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


def test_a_prefect_worker_without_its_server_ends_in_time_and_its_night_is_finished(
    service: Service,
    environ: dict[str, str],
    mortal_prefect: MortalPrefectServer,
    serve: Serve,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A machine that shuts down ends its services, the Prefect server perhaps before the worker."""
    for name, value in mortal_prefect.variables.items():
        monkeypatch.setenv(name, value)
    from prefect.client.orchestration import SyncPrefectClient

    pool, theirs = new_pool(), {**environ, **mortal_prefect.variables}
    client = SyncPrefectClient(theirs["PREFECT_API_URL"], auth_string=theirs["PREFECT_API_AUTH_STRING"])
    with client, process_worker(pool, theirs, tmp_path / "worker.log") as worker:
        wait_for(lambda: pool in {each.name for each in client.read_work_pools()}, "the worker's pool", 300)
        begin_night(client, pool)
        in_the_middle(service)
        below = descendants(worker.pid)
        mortal_prefect.die()
        worker.terminate()
        worker.wait(GRACE_S)
        wait_for(lambda: not alive(below), "what the worker started to end with it")
    before = ended_jobs(service)
    monkeypatch.undo()

    with serve(**environ, **MINE) as served:
        served.wait_until_ready()
        record = check_finished(service, before)
    told_as_one_night(record, environ)
