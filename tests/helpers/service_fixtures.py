"""A service of its own for each test, and a template small enough to be quick."""

import copy
import json
import shutil
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from helpers.paths import BUNDLES
from helpers.small_flat import BODY, ROLE
from prefect_robomaker.schemas.settings import Settings
from prefect_robomaker.tasks.operations.registry import call, registry
from prefect_robomaker.tasks.runtime.supervision.launcher import Launcher
from prefect_robomaker.tasks.service.service import Service, Timing
from prefect_robomaker.tasks.storage import pack_tar_gz


@pytest.fixture
def timing() -> Timing:
    """How long the service waits for what; tests give others by `parametrize`."""
    return Timing()


@pytest.fixture(scope="session")
def launcher() -> Iterator[Launcher]:
    """One warm process for all runs of a test process: it takes longer to start than most runs.

    It is started before a test can change the environment: how runs are confined is found out then. Nothing can be
    rehearsed in its folder for temporary files, which would be a third of the work of a short run.
    """
    with Launcher() as launcher:
        with pytest.MonkeyPatch.context() as patch:
            patch.setenv("TMPDIR", "/proc")
            launcher.start()
        yield launcher


@pytest.fixture(scope="session")
def empty_home(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The home of an empty service: making the tables of a catalog takes as long as most tests."""
    home = tmp_path_factory.mktemp("empty") / "home"
    Service.open(Settings.from_environment({"ROBOMAKER_HOME": str(home)}), {}).catalog.close()
    return home


@pytest.fixture
def service(settings: Settings, timing: Timing, empty_home: Path) -> Service:
    """An empty service."""
    if not settings.home.exists():
        shutil.copytree(empty_home, settings.home)
    return replace(Service.open(settings, {}), timing=timing)


@pytest.fixture
def template(service: Service) -> str:
    """ARN of a template with two rooms."""
    request = {"name": "two rooms", "templateBody": json.dumps(BODY)}
    return call("CreateWorldTemplate", request, service)["arn"]


@pytest.fixture
def generate(service: Service, template: str, prefect_server: str) -> Callable[..., dict[str, Any]]:
    """Generates worlds and returns the job's final description."""

    def run(floorplans: int = 1, interiors: int = 1, **members: Any) -> dict[str, Any]:
        count = {"floorplanCount": floorplans, "interiorCountPerFloorplan": interiors}
        job = call(
            "CreateWorldGenerationJob", {"template": template, "worldCount": count, "seed": 7, **members}, service
        )
        return registry()["CreateWorldGenerationJob"].perform(job["arn"], service)

    return run


@pytest.fixture
def sleeper(service: Service, tmp_path: Path) -> dict[str, Any]:
    """The applications of a job request that does nothing for a while."""
    archive = tmp_path / "sleeper.tar.gz"
    bundle = tmp_path / "bundle"
    shutil.copytree(BUNDLES / "sleeper", bundle, ignore=shutil.ignore_patterns("__pycache__"))
    pack_tar_gz(bundle, archive)
    service.store.ensure_bucket("applications")
    service.store.put_file("applications", "sleeper.tar.gz", archive)
    source = [{"s3Bucket": "applications", "s3Key": "sleeper.tar.gz"}]
    suite = {"name": "General"}
    call("CreateRobotApplication", {"name": "watcher", "sources": source, "robotSoftwareSuite": suite}, service)
    request = {"name": "sleeper", "sources": source, "robotSoftwareSuite": suite}
    runtime = {"name": "SimulationRuntime"}
    call("CreateSimulationApplication", {**request, "simulationSoftwareSuite": runtime}, service)
    return {
        "robotApplications": [
            {"application": "watcher", "launchConfig": {"packageName": "sleeper", "launchFile": "make_agent"}}
        ],
        "simulationApplications": [
            {"application": "sleeper", "launchConfig": {"packageName": "sleeper", "launchFile": "make_environment"}}
        ],
    }


@pytest.fixture
def order(sleeper: dict[str, Any]) -> Callable[..., dict[str, Any]]:
    """Makes the request of a job that sleeps, with environment variables and further members."""

    def make(variables: dict[str, str] | None = None, **members: Any) -> dict[str, Any]:
        request = {"maxJobDurationInSeconds": 60, "iamRole": ROLE, **copy.deepcopy(sleeper), **members}
        if variables:
            request["simulationApplications"][0]["launchConfig"]["environmentVariables"] = variables
        return request

    return make


@pytest.fixture
def simulate(service: Service, prefect_server: str) -> Callable[[dict[str, Any]], dict[str, Any]]:
    """Runs a simulation job to its end and returns its description."""

    def run(request: dict[str, Any]) -> dict[str, Any]:
        job = call("CreateSimulationJob", request, service)
        return registry()["CreateSimulationJob"].perform(job["arn"], service)

    return run
