"""The hostile bundle as applications of a service, and the command in this process."""

import os
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from helpers.attack_targets import key, listeners, targets, victim
from helpers.small_flat import ROLE

from prefect_robomaker.deployments.cli.main import main
from prefect_robomaker.tasks.operations.registry import call
from prefect_robomaker.tasks.service.service import Service
from prefect_robomaker.tasks.storage import pack_tar_gz

__all__ = ["key", "listeners", "targets", "victim"]


@pytest.fixture
def robomaker(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Iterator[Callable[..., tuple[int, str, str]]]:
    """Runs `robomaker` here with a home and words; returns its exit code, what it wrote and what it complained of."""
    before = dict(os.environ)
    monkeypatch.delenv("PREFECT_API_URL", raising=False)
    monkeypatch.setenv("CI", "true")

    def run(home: object, *words: object) -> tuple[int, str, str]:
        monkeypatch.setenv("ROBOMAKER_HOME", str(home))
        try:
            code = main([str(word) for word in words])
        except SystemExit as end:
            code = int(end.code or 0)
        told = capsys.readouterr()
        return code, told.out, told.err

    yield run
    # Commands tell Prefect by variables where its server is.
    os.environ.clear()
    os.environ.update(before)


@pytest.fixture
def hostile(service: Service, tmp_path: Path) -> Callable[..., dict[str, Any]]:
    """Makes requests of jobs that run something of the hostile bundle."""
    bundle, archive = tmp_path / "bundle", tmp_path / "hostile.tar.gz"
    shutil.copytree(Path(__file__).parent / "bundle", bundle, ignore=shutil.ignore_patterns("__pycache__"))
    pack_tar_gz(bundle, archive)
    for bucket in ("applications", "results"):
        service.store.ensure_bucket(bucket)
    service.store.put_file("applications", "hostile.tar.gz", archive)
    sources = [{"s3Bucket": "applications", "s3Key": "hostile.tar.gz"}]
    robot = {"name": "driver", "sources": sources, "robotSoftwareSuite": {"name": "General"}}
    call("CreateRobotApplication", robot, service)
    arena = {**robot, "name": "arena", "simulationSoftwareSuite": {"name": "SimulationRuntime"}}
    call("CreateSimulationApplication", arena, service)

    def make(
        environment: str = "hostile.arena.calm", agent: str = "hostile.arena.agent", duration_s: int = 30, **config: Any
    ) -> dict[str, Any]:
        variables = {"PROCESSES": str(tmp_path / "processes")}
        return {
            "maxJobDurationInSeconds": duration_s,
            "iamRole": ROLE,
            "outputLocation": {"s3Bucket": "results", "s3Prefix": "attack"},
            "robotApplications": [{"application": "driver", "launchConfig": _launch(agent, variables)}],
            "simulationApplications": [
                {"application": "arena", "launchConfig": _launch(environment, variables), **config}
            ],
        }

    return make


def _launch(attribute: str, variables: dict[str, str]) -> dict[str, Any]:
    package, _, file = attribute.partition(".")
    return {"packageName": package, "launchFile": file, "environmentVariables": variables}
