"""How far off forecasts are: `plan --probe`, then `run`, each a process of its own, of five kinds of specifications."""

import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from statistics import median
from typing import Any

import pytest
from helpers.clusters import cluster_of
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


class Forecasts:
    """Forecasts and runs of specifications, each a process of its own; prints how far off each was.

    Args:
        environ: Environment variables of the commands.
        path: Where specifications are written.
    """

    def __init__(self, environ: dict[str, str], path: Path) -> None:
        self._environ = {**os.environ, "CI": "true", **environ}
        self._path = path
        self.errors: list[float] = []

    def check(self, what: str, steps: dict[str, Any], *options: str) -> None:
        self._path.write_text(json.dumps({"version": 1, "name": "forecast", "steps": steps}))
        forecast = self._ask("plan", "--probe", *options)["forecast"]
        check = self._ask("run", "--no-open")["forecast"]
        self.errors.append(check["took_s"] / check["forecast_s"] - 1)
        starts = ", ".join(f"{step['step']} {step['start_s']:.1f}" for step in forecast["steps"])
        print(
            f"{what}: forecast {check['forecast_s']:.1f} s, took {check['took_s']:.1f} s: {self.errors[-1]:+.0%}; "
            f"CPU {forecast['cpu_time_s']:.1f} s, start and end of steps {starts} s; load {os.getloadavg()[0]:.1f}"
        )

    def _ask(self, command: str, *options: str) -> dict[str, Any]:
        words = [*MAIN, command, str(self._path), *options, "-o", "json"]
        ended = subprocess.run(words, env=self._environ, capture_output=True, text=True, check=False, timeout=600)
        assert ended.returncode == 0, ended.stderr
        return json.loads(ended.stdout)


@pytest.fixture
def environ(settings: Settings, service: Service, prefect_server: str, tmp_path: Path) -> dict[str, str]:
    """The environment of commands, with the applications of the pendulum."""
    (tmp_path / "swinger").mkdir()
    upload_swinger(service, tmp_path / "swinger")
    request = {"sources": [{"s3Bucket": "applications", "s3Key": "swinger.tar.gz"}], "robotSoftwareSuite": SUITE}
    call("CreateRobotApplication", {"name": "pusher", **request}, service)
    runtime = {"name": "SimulationRuntime"}
    call("CreateSimulationApplication", {"name": "swing", **request, "simulationSoftwareSuite": runtime}, service)
    return {
        "ROBOMAKER_HOME": str(settings.home),
        "ROBOMAKER_CATALOG_URL": settings.catalog_url,
        "ROBOMAKER_OBJECT_STORE": settings.object_store,
        "ROBOMAKER_MAX_JOBS": str(settings.max_jobs),
        "PREFECT_API_URL": prefect_server,
    }


@pytest.mark.benchmark
@pytest.mark.timeout(1800)
def test_forecasts_of_five_specifications(
    environ: dict[str, str], order: Callable[..., dict[str, Any]], tmp_path: Path
) -> None:
    forecasts = Forecasts(environ, tmp_path / "forecast.yaml")
    computing = {"compute": batch([order({"DO": COMPUTES, "DURATION_S": "0"})] * 20)}
    print()
    for what, steps in {**SPECIFICATIONS, "20 jobs of 2 s of CPU time": computing}.items():
        forecasts.check(what, steps)
    print(f"median error {median(map(abs, forecasts.errors)):.0%}")


@pytest.mark.benchmark
@pytest.mark.timeout(900)
def test_a_forecast_for_two_machines_of_a_cluster(environ: dict[str, str], tmp_path: Path) -> None:
    """One job runs on each machine at once."""
    environ["ROBOMAKER_MAX_JOBS"] = "1"
    kept = {name: environ[name] for name in environ if name not in ("ROBOMAKER_HOME", "PREFECT_API_URL")}
    with cluster_of("dask", tmp_path / "cluster", kept) as cluster:
        cluster.add("first")
        cluster.add("second")
        environ["ROBOMAKER_BACKEND"] = cluster.backend
        forecasts = Forecasts(environ, tmp_path / "forecast.yaml")
        print()
        forecasts.check(
            "20 waiting jobs of 3 s on 2 machines of Dask",
            {"wait": batch([swing({"TIME_LIMIT_S": "3", "SLEEP_S": "0.02"})] * 20)},
            "--machines",
            "2",
        )
