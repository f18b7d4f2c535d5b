"""What the wire costs: requests per second and latencies, against a bare handler and against plain calls."""

import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from datetime import UTC, datetime
from pathlib import Path
from statistics import median
from typing import Any

import pytest
from helpers.endpoint_server import endpoint, http_request, load
from helpers.processes import started, wait_for
from sqlalchemy import create_engine, insert

from prefect_robomaker.schemas.settings import Settings
from prefect_robomaker.tasks.catalog.tables import resource_labels, resources
from prefect_robomaker.tasks.operations.registry import call
from prefect_robomaker.tasks.service.service import Service

pytestmark = [pytest.mark.benchmark, pytest.mark.timeout(900)]

ARN = "arn:aws:robomaker:us-east-1:000000000000"
JOBS = 10_000
WORLDS = 100_000
DURATION_S = 5.0
ROLE = "arn:aws:iam::000000000000:role/robomaker"


def _row(kind: str, number: int, document: dict[str, Any], **more: Any) -> dict[str, Any]:
    now = datetime.now(UTC)
    id_ = f"{number:012d}"
    return {
        "sequence": number,
        "arn": f"{ARN}:{kind}/{id_}",
        "kind": kind,
        "id": id_,
        "name": "",
        "status": "Completed",
        "parent": None,
        "created_at": now,
        "updated_at": now,
        "revision": 3,
        "tags": {"suite": "nightly"},
        "labels": {},
        "document": document,
        **more,
    }


def _job(number: int) -> dict[str, Any]:
    applications = {
        f"{role}Applications": [
            {
                "application": f"{ARN}:{role}-application/mine/1543190400000",
                "launchConfig": {"packageName": "mine", "launchFile": "make", "environmentVariables": {"A": "b"}},
            }
        ]
        for role in ("robot", "simulation")
    }
    document = {
        "request": {"maxJobDurationInSeconds": 600, "iamRole": ROLE, **applications},
        "seed": number,
        "video": "none",
        "simulationApplicationNames": ["mine"],
        "robotApplicationNames": ["mine"],
        "lastStartedAt": datetime.now(UTC).isoformat(),
        "simulationTimeMillis": 1000,
    }
    return _row("simulation-job", number, document)


def _world(number: int) -> dict[str, Any]:
    generation = f"{ARN}:world-generation-job/generation-{number // 50:012d}"
    template = f"{ARN}:world-template/template-{number // 1000:012d}"
    return _row("world", JOBS + number, {"template": template, "seed": number}, status="Active", parent=generation)


@pytest.fixture(scope="module")
def full(tmp_path_factory: pytest.TempPathFactory) -> Settings:
    """Settings of a service with 10,000 jobs and 100,000 worlds."""
    folder = tmp_path_factory.mktemp("full")
    settings = Settings.from_environment({"ROBOMAKER_HOME": str(folder / "home")})
    Service.open(settings, {}).catalog.close()
    engine = create_engine(settings.catalog_url)
    with engine.begin() as connection:
        connection.exec_driver_sql("DELETE FROM resources")
        connection.execute(insert(resources), [_job(number) for number in range(1, JOBS + 1)])
        connection.execute(insert(resources), [_world(number) for number in range(1, WORLDS + 1)])
        labels = [
            {"sequence": JOBS + number, "key": "templateId", "value": f"template-{number // 1000:012d}"}
            for number in range(1, WORLDS + 1)
        ]
        connection.execute(insert(resource_labels), labels)
    engine.dispose()
    return settings


@pytest.fixture(scope="module")
def port(full: Settings, tmp_path_factory: pytest.TempPathFactory) -> Iterator[int]:
    """An endpoint that serves it."""
    with endpoint(full, tmp_path_factory.mktemp("endpoint") / "log") as port:
        yield port


def _figures(times: list[float], per_second: float) -> str:
    return (
        f"p50 {median(times) * 1000:.2f} ms, p95 {times[int(len(times) * 0.95)] * 1000:.2f} ms, "
        f"p99 {times[int(len(times) * 0.99)] * 1000:.2f} ms, {per_second:.0f} requests/s"
    )


def _called(operation: str, requests: list[dict[str, Any]], settings: Settings) -> float:
    """Seconds for one plain call."""
    service = Service.open(settings, {})
    began = time.perf_counter()
    for request in requests:
        call(operation, request, service)
    elapsed = time.perf_counter() - began
    service.catalog.close()
    return elapsed / len(requests)


def test_describe_simulation_job(full: Settings, port: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    members = [{"job": f"{ARN}:simulation-job/{number:012d}"} for number in range(1, JOBS + 1, 7)]
    requests = [http_request("/describeSimulationJob", each) for each in members]
    load(port, requests, connections=8, duration_s=1)
    with endpoint(full, tmp_path / "bare", bare=True) as bare_port:
        load(bare_port, requests, connections=8, duration_s=1)
        bare = {count: load(bare_port, requests, connections=count, duration_s=DURATION_S) for count in (1, 8)}
    ours = {count: load(port, requests, connections=count, duration_s=DURATION_S) for count in (1, 8)}
    paced = load(port, requests, connections=8, duration_s=DURATION_S, per_second=300)
    direct_s = _called("DescribeSimulationJob", members, full)
    with capsys.disabled():
        print(f"\nDescribeSimulationJob, {JOBS} jobs in SQLite; a plain call takes {direct_s * 1000:.2f} ms")
        for count in (1, 8):
            print(f"{count} connections: {_figures(*ours[count])}; a bare handler: {_figures(*bare[count])}")
        print(f"300 requests/s offered on 8 connections: {_figures(*paced)}")
        print(
            f"of a bare handler's requests/s: {ours[8][1] / bare[8][1]:.2f}; "
            f"of one thread of plain calls: {ours[8][1] * direct_s:.2f}"
        )


@pytest.mark.parametrize("which", ["first page", "in the middle", "of a template"])
def test_list_worlds(full: Settings, port: int, which: str, capsys: pytest.CaptureFixture[str]) -> None:
    request: dict[str, Any] = {}
    if which == "of a template":
        request = {"filters": [{"name": "templateId", "values": ["template-000000000050"]}]}
    if which == "in the middle":
        service = Service.open(full, {})
        for _ in range(500):
            request = {"nextToken": call("ListWorlds", request, service)["nextToken"]}
        service.catalog.close()
    load(port, [http_request("/listWorlds", request)], connections=1, duration_s=1)
    one, eight = (
        load(port, [http_request("/listWorlds", request)], connections=count, duration_s=DURATION_S) for count in (1, 8)
    )
    direct_s = _called("ListWorlds", [request] * 100, full)
    with capsys.disabled():
        print(f"\nListWorlds, a page of 100 of {WORLDS} worlds, {which}; a plain call takes {direct_s * 1000:.2f} ms")
        print(f"1 connection: {_figures(*one)}; 8 connections: {_figures(*eight)}")


def test_create_simulation_job_while_a_batch_runs(
    service: Service,
    order: Callable[..., dict[str, Any]],
    prefect_server: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    jobs = [order({"DURATION_S": "2"}) for _ in range(30)]
    policy = {"maxConcurrency": 2}
    batch = call("StartSimulationJobBatch", {"batchPolicy": policy, "createSimulationJobRequests": jobs}, service)[
        "arn"
    ]
    environ = {"ROBOMAKER_HOME": str(service.settings.home), "PREFECT_API_URL": prefect_server}
    command = [sys.executable, "-m", "prefect_robomaker.deployments.cli.main", "perform", batch]

    def running() -> int:
        return service.catalog.count().get("simulation-job", {}).get("Running", 0)

    with endpoint(service.settings, tmp_path / "log") as port:
        request = [http_request("/createSimulationJob", order())]
        load(port, request, connections=1, duration_s=1)
        alone = load(port, request, connections=1, duration_s=DURATION_S)
        with started(command, environ, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL):
            wait_for(running, "a job of the batch to run", 120)
            busy = load(port, request, connections=1, duration_s=2 * DURATION_S)
            assert running()
    with capsys.disabled():
        print(f"\nCreateSimulationJob alone: {_figures(*alone)}")
        print(f"while a batch runs two jobs at a time: {_figures(*busy)}")
