"""How far off forecasts are: `plan --probe` and then `run`, each a process of its own, of five kinds of specifications.

Prints for each forecast and wall time of the run, and at last the median of the errors.
"""

import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from statistics import median
from typing import Any

import pytest
from helpers.small_flat import BODY, ROLE
from helpers.swing_fixtures import SUITE, upload_swinger

from prefect_robomaker.schemas.settings import Settings
from prefect_robomaker.tasks.operations.registry import call
from prefect_robomaker.tasks.service.service import Service

MAIN = [sys.executable, "-m", "prefect_robomaker.deployments.cli.main"]
PREPARED = {"template": {"operation": "CreateWorldTemplate", "input": {"name": "flat", "templateBody": BODY}}}
WORLDS = {
    "operation": "CreateWorldGenerationJob",
    "input": {
        "template": "${{ template.arn }}",
        "worldCount": {"floorplanCount": 10, "interiorCountPerFloorplan": 2},
        "seed": 7,
    },
}
DRIVE = {
    "maxJobDurationInSeconds": 300,
    "seed": 1,
    "robotApplications": [{"application": "scout", "launchConfig": {}}],
    "simulationApplications": [
        {"application": "indoor-navigation", "launchConfig": {}, "worldConfigs": [{"world": "${{ world }}"}]}
    ],
}


def swing(variables: dict[str, str], **members: Any) -> dict[str, Any]:
    launch = {"packageName": "swinger", "launchFile": "make_environment", "environmentVariables": variables}
    return {
        "maxJobDurationInSeconds": 600,
        "iamRole": ROLE,
        "seed": 1,
        "robotApplications": [
            {"application": "pusher", "launchConfig": {"packageName": "swinger", "launchFile": "make_agent"}}
        ],
        "simulationApplications": [{"application": "swing", "launchConfig": launch}],
        **members,
    }


def batch(requests: Any) -> dict[str, Any]:
    policy = {"maxConcurrency": 2}
    return {
        "operation": "StartSimulationJobBatch",
        "input": {"createSimulationJobRequests": requests, "batchPolicy": policy},
    }


COMPUTES = "import time\nwhile time.process_time() < 2.0: pass"
"""What makes a job take two seconds of CPU time."""
SPECIFICATIONS: dict[str, dict[str, Any]] = {
    "30 waiting jobs of 3 s": {"wait": batch([swing({"TIME_LIMIT_S": "3", "SLEEP_S": "0.02"})] * 30)},
    "20 worlds, 20 robots": {
        **PREPARED,
        "worlds": WORLDS,
        "drive": batch(
            {"forEach": "${{ worlds.finishedWorldsSummary.succeededWorlds }}", "as": "world", "value": DRIVE}
        ),
    },
    "4 jobs of 500 trials": {"try": batch([swing({"TIME_LIMIT_S": "4"}, trials={"seeds": 500})] * 4)},
    "80 short jobs": {"short": batch([swing({"TIME_LIMIT_S": "0.2"})] * 80)},
}


@pytest.mark.benchmark
@pytest.mark.timeout(1800)
def test_forecasts_of_five_specifications(
    settings: Settings,
    service: Service,
    order: Callable[..., dict[str, Any]],
    prefect_server: str,
    tmp_path: Path,
) -> None:
    (tmp_path / "swinger").mkdir()
    upload_swinger(service, tmp_path / "swinger")
    request = {"sources": [{"s3Bucket": "applications", "s3Key": "swinger.tar.gz"}], "robotSoftwareSuite": SUITE}
    call("CreateRobotApplication", {"name": "pusher", **request}, service)
    runtime = {"name": "SimulationRuntime"}
    call("CreateSimulationApplication", {"name": "swing", **request, "simulationSoftwareSuite": runtime}, service)
    environ = {
        **os.environ,
        "ROBOMAKER_HOME": str(settings.home),
        "ROBOMAKER_MAX_JOBS": str(settings.max_jobs),
        "PREFECT_API_URL": prefect_server,
        "CI": "true",
    }

    def ask(*words: str) -> dict[str, Any]:
        ended = subprocess.run(
            [*MAIN, *words, "-o", "json"], env=environ, capture_output=True, text=True, check=False, timeout=600
        )
        assert ended.returncode == 0, ended.stderr
        return json.loads(ended.stdout)

    errors = []
    print()
    computing = {"compute": batch([order({"DO": COMPUTES, "DURATION_S": "0"})] * 20)}
    for what, steps in {**SPECIFICATIONS, "20 jobs of 2 s of CPU time": computing}.items():
        path = tmp_path / "forecast.yaml"
        path.write_text(json.dumps({"version": 1, "name": "forecast", "steps": steps}))
        forecast = ask("plan", str(path), "--probe")["forecast"]
        check = ask("run", str(path), "--no-open")["forecast"]
        errors.append(check["took_s"] / check["forecast_s"] - 1)
        starts = ", ".join(f"{step['step']} {step['start_s']:.1f}" for step in forecast["steps"])
        print(
            f"{what}: forecast {check['forecast_s']:.1f} s, took {check['took_s']:.1f} s: {errors[-1]:+.0%}; "
            f"CPU {forecast['cpu_time_s']:.1f} s, start and end of steps {starts} s"
        )
    print(f"median error {median(map(abs, errors)):.0%}; the load of the machine is {os.getloadavg()[0]:.1f}")
