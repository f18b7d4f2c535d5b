"""Jobs whose job worker is killed go on where they were, or begin anew and say why."""

import logging
import os
import shutil
import signal
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest
from helpers.ports import free_port
from helpers.processes import wait_for
from helpers.swing_fixtures import outputs_of

from prefect_robomaker.schemas.runs.plan import ApplicationPlan, RunPlan, RunResult
from prefect_robomaker.schemas.runs.provenance import Provenance
from prefect_robomaker.schemas.wire.errors import LaunchError, ObjectNotFoundError
from prefect_robomaker.tasks.catalog import Catalog, Resource
from prefect_robomaker.tasks.inspection.replays import verify_run
from prefect_robomaker.tasks.jobs import job_runs
from prefect_robomaker.tasks.jobs.job_runs import perform_job
from prefect_robomaker.tasks.operations.registry import call
from prefect_robomaker.tasks.runtime.states.checkpoint_files import write_checkpoint
from prefect_robomaker.tasks.service.service import Service
from prefect_robomaker.tasks.simulations.planning.run_plans import checkpoint_every_s, plan_to_resume
from prefect_robomaker.tasks.simulations.ros.ros_domains import own_domain
from prefect_robomaker.tasks.storage import read_manifest

Swing = Callable[..., dict[str, Any]]
SLOW = {"SLEEP_S": "0.01", "TIME_LIMIT_S": "6", "ROBOMAKER_CHECKPOINT_EVERY_S": "1"}
PERFORM = """
import os, sys
from prefect_robomaker.schemas.settings import Settings
from prefect_robomaker.tasks.jobs import job_runs
from prefect_robomaker.tasks.jobs.job_runs import perform_job
from prefect_robomaker.tasks.service.service import Service
perform_job(sys.argv[1], Service.open(Settings.from_environment(os.environ)))
"""


@pytest.fixture
def worker(service: Service) -> Iterator[Callable[[str], "subprocess.Popen[bytes]"]]:
    """Starts processes that perform jobs."""
    started = []

    def start(arn: str) -> "subprocess.Popen[bytes]":
        environment = {**os.environ, "ROBOMAKER_HOME": str(service.settings.home)}
        process = subprocess.Popen([sys.executable, "-c", PERFORM, arn], env=environment)
        started.append(process)
        return process

    yield start
    for process in started:
        process.kill()
        process.wait()


def later(service: Service) -> Service:
    """The same service when the leases of the dead have run out."""
    catalog = Catalog.open(service.settings.catalog_url, clock=lambda: datetime.now(UTC) + timedelta(minutes=2))
    return replace(service, catalog=catalog)


def killed(
    service: Service,
    job: dict[str, Any],
    worker: Callable[..., "subprocess.Popen[bytes]"],
    status: str | None = None,
) -> Path:
    """Has a job performed and kills the job worker in the middle; returns the folder of the run that died with it.

    Args:
        service: Where the job is.
        job: Description of the job.
        worker: Starts a job worker.
        status: Status that the job has to have first; None: any.
    """
    process = worker(job["arn"])
    if status is not None:
        wait_for(lambda: service.catalog.get(job["arn"]).status == status, status)
    folder = service.settings.home / "jobs" / job["name"]
    [checkpoint, *_] = wait_for(lambda: list(folder.glob("*/checkpoints/checkpoint-*.bin")), "a checkpoint")
    process.send_signal(signal.SIGKILL)
    process.wait()
    run = checkpoint.parent.parent
    # The run dies with its job worker; its lock says that it has.
    wait_for(lambda: not _is_locked(run / "checkpoints" / "lock"), "the run to die")
    return run


def _is_locked(path: Path) -> bool:
    return subprocess.run(["flock", "--nonblock", path, "true"], check=False).returncode != 0


def result_of(service: Service, job: dict[str, Any]) -> RunResult:
    return RunResult.model_validate_json((outputs_of(service, job) / "result.json").read_bytes())


def died_here(service: Service, job: dict[str, Any], aside: Path) -> Path:
    """Has a job performed whose run is killed, and its job worker with it; returns the folder of the run.

    A job worker that is killed cleans nothing up, unlike one that an exception ends.
    """
    real = job_runs.launcher()
    folders: list[Path] = []

    class Mortal:
        def run(self, plan: RunPlan, *arguments: Any, **options: Any) -> None:
            real.run(plan, *arguments, **{**options, "try_again": lambda: True})
            folders.append(plan.work_dir.parent)
            shutil.copytree(folders[0], aside, symlinks=True)
            raise SystemExit("the job worker is killed")

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(job_runs, "launcher", Mortal)
        with pytest.raises(SystemExit):
            perform_job(job["arn"], service)
    shutil.rmtree(folders[0], ignore_errors=True)
    shutil.copytree(aside, folders[0], symlinks=True)
    return folders[0]


@pytest.mark.parametrize("where", ["in this process", pytest.param("in its own", marks=pytest.mark.deep)])
def test_the_next_worker_goes_on_and_ends_in_the_same_state(
    service: Service, swing: Swing, worker: Callable[..., Any], where: str, tmp_path: Path
) -> None:
    if where == "in this process":
        briefly = {"TIME_LIMIT_S": "3", "ROBOMAKER_CHECKPOINT_EVERY_S": "1", "SLEEP_S": "0.01"}
        whole, job = swing(**briefly), swing(perform=False, **briefly, KILL_AT="80")
        run = died_here(service, job, tmp_path / "aside")
    else:
        whole, job = swing(**SLOW), swing(perform=False, **SLOW)
        run = killed(service, job, worker)
    assert call("DescribeSimulationJob", {"job": job["arn"]}, service)["status"] == "Running"

    with own_domain(job["arn"]) as domain_before:  # another job has it by now
        perform_job(job["arn"], later(service))

    ended = call("DescribeSimulationJob", {"job": job["arn"]}, service)
    document = service.catalog.get(job["arn"]).document
    assert (ended["status"], document["runId"], document["attempts"]) == ("Completed", run.name, 2)
    assert document["reachedS"] >= 1
    assert service.catalog.lost_workers(job["arn"]) == 0, "the run has come further: its worker's death is forgotten"
    assert result_of(service, job).state_digest == result_of(service, whole).state_digest
    assert result_of(service, job).metrics == result_of(service, whole).metrics
    provenance = Provenance.model_validate_json((outputs_of(service, job) / "provenance.json").read_bytes())
    assert len(provenance.resumed_at_s) == 1
    assert provenance.plan.environment["ROS_DOMAIN_ID"] not in ("0", str(domain_before))
    assert "digest.bin" in {file.path for file in read_manifest(service.store, **document["outputs"]).files}
    assert not run.exists()


@pytest.mark.deep
def test_what_was_done_is_stored_when_the_rest_cannot_be_started(
    service: Service, swing: Swing, worker: Callable[..., Any]
) -> None:
    port = free_port()
    ports = {"portMappings": [{"jobPort": port, "applicationPort": 4000}]}
    push = {"packageName": "swinger", "launchFile": "make_agent", "portForwardingConfig": ports}
    # Nothing listens on the port, so that the job counts as running after 10 s only; then its outputs are known.
    job = swing(perform=False, robot={"launchConfig": push}, **{**SLOW, "TIME_LIMIT_S": "600"})
    killed(service, job, worker, status="Running")

    with socket.create_server(("127.0.0.1", port)):
        perform_job(job["arn"], later(service))

    ended = call("DescribeSimulationJob", {"job": job["arn"]}, service)
    assert ended["status"] == "Failed"
    assert str(port) in ended["failureReason"]
    place = service.catalog.get(job["arn"]).document["outputs"]
    recording = service.store.get_bytes(place["bucket"], f"{place['prefix']}/recording.mcap")
    assert len(recording) > 1000
    with pytest.raises(ObjectNotFoundError):
        read_manifest(service.store, **place)


@pytest.mark.deep
def test_a_robot_that_is_a_program_begins_anew_with_its_run(
    service: Service, swing: Swing, worker: Callable[..., Any], caplog: pytest.LogCaptureFixture
) -> None:
    """A program cannot be put back to where it was."""
    code = (
        "from prefect_robomaker.tasks.runtime.agents.agent_client import connect\n"
        "with connect() as simulation:\n"
        "    simulation.run(lambda step: [0.1])\n"
    )
    push = {"launchConfig": {"command": ["python3", "-c", code]}}
    job = swing(perform=False, robot=push, **(SLOW | {"TIME_LIMIT_S": "2"}))
    process = worker(job["arn"])
    folder = service.settings.home / "jobs" / job["name"]
    wait_for(lambda: any(path.stat().st_size > 2000 for path in folder.glob("*/output/actions.bin")), "actions")
    [left] = folder.iterdir()
    process.kill()
    process.wait()

    with caplog.at_level(logging.WARNING):
        perform_job(job["arn"], later(service))

    document = service.catalog.get(job["arn"]).document
    why = "robot application pusher is a program of its own, whose state cannot be restored"
    assert f"{job['arn']} is run from the start again: {why}" in caplog.text
    assert call("DescribeSimulationJob", {"job": job["arn"]}, service)["status"] == "Completed"
    assert document["runId"] != left.name
    assert "attempts" not in document
    provenance = Provenance.model_validate_json((outputs_of(service, job) / "provenance.json").read_bytes())
    assert provenance.resumed_at_s == []
    assert provenance.actions is not None
    assert provenance.actions.actions == 100
    assert verify_run(job["arn"], service).answer == "bit-identical"


@pytest.mark.deep
def test_one_that_has_not_opted_in_begins_anew_and_the_reason_is_logged(
    service: Service, swing: Swing, worker: Callable[..., Any], caplog: pytest.LogCaptureFixture
) -> None:
    job = swing(perform=False, CLOSED="1", SLEEP_S="0.01")
    process = worker(job["arn"])
    folder = service.settings.home / "jobs" / job["name"]
    wait_for(lambda: list(folder.glob("*/checkpoints/not-resumable.txt")), "the reason")
    process.kill()
    process.wait()

    with caplog.at_level(logging.WARNING):
        perform_job(job["arn"], later(service))

    document = service.catalog.get(job["arn"]).document
    assert "attempts" not in document
    assert "is run from the start again: the environment (ClosedSwinging) has no state() and restore()" in caplog.text
    assert result_of(service, job).state_digest is not None


@pytest.mark.deep
def test_a_restart_begins_anew(service: Service, swing: Swing, worker: Callable[..., Any]) -> None:
    job = swing(perform=False, **SLOW)
    run = killed(service, job, worker)
    call("RestartSimulationJob", {"job": job["arn"]}, service)

    perform_job(job["arn"], later(service))

    document = service.catalog.get(job["arn"]).document
    assert document["runId"] != run.name
    assert "attempts" not in document
    provenance = Provenance.model_validate_json((outputs_of(service, job) / "provenance.json").read_bytes())
    assert provenance.resumed_at_s == []


@pytest.mark.parametrize(
    "changes",
    [
        {"run_id": "../../sim-2/run"},
        {"job_id": "sim-2"},
        {"output_dir": Path("/home/else/output")},
        {"work_dir": Path("/home/else/work")},
        {"root_dir": Path("/home/else/root")},
        {"max_duration_s": 1e9},
    ],
)
def test_a_plan_that_is_not_the_runs_own_is_not_gone_on_with(
    tmp_path: Path, changes: dict[str, Any], caplog: pytest.LogCaptureFixture
) -> None:
    """Applications can write to the folder of checkpoints."""
    now, run = datetime(2026, 1, 2, tzinfo=UTC), tmp_path / "run"
    job = Resource(
        arn="arn", kind="simulation-job", id="sim-1", status="Running", revision=1, created_at=now, updated_at=now,
        document={"request": {"maxJobDurationInSeconds": 600}, "seed": 1},
    )  # fmt: skip
    plan = RunPlan(
        job_id="sim-1", job_arn="arn", run_id="run", seed=1, max_duration_s=600.0,
        work_dir=run / "work", output_dir=run / "output", root_dir=run / "root", checkpoint_dir=run / "checkpoints",
    )  # fmt: skip
    run.joinpath("checkpoints").mkdir(parents=True)
    write_checkpoint(run / "checkpoints", 1, b"", sim_time_s=1.0, steps=1, wall_time_s=1.0)
    plan_file = run / "checkpoints" / "plan.json"
    plan_file.write_text(plan.model_dump_json())
    assert plan_to_resume(job, run) == plan

    plan_file.write_text(plan.model_copy(update=changes).model_dump_json())

    assert plan_to_resume(job, run) is None
    assert "run from the start again: its plan was changed" in caplog.text


@pytest.mark.parametrize(("text", "every_s"), [(None, 5.0), ("2.5", 2.5), ("0", None)])
def test_how_often(text: str | None, every_s: float | None) -> None:
    variables = {} if text is None else {"ROBOMAKER_CHECKPOINT_EVERY_S": text}
    application = ApplicationPlan(role="simulation", name="a", environment_variables=variables)
    assert checkpoint_every_s(application) == every_s
    assert checkpoint_every_s(None) == 5.0


@pytest.mark.parametrize("text", ["often", "-1", "nan", "inf", ""])
def test_what_is_no_number_of_seconds_is_refused(text: str) -> None:
    variables = {"ROBOMAKER_CHECKPOINT_EVERY_S": text}
    with pytest.raises(LaunchError, match=r"ROBOMAKER_CHECKPOINT_EVERY_S is '.*'; seconds of simulated time, or 0"):
        checkpoint_every_s(ApplicationPlan(role="simulation", name="a", environment_variables=variables))
