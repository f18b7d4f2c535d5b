"""Jobs that are flaky for one planted cause each, from `tests/endurance/flaky_causes.yaml`."""

import random
import shutil
import socket
import threading
from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from uuid import uuid4

import yaml

from helpers.paths import BUNDLES
from helpers.swing_fixtures import ROLE, SUITE
from prefect_robomaker.tasks.jobs.job_runs import perform_job
from prefect_robomaker.tasks.operations.registry import call
from prefect_robomaker.tasks.runtime.agents import agent_client
from prefect_robomaker.tasks.service.service import Service
from prefect_robomaker.tasks.storage import pack_tar_gz

CAUSES = Path(__file__).parents[1] / "endurance" / "flaky_causes.yaml"
_LEFT_IN = (Path("/tmp"), Path("/dev/shm"))


def planted() -> list[dict[str, Any]]:
    """The causes."""
    return yaml.safe_load(CAUSES.read_text())["causes"]


def upload(service: Service, folder: Path) -> None:
    """Stores the applications of all causes: `walkway` and `driver`."""
    service.store.ensure_bucket("applications")
    robot = shutil.copytree(BUNDLES / "flaky_robot", folder / "robot")
    shutil.copy(agent_client.__file__, robot)
    for name, source in (("driver", robot), ("walkway", BUNDLES / "flaky_walkway")):
        pack_tar_gz(source, folder / f"{name}.tar.gz")
        service.store.put_file("applications", f"{name}.tar.gz", folder / f"{name}.tar.gz")
    for name in ("driver", "factory"):
        key = "driver" if name == "driver" else "walkway"
        source = [{"s3Bucket": "applications", "s3Key": f"{key}.tar.gz"}]
        call("CreateRobotApplication", {"name": name, "sources": source, "robotSoftwareSuite": SUITE}, service)
    request = {
        "name": "walkway",
        "sources": [{"s3Bucket": "applications", "s3Key": "walkway.tar.gz"}],
        "robotSoftwareSuite": SUITE,
        "simulationSoftwareSuite": {"name": "SimulationRuntime"},
    }
    call("CreateSimulationApplication", request, service)


def request_of(entry: Mapping[str, Any], variables: Mapping[str, str]) -> dict[str, Any]:
    """A job with one cause."""
    walkway = {"WALKWAY": entry["walkway"]} if "walkway" in entry else {}
    if entry.get("factory"):
        robot = {"application": "factory", "launchConfig": {"packageName": "walkway", "launchFile": "make_agent"}}
    else:
        unset = ["env", "-u", entry["unset"]] if "unset" in entry else []
        command = [*unset, "python3", "robot.py", entry.get("choice", "-"), entry.get("noise", "-")]
        launch = {"command": command, "environmentVariables": {**entry.get("variables", {}), **variables}}
        robot = {"application": "driver", "launchConfig": launch}
    simulation = {"packageName": "walkway", "launchFile": "make_environment", "environmentVariables": walkway}
    return {
        "maxJobDurationInSeconds": 60,
        "iamRole": ROLE,
        "seed": 3,
        "robotApplications": [robot],
        "simulationApplications": [{"application": "walkway", "launchConfig": simulation}],
    }


@contextmanager
def surroundings() -> Iterator[dict[str, str]]:
    """Variables that say which port, server and names a robot may use; what robots left is removed at the end."""
    name = f"flaky-{uuid4().hex[:8]}"
    with socket.create_server(("127.0.0.1", 0)) as server, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as asked:
        port = server.getsockname()[1]
        asked.bind(("127.0.0.1", port + 1 if port < 65535 else port - 1))
        for answer, one in ((_serve, server), (_answer, asked)):
            threading.Thread(target=answer, args=(one,), daemon=True).start()
        yield {
            "LEFT": name,
            "NAME": name,
            "PORT": str(asked.getsockname()[1]),
            "SERVER": f"http://127.0.0.1:{port}",
        }
    for folder in _LEFT_IN:
        left = folder / name
        if left.is_dir():
            shutil.rmtree(left)
        left.unlink(missing_ok=True)


def _serve(server: socket.socket) -> None:
    draw = random.SystemRandom()
    while True:
        try:
            connection, _ = server.accept()
        except OSError:
            return
        with connection:
            connection.recv(4096)
            word = b"go" if draw.random() < 0.5 else b"no"
            connection.sendall(b"HTTP/1.0 200 OK\r\nContent-Length: 2\r\n\r\n" + word)


def _answer(asked: socket.socket) -> None:
    draw = random.SystemRandom()
    while True:
        try:
            _, address = asked.recvfrom(16)
        except OSError:
            return
        asked.sendto(b"go" if draw.random() < 0.5 else b"no", address)


def run_planted(entry: Mapping[str, Any], service: Service, variables: Mapping[str, str]) -> list[str]:
    """Runs the jobs of a cause, at a time if it says so; returns their ARNs."""
    request = request_of(entry, variables)
    arns = [call("CreateSimulationJob", request, service)["arn"] for _ in range(entry.get("beside", 1))]
    with ThreadPoolExecutor(len(arns)) as pool:
        list(pool.map(lambda arn: perform_job(arn, service), arns))
    return arns
