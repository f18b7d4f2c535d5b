"""Runs that died with their job worker: what they left is stored when the next one takes the job, and told apart."""

import signal
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest
from helpers.job_worker_process import AwaitStatus, PerformElsewhere
from helpers.processes import wait_for, working_below
from mcap.exceptions import EndOfFile
from mcap.reader import NonSeekingReader

from prefect_robomaker.schemas.wire.errors import ObjectNotFoundError
from prefect_robomaker.tasks.jobs import job_runs
from prefect_robomaker.tasks.operations.registry import call
from prefect_robomaker.tasks.service.service import Service
from prefect_robomaker.tasks.simulations.containers.cleanup import OUTPUT
from prefect_robomaker.tasks.simulations.environment.run_environment import container_sandbox
from prefect_robomaker.tasks.storage import read_manifest

Swing = Callable[..., dict[str, Any]]
Killed = Callable[..., str]
ENDLESS = {"SLEEP_S": "0.005", "TIME_LIMIT_S": "1000", "ROBOMAKER_CHECKPOINT_EVERY_S": "0"}
DIED = "the job worker died while this run went on"


@pytest.fixture
def killed(service: Service, perform_elsewhere: PerformElsewhere, await_status: AwaitStatus) -> Killed:
    """Has a job performed until its recording has a chunk, and kills the job worker with -9; returns the run's id."""

    def kill(job: dict[str, Any], *, restart: bool = False) -> str:
        with perform_elsewhere(job["arn"]) as worker:
            await_status(job["arn"], "Running")
            jobs = service.settings.home / "jobs" / job["name"]
            wait_for(lambda: any(messages(path) for path in jobs.glob("*/output/recording.mcap")), "a chunk")
            worker.send_signal(signal.SIGSTOP)  # so that it learns of no restart
            if restart:
                call("RestartSimulationJob", {"job": job["arn"]}, service)
            worker.send_signal(signal.SIGKILL)
            worker.wait(200)
            wait_for(lambda: not working_below(service.settings.home), "the run to die with its job worker")
        return service.catalog.get(job["arn"]).document["runId"]

    return kill


def messages(recording: Path) -> list[str]:
    """Topics of the messages of a recording, up to where it was cut off."""

    def read() -> Iterator[str]:
        with recording.open("rb") as file, suppress(EndOfFile):
            for _, channel, _ in NonSeekingReader(file).iter_messages(log_time_order=False):
                yield channel.topic

    return list(read())


def cancel_once_running(service: Service, monkeypatch: pytest.MonkeyPatch) -> None:
    """Has jobs cancelled as soon as a run of theirs has begun here."""
    real = job_runs.launcher()

    class Brief:
        def run(self, plan: Any, stop: Any, **options: Any) -> Any:
            call("CancelSimulationJob", {"job": plan.job_arn}, service)
            return real.run(plan, stop, **options)

    monkeypatch.setattr(job_runs, "launcher", Brief)


@pytest.mark.parametrize(
    "restart",
    [pytest.param(True, marks=pytest.mark.deep), pytest.param(False, marks=pytest.mark.endurance)],
    ids=["about to be restarted", "in its midst"],
)
def test_what_a_killed_worker_run_left_is_stored_without_a_manifest(
    service: Service, swing: Swing, killed: Killed, monkeypatch: pytest.MonkeyPatch, restart: bool
) -> None:
    job = swing(perform=False, **ENDLESS)
    run_id = killed(job, restart=restart)
    cancel_once_running(service, monkeypatch)

    job_runs.perform_job(job["arn"], service)

    document = service.catalog.get(job["arn"]).document
    [earlier] = document["earlierRuns"]
    assert document["runId"] != earlier["runId"] == run_id
    assert (earlier["status"], earlier["failureCode"], earlier["restarted"]) == (
        "Failed",
        "InternalServiceError",
        restart,
    )
    assert DIED in earlier["failureReason"]
    place = earlier["outputs"]
    assert place["prefix"].endswith(f"/{job['name']}/{run_id}")
    with pytest.raises(ObjectNotFoundError):
        read_manifest(service.store, **place)
    kept = {item.key.removeprefix(f"{place['prefix']}/") for item in service.store.list(**place)}
    assert {"recording.mcap", "logs/stdout.log", "logs/stderr.log"} <= kept
    assert "result.json" not in kept
    assert "/clock" in messages(
        Path(str(service.store.local_path(place["bucket"], f"{place['prefix']}/recording.mcap")))
    )
    assert DIED in service.store.get_bytes(place["bucket"], f"{place['prefix']}/logs/stderr.log").decode()
    assert not list((service.settings.home / "jobs").iterdir())


@pytest.mark.parametrize("answers", [True, False], ids=["running", "its ports had not answered yet"])
def test_what_a_dead_run_and_its_containers_wrote_is_stored_without_a_manifest(
    service: Service, order: Callable[..., Any], answers: bool
) -> None:
    arn, run_id = call("CreateSimulationJob", order(), service)["arn"], "2026-01-02T03-04-05-000000Z"
    service.catalog.transition(arn, "prepare", document_changes={"runId": run_id})
    if answers:
        service.catalog.transition(arn, "start", document_changes={"lastStartedAt": "2026-01-02T03:04:05+00:00"})
    folder = service.settings.home / "jobs" / arn.rpartition("/")[2] / run_id
    (folder / "output" / "logs").mkdir(parents=True)
    (folder / "output" / "recording.mcap").write_bytes(b"cut off")
    (folder / "output" / "logs" / "stderr.log").write_text("careful\n")
    written = container_sandbox(folder, "robot").place(OUTPUT)
    written.mkdir(parents=True)
    (written / "map.pgm").write_text("a map")

    job_runs.perform_job(arn, service)

    [earlier] = service.catalog.get(arn).document["earlierRuns"]
    assert (earlier["runId"], earlier["status"], earlier["failureCode"], earlier["restarted"]) == (
        run_id,
        "Failed",
        "InternalServiceError",
        False,
    )
    assert DIED in earlier["failureReason"]
    place = earlier["outputs"]
    assert place["prefix"].endswith(f"/{run_id}")
    with pytest.raises(ObjectNotFoundError):
        read_manifest(service.store, **place)
    kept = {item.key.removeprefix(f"{place['prefix']}/") for item in service.store.list(**place)}
    assert kept >= {"recording.mcap", "map.pgm", "logs/stderr.log"}
    assert service.store.get_bytes(place["bucket"], f"{place['prefix']}/map.pgm") == b"a map"
    log = service.store.get_bytes(place["bucket"], f"{place['prefix']}/logs/stderr.log").decode()
    assert log.startswith("careful\n")
    assert DIED in log
    assert not list((service.settings.home / "jobs").iterdir())


@pytest.mark.deep
def test_a_worker_that_dies_once_a_dead_run_is_stored_leaves_it_to_the_next(
    service: Service, swing: Swing, killed: Killed, monkeypatch: pytest.MonkeyPatch
) -> None:
    job = swing(perform=False, **ENDLESS)
    run_id = killed(job, restart=True)
    cancel_once_running(service, monkeypatch)
    update = service.catalog.update

    def die(*arguments: Any, **options: Any) -> Any:
        monkeypatch.setattr(service.catalog, "update", update)
        raise SystemExit("killed")

    monkeypatch.setattr(service.catalog, "update", die)
    with pytest.raises(SystemExit):
        job_runs.perform_job(job["arn"], service)
    assert "earlierRuns" not in service.catalog.get(job["arn"]).document

    job_runs.perform_job(job["arn"], service)

    [earlier] = service.catalog.get(job["arn"]).document["earlierRuns"]
    assert earlier["runId"] == run_id
    assert earlier["outputs"]
