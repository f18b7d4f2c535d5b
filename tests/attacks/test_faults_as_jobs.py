"""Faults as real jobs while another job runs: right status, right code, the other untouched, no process left."""

import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from helpers.processes import wait_for, working_below
from helpers.run_processes import processes_with

from prefect_robomaker.schemas.runs.plan import RunResult
from prefect_robomaker.tasks.jobs.job_runs import perform_job
from prefect_robomaker.tasks.operations.registry import call
from prefect_robomaker.tasks.service.service import Service

Order = Callable[..., dict[str, Any]]
ROBOT, SIMULATION = "RobotApplicationCrash", "SimulationApplicationCrash"


@pytest.fixture
def bystander(service: Service, order: Order) -> Iterator[str]:
    """Another job of the same job worker; it has to be as alive afterwards as before."""
    arn = call("CreateSimulationJob", order({"DURATION_S": "100"}), service)["arn"]
    worker = threading.Thread(target=perform_job, args=(arn, service))
    worker.start()
    wait_for(lambda: call("DescribeSimulationJob", {"job": arn}, service)["status"] == "Running", "it to run")
    yield arn
    assert call("DescribeSimulationJob", {"job": arn}, service)["status"] == "Running"
    call("CancelSimulationJob", {"job": arn}, service)
    worker.join(120)
    assert result_of(service, arn).ended_by == "canceled"
    assert working_below(service.settings.home) == set()


@pytest.fixture
def perform(service: Service, bystander: str, tmp_path: Path) -> Callable[[dict[str, Any]], dict[str, Any]]:
    """Performs a job to its end; checks that none of its processes is left."""

    def run(request: dict[str, Any]) -> dict[str, Any]:
        job = call("CreateSimulationJob", request, service)
        perform_job(job["arn"], service)
        assert processes_with(job["arn"]) == []
        return call("DescribeSimulationJob", {"job": job["arn"]}, service)

    return run


def result_of(service: Service, arn: str) -> RunResult:
    place = service.catalog.get(arn).document["outputs"]
    return RunResult.model_validate_json(service.store.get_bytes(place["bucket"], f"{place['prefix']}/result.json"))


def tool(command: str, behavior: str) -> dict[str, Any]:
    return {"name": "watch", "command": command, "exitBehavior": behavior}


HOG = "hog = []\nwhile True: hog.append(b'x' * 8_000_000)"
CLOSE = "import os, sys\nsys.stdout.close()\nsys.stdout = sys.stderr = None\nos.close(1)\nos.close(2)"
BOMB = "import os, time\nfor _ in range(11): os.fork()\ntime.sleep(100)"


@pytest.mark.parametrize(
    ("fault", "members", "words"),
    [
        pytest.param(
            "import os; os._exit(0)",
            {},
            "ended itself with exit code 0 before the run was over",
            marks=pytest.mark.deep,
        ),
        ("import os; os.kill(os.getpid(), 11)", {}, "killed by SIGSEGV"),
        pytest.param(
            HOG, {"compute": {"simulationUnitLimit": 1}}, "2048 MiB of memory are allowed", marks=pytest.mark.endurance
        ),
        # Processes, or their memory, which cannot be measured exactly while they fork: the first one found.
        pytest.param(BOMB, {}, "used too much", marks=pytest.mark.endurance),
    ],
    ids=["leaves at import", "segmentation fault", "memory hog", "fork bomb"],
)
def test_a_fault_fails_its_job_alone(
    order: Order, perform: Callable[..., dict[str, Any]], fault: str, members: dict[str, Any], words: str
) -> None:
    job = perform(order({"DO": fault}, **members))

    assert (job["status"], job["failureCode"]) == ("Failed", SIMULATION)
    assert words in job["failureReason"]


@pytest.mark.deep
def test_an_endless_loop_ends_at_the_duration_limit(order: Order, perform: Callable[..., dict[str, Any]]) -> None:
    job = perform(order({"DO": "while True: pass"}, maxJobDurationInSeconds=1))

    assert job["status"] == "Completed"
    assert "failureCode" not in job


@pytest.mark.deep
def test_closed_streams_do_no_harm(service: Service, order: Order, perform: Callable[..., dict[str, Any]]) -> None:
    job = perform(order({"DO": CLOSE}))

    assert job["status"] == "Completed", job.get("failureReason")
    assert result_of(service, job["arn"]).ended_by == "environment"


@pytest.mark.deep
def test_a_killed_tool_that_may_not_end_fails_its_job(order: Order, perform: Callable[..., dict[str, Any]]) -> None:
    request = order({"DURATION_S": "60"})
    request["robotApplications"][0]["tools"] = [tool("sleep 100 & kill -9 $$", "FAIL")]

    job = perform(request)

    assert (job["status"], job["failureCode"]) == ("Failed", ROBOT)
    assert job["failureReason"].startswith("Tool watch of robot application watcher was killed by SIGKILL")


@pytest.mark.deep
def test_a_killed_tool_that_is_started_again_is_told(
    service: Service, order: Order, perform: Callable[..., dict[str, Any]]
) -> None:
    request = order({"DURATION_S": "1"})
    request["simulationApplications"][0]["tools"] = [tool("sleep 100 & kill -9 $$", "RESTART")]

    job = perform(request)

    assert job["status"] == "Completed", job.get("failureReason")
    [told] = result_of(service, job["arn"]).tools
    assert (told.role, told.name, told.last_end) == ("simulation", "watch", "was killed by SIGKILL")


def test_a_robot_that_never_comes_is_unhealthy(order: Order, perform: Callable[..., dict[str, Any]]) -> None:
    request = order({"DURATION_S": "60"})
    request["robotApplications"][0]["launchConfig"] = {
        "command": ["sleep", "100"],
        "environmentVariables": {"ROBOMAKER_AGENT_CONNECT_TIMEOUT_S": "0.3"},
    }

    job = perform(request)

    assert (job["status"], job["failureCode"]) == ("Failed", "RobotApplicationHealthCheckFailure")
    assert "did not connect within 0.3 s" in job["failureReason"]
