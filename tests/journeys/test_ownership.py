"""Who orders a run carries it out, in his own environment, though `robomaker serve` waits for jobs on the same home."""

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from helpers.endpoint_process import Serve
from helpers.paths import BUNDLES
from helpers.processes import started

from prefect_robomaker.schemas.reports.run_record import RunRecord
from prefect_robomaker.tasks.service.service import Service

ROBOMAKER = [sys.executable, "-m", "prefect_robomaker.deployments.cli.main"]
SUITE = {"name": "General"}
MINE = {"PYTHONPATH": str(BUNDLES / "sleeper"), "PYTHONDONTWRITEBYTECODE": "1"}
"""Variables with which the caller's application is found, and without which it is not."""


@pytest.fixture
def environ(service: Service, prefect_server: str, tmp_path: Path) -> dict[str, str]:
    """Environment variables that lead other processes to the test's service."""
    return {
        "ROBOMAKER_HOME": str(service.settings.home),
        "PREFECT_API_URL": prefect_server,
        "PREFECT_HOME": str(tmp_path / "prefect"),
        "CI": "true",
    }


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


def test_serve_leaves_a_run_to_who_started_it(
    service: Service, environ: dict[str, str], spec: Any, serve: Serve
) -> None:
    with serve(**environ) as served:
        served.wait_until_ready()
        command = [*ROBOMAKER, "run", str(spec()), "-o", "json"]
        with started(command, {**environ, **MINE}, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as run:
            out, err = run.communicate(timeout=300)

    assert run.returncode == 0, out + err
    record = RunRecord.model_validate_json(out)
    assert [job.status for job in record.jobs] == ["Completed"] * 3
