"""A job in a container that attacks the machine it runs on: all that a program without a box could do is tried."""

import json
from pathlib import Path
from typing import Any

import pytest
from helpers.application_calls import Applications
from helpers.paths import TESTS
from helpers.real_engine import RealEngine
from helpers.small_flat import ROLE

from prefect_robomaker.tasks.jobs.job_runs import perform_job
from prefect_robomaker.tasks.operations.registry import call
from prefect_robomaker.tasks.service.service import Service

ESCAPES = TESTS / "attacks" / "escapes" / "escapes.py"
BY_THE_NETWORK = {"tcp", "tcp of version 6", "udp", "abstract socket", "network cards"}
"""The machine's network, which containers have."""

IN_ITS_OWN_FILES = {"chroot", "setuid", "system", "system programs", "shadow"}
"""Root of a container may do these in the container."""

OF_OLDER_ENGINES = {"io_uring"}
"""Docker refuses it since version 25."""


def order(image: str, script: str, service: Service, **members: Any) -> str:
    """Makes a job that is a container; returns its ARN."""
    Applications.of("Simulation", service).create("image", environment={"uri": image})
    service.store.ensure_bucket("results")
    launch = {"command": ["bash", "-c", script]}
    request = {
        "maxJobDurationInSeconds": 120,
        "iamRole": ROLE,
        "outputLocation": {"s3Bucket": "results"},
        "simulationApplications": [{"application": "image", "launchConfig": launch}],
        **members,
    }
    return call("CreateSimulationJob", request, service)["arn"]


@pytest.mark.deep
@pytest.mark.parametrize("user", ["root", pytest.param("robo", marks=pytest.mark.endurance)])
def test_a_container_reaches_the_network_and_its_own_files_and_nothing_else(
    service: Service, real_engine: RealEngine, targets: dict[str, Any], monkeypatch: pytest.MonkeyPatch, user: str
) -> None:
    monkeypatch.setenv("ROBOMAKER_CONTAINER_ENGINE", real_engine.program)
    for name, value in real_engine.environ.items():
        monkeypatch.setenv(name, value)
    service.store.ensure_bucket("applications")
    if "device" in targets:  # in a folder that this machine sees
        targets["device"] = "/opt/robomaker/output/device"
    service.store.put_bytes("applications", "attack/escapes.py", ESCAPES.read_bytes())
    service.store.put_bytes("applications", "attack/targets.json", json.dumps(targets).encode())
    keys = ["attack/escapes.py", "attack/targets.json"]
    image = real_engine.add_image(*([] if user == "root" else [f"USER {user}"]), python=True)

    arn = order(
        image,
        'cd "$ROBOMAKER_DATA_DIR/a/attack"; TARGETS=$(cat targets.json) python3 escapes.py',
        service,
        dataSources=[{"name": "a", "s3Bucket": "applications", "s3Keys": keys}],
    )
    perform_job(arn, service)

    job = call("DescribeSimulationJob", {"job": arn}, service)
    assert job["status"] == "Completed", job
    place = service.catalog.get(arn).document["outputs"]
    found = json.loads(service.store.get_bytes(place["bucket"], f"{place['prefix']}/escapes.json"))
    assert len(targets) >= 50
    assert set(found) >= BY_THE_NETWORK & set(targets), "the attacks ran"
    assert set(found) <= BY_THE_NETWORK | IN_ITS_OWN_FILES | OF_OLDER_ENGINES, found


@pytest.mark.parametrize("network", ["none", "local"])
def test_no_container_runs_where_jobs_must_not_have_the_machines_network(
    service: Service, network: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("ROBOMAKER_CONTAINER_ENGINE", str(tmp_path / "never called"))
    limits = {"sandbox": "require", "sandbox_network": network}
    confined = Service(service.settings.model_copy(update=limits), service.catalog, service.store)
    arn = order("somebody/robot:1", "true", service)

    perform_job(arn, confined)

    job = call("DescribeSimulationJob", {"job": arn}, service)
    assert (job["status"], job["failureCode"]) == ("Failed", "InternalServiceError")
    assert f"it cannot be '{network}' for them" in job["failureReason"]
