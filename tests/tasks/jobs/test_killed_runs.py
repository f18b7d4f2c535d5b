"""Runs that are killed from outside are tried again, as long as they come further; crashes are not."""

import os
import signal
import threading
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from helpers.processes import wait_for, working_below
from helpers.swing_fixtures import outputs_of

from prefect_robomaker.schemas.runs.plan import RunResult
from prefect_robomaker.tasks.jobs.job_runs import launcher, perform_job
from prefect_robomaker.tasks.operations.registry import call
from prefect_robomaker.tasks.service.service import Service, Timing

Swing = Callable[..., dict[str, Any]]
SLOW = {"SLEEP_S": "0.01", "TIME_LIMIT_S": "6", "ROBOMAKER_CHECKPOINT_EVERY_S": "1"}


@pytest.fixture
def impatient(service: Service) -> Service:
    """The same service, which tries again soon."""
    return replace(service, timing=Timing(after_kill_s=0.05))


@pytest.fixture
def performing(impatient: Service) -> Callable[[str], threading.Thread]:
    """Performs a job in a thread."""

    def start(arn: str) -> threading.Thread:
        thread = threading.Thread(target=perform_job, args=(arn, impatient))
        thread.start()
        return thread

    return start


def checkpoints_of(service: Service, job: dict[str, Any]) -> list[Path]:
    return sorted((service.settings.home / "jobs" / job["name"]).glob("*/checkpoints/checkpoint-*.bin"))


def described(service: Service, job: dict[str, Any]) -> dict[str, Any]:
    return call("DescribeSimulationJob", {"job": job["arn"]}, service)


def result_of(service: Service, job: dict[str, Any]) -> RunResult:
    return RunResult.model_validate_json((outputs_of(service, job) / "result.json").read_bytes())


def test_a_run_whose_process_is_killed_goes_on_from_its_checkpoint_and_ends_in_the_same_state(
    service: Service, swing: Swing, performing: Callable[[str], threading.Thread]
) -> None:
    whole, job = swing(**SLOW), swing(perform=False, **SLOW)
    thread = performing(job["arn"])
    wait_for(lambda: checkpoints_of(service, job), "a checkpoint")
    for pid in working_below(service.settings.home / "jobs"):
        os.kill(pid, signal.SIGKILL)
    thread.join(120)

    assert described(service, job)["status"] == "Completed"
    assert service.catalog.get(job["arn"]).document["attempts"] == 2
    assert result_of(service, job).state_digest == result_of(service, whole).state_digest
    assert not list((service.settings.home / "jobs").glob(f"{job['name']}/*"))


@pytest.mark.deep
def test_a_run_that_is_killed_with_the_warm_process_it_came_from_is_tried_again(
    service: Service, swing: Swing, performing: Callable[[str], threading.Thread]
) -> None:
    job = swing(perform=False, **SLOW)
    thread = performing(job["arn"])
    wait_for(lambda: checkpoints_of(service, job), "a checkpoint")
    server = launcher()._server
    assert server is not None
    os.killpg(server._process.pid, signal.SIGKILL)
    for pid in working_below(service.settings.home / "jobs"):
        os.kill(pid, signal.SIGKILL)
    thread.join(120)

    assert described(service, job)["status"] == "Completed"


def test_a_run_that_is_killed_again_and_again_fails_in_the_end(
    service: Service, swing: Swing, performing: Callable[[str], threading.Thread]
) -> None:
    job = swing(perform=False, **{**SLOW, "KILL_AT": "3", "KILL_ALWAYS": "1"})
    performing(job["arn"]).join(120)

    ended = described(service, job)
    assert (ended["status"], ended["failureCode"]) == ("Failed", "SimulationApplicationCrash")
    assert "SIGKILL" in ended["failureReason"]
    assert "3 attempts" in ended["failureReason"]


def test_a_run_that_crashes_by_itself_is_not_tried_again(
    service: Service, swing: Swing, performing: Callable[[str], threading.Thread]
) -> None:
    job = swing(perform=False, **{**SLOW, "FAIL_AT": "3"})
    performing(job["arn"]).join(120)

    ended = described(service, job)
    assert (ended["status"], ended["failureCode"]) == ("Failed", "SimulationApplicationCrash")
    assert service.catalog.get(job["arn"]).document.get("attempts", 1) == 1
