"""The worked examples of launch configurations, run as they stand."""

import sys
from pathlib import Path
from typing import Any

import pytest
import yaml
from helpers.fake_engine import FakeEngine
from helpers.paths import REPOSITORY
from helpers.small_flat import ROLE

from prefect_robomaker.schemas.runs.plan import RunResult
from prefect_robomaker.tasks.jobs.job_runs import perform_job
from prefect_robomaker.tasks.operations.registry import call
from prefect_robomaker.tasks.service.service import Service
from prefect_robomaker.tasks.storage import pack_tar_gz

EXAMPLES = REPOSITORY / "deployments" / "specs" / "examples"
WAYS = ("factory", "installed", "script", "command")


@pytest.fixture
def archives(service: Service, tmp_path: Path) -> None:
    """The two archives, where the examples say that they are."""
    service.store.ensure_bucket("robomaker")
    for name, folder in (("cartpole", "cartpole_bundle"), ("balancer", "five_ways/bundle")):
        pack_tar_gz(EXAMPLES / folder, tmp_path / f"{name}.tar.gz")
        service.store.put_file("robomaker", f"applications/{name}.tar.gz", tmp_path / f"{name}.tar.gz")


def requests_of(spec: str, service: Service) -> list[dict[str, Any]]:
    """The requests of a specification's batch, whose applications are made."""
    steps = yaml.safe_load((EXAMPLES / "five_ways" / spec).read_text())["steps"]
    for step in steps.values():
        if step["operation"].endswith("Application"):
            call(step["operation"], step["input"], service)
    return steps["balance"]["input"]["createSimulationJobRequests"]


def balanced(request: dict[str, Any], service: Service) -> tuple[dict[str, Any], RunResult, str]:
    """Runs a request; returns the job, its result and the robot's log."""
    arn = call("CreateSimulationJob", {**request, "iamRole": ROLE}, service)["arn"]
    perform_job(arn, service)
    job = call("DescribeSimulationJob", {"job": arn}, service)
    assert job["status"] == "Completed", job
    place = service.catalog.get(arn).document["outputs"]

    def read(name: str) -> bytes:
        keys = {item.key for item in service.store.list(place["bucket"], place["prefix"])}
        key = f"{place['prefix']}/{name}"
        return service.store.get_bytes(place["bucket"], key) if key in keys else b""

    return job, RunResult.model_validate_json(read("result.json")), read("logs/robot.stdout.log").decode()


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.usefixtures("archives")
def test_the_pole_stays_up_whichever_way_the_robot_is_started(
    service: Service, monkeypatch: pytest.MonkeyPatch, way: str
) -> None:
    monkeypatch.syspath_prepend(str(EXAMPLES / "cartpole_bundle"))

    job, result, log = balanced(requests_of("five_ways.yaml", service)[WAYS.index(way)], service)

    assert result.verdict == "PASS", result.summary
    assert result.ended_by == "environment"
    if way in ("script", "command"):
        assert "balancing in run 20" in log, job
    assert ("balance 1.5" in log) is (way == "command")


@pytest.mark.deep
@pytest.mark.usefixtures("archives")
def test_the_pole_stays_up_with_the_robot_in_a_container(
    service: Service, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    fake = FakeEngine(tmp_path / "engine")
    robot = EXAMPLES / "five_ways/bundle/balancer/balance.py"
    # In the image the socket is in the folder that is mounted; the fake engine's programs see this machine's.
    script = f'export ROBOMAKER_AGENT_SOCKET=$MOUNT_OPT_ROBOMAKER_AGENT/agent.sock; exec "{sys.executable}" "{robot}"'
    fake.add_image("cartpole-balancer", command=["bash", "-c", script])
    monkeypatch.setenv("ROBOMAKER_CONTAINER_ENGINE", str(fake.program))

    _, result, log = balanced(requests_of("container.yaml", service)[0], service)

    assert result.verdict == "PASS", result.summary
    assert "balancing in run 20" in log
    assert fake.containers() == []
