"""Abandoned containers: the next job worker on the machine removes them, and no others."""

import os
import socket
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from helpers.fake_engine import FakeEngine

from prefect_robomaker.deployments.cli import doctor_checks
from prefect_robomaker.tasks.jobs.job_folders import remove_abandoned_containers, remove_overtaken_runs
from prefect_robomaker.tasks.operations.registry import call
from prefect_robomaker.tasks.service.service import Service
from prefect_robomaker.tasks.simulations.containers.cleanup import ContainerNote, note_container

Order = Callable[..., dict[str, Any]]
RUN = "2026-01-02T03-04-05-000000Z"


@pytest.fixture
def job(service: Service, order: Order, fake: FakeEngine) -> dict[str, Any]:
    """A job that has a run with a container here."""
    job = call("CreateSimulationJob", order(), service)
    service.catalog.transition(job["arn"], "prepare", document_changes={"runId": RUN})
    service.catalog.transition(job["arn"], "start")
    run = service.folder("jobs", job["arn"].rsplit("/", 1)[1], RUN)
    (run / "output").mkdir()
    note_container(run, ContainerNote(str(fake.program), "left", "sleeper", "robot"))
    subprocess.run([fake.program, "create", "--name", "left", "sleeper"], check=True)
    return {**job, "folder": run}


def dead_process() -> str:
    ended = subprocess.Popen([sys.executable, "-c", ""])
    ended.wait()
    return f"{socket.gethostname()}:{ended.pid}:1"


def test_containers_of_a_worker_that_died_here_are_ended(
    service: Service, fake: FakeEngine, job: dict[str, Any]
) -> None:
    service.catalog.claim(job["arn"], dead_process(), -1.0)
    assert doctor_checks.check_containers(service.settings).health == "warning"

    remove_abandoned_containers(service)

    assert fake.containers() == []
    assert (job["folder"] / "output").is_dir(), "the job worker that takes the job over stores it"
    assert doctor_checks.check_containers(service.settings).health == "ok"


@pytest.mark.parametrize(
    ("owner", "lease_s"),
    [
        (f"{socket.gethostname()}:{os.getpid()}:1", -1.0),  # it lives, and was held up
        ("dead", 30.0),  # it seems to be dead: perhaps this process cannot see it
        ("elsewhere:1:1", -1.0),
        (None, 0.0),  # it was given back to be taken over
    ],
    ids=["held up", "perhaps not seen", "elsewhere", "given back"],
)
def test_other_containers_of_jobs_that_go_on_are_left_alone(
    service: Service, fake: FakeEngine, job: dict[str, Any], owner: str | None, lease_s: float
) -> None:
    if owner is not None:
        service.catalog.claim(job["arn"], dead_process() if owner == "dead" else owner, lease_s)

    remove_abandoned_containers(service)

    assert fake.containers() == ["left"]
    assert doctor_checks.check_containers(service.settings).health == "ok"


def test_what_an_engine_did_not_remove_in_time_is_removed_later(
    service: Service, fake: FakeEngine, job: dict[str, Any]
) -> None:
    place = {"bucket": "results", "prefix": "here"}
    service.catalog.transition(job["arn"], "terminate", document_changes={"outputs": place})
    service.catalog.transition(job["arn"], "fail")

    fake.lose_daemon()
    remove_abandoned_containers(service)
    assert job["folder"].is_dir()

    fake.find_daemon()
    remove_abandoned_containers(service)
    assert fake.containers() == []
    assert not job["folder"].parent.exists()


def test_jobs_that_end_meanwhile_do_not_hide_the_others(service: Service, caplog: pytest.LogCaptureFixture) -> None:
    jobs, over = service.settings.home / "jobs", threading.Event()

    def come_and_go() -> None:
        while not over.is_set():
            for number in range(30):
                (jobs / f"sim-{number}" / "run").mkdir(parents=True)
            for number in range(30):
                (jobs / f"sim-{number}" / "run").rmdir()
                (jobs / f"sim-{number}").rmdir()

    others = threading.Thread(target=come_and_go)
    others.start()
    try:
        for _ in range(200):
            remove_abandoned_containers(service)
    finally:
        over.set()
        others.join()
    assert not caplog.records


@pytest.fixture
def taken_over(service: Service, order: Order) -> Any:
    """Makes a job that ended with the outputs of another run than the one whose folder is here, long ago."""

    def make(*, run_id: str = "2026-01-02T09-00-00-000000Z", outputs: bool = True, age_s: float = 3600.0) -> Any:
        arn = call("CreateSimulationJob", order(), service)["arn"]
        place = {"outputs": {"bucket": "results", "prefix": "there"}} if outputs else {}
        service.catalog.transition(arn, "prepare", document_changes={"runId": run_id})
        service.catalog.transition(arn, "terminate", document_changes=place)
        service.catalog.transition(arn, "fail")
        run = service.folder("jobs", arn.rpartition("/")[2], RUN)
        (run / "output").mkdir()
        (run / "output" / "log.txt").write_text("half a run")
        for path in (run / "output" / "log.txt", run / "output", run):
            changed_s = path.stat().st_mtime - age_s
            os.utime(path, (changed_s, changed_s))
        return run

    return make


def test_folders_of_runs_that_others_took_over_are_named_and_removed(
    service: Service, taken_over: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))  # without what others' job workers left
    elsewhere, stored, unstored = taken_over(), taken_over(run_id=RUN), taken_over(run_id=RUN, outputs=False)
    of_now, waiting = taken_over(age_s=0.0), service.folder("jobs", "sim-of-another-catalog", RUN)
    told = doctor_checks.check_left_behind(service.settings)
    assert (told.health, told.found.count("\n")) == ("warning", 1)
    assert str(elsewhere) in told.found

    assert set(remove_overtaken_runs(service)) == {elsewhere, stored}

    assert not elsewhere.parent.exists()
    assert all(folder.is_dir() for folder in (unstored, of_now, waiting))
    assert doctor_checks.check_left_behind(service.settings).health == "ok"


def test_a_job_that_goes_on_keeps_its_folders(service: Service, taken_over: Any, order: Order) -> None:
    job = call("CreateSimulationJob", order(), service)["arn"]
    run = taken_over()
    run.parent.rename(run.parents[1] / job.rpartition("/")[2])

    assert remove_overtaken_runs(service) == []
