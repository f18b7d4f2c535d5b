"""How quick the console's pages are with 100,000 jobs, and what a followed batch of 1,000 jobs costs."""

import contextlib
import http.client
import os
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from datetime import UTC, datetime
from statistics import median
from typing import Any

import pytest
from helpers.processes import started
from sqlalchemy import create_engine, insert, select, text

from prefect_robomaker.schemas.settings import Settings
from prefect_robomaker.tasks.catalog.resource_tags import insert_tags
from prefect_robomaker.tasks.catalog.tables import resources
from prefect_robomaker.tasks.service.service import Service

pytestmark = [pytest.mark.benchmark, pytest.mark.timeout(900)]

ARN = "arn:aws:robomaker:us-east-1:000000000000"
JOBS, IN_BATCH = 100_000, 1_000
BATCH = "simulation-job-batch"
ROUNDS = 20
FOLLOWED_S = 20.0


def row(kind: str, number: int, id_: str, document: dict[str, Any], **more: Any) -> dict[str, Any]:
    now = datetime.now(UTC)
    shared = {"sequence": number, "arn": f"{ARN}:{kind}/{id_}", "kind": kind, "id": id_, "name": "", "parent": None}
    stored = {"created_at": now, "updated_at": now, "revision": 3, "tags": {"suite": "nightly"}, "labels": {}}
    return {**shared, **stored, "status": "Completed", "document": document, **more}


def request(number: int) -> dict[str, Any]:
    world = f"{ARN}:world/generation-{number // 100:012d}/world-{number % 100 + 1}"
    launch = {"launchConfig": {"environmentVariables": {f"VARIABLE_{each}": "value" for each in range(10)}}}
    return {
        "maxJobDurationInSeconds": 600,
        "robotApplications": [{"application": "scout", **launch}],
        "simulationApplications": [{"application": "indoor-navigation", **launch, "worldConfigs": [{"world": world}]}],
    }


def job(number: int) -> dict[str, Any]:
    batch, index = divmod(number, IN_BATCH)
    verdict = "FAIL" if number % 50 == 0 else "PASS"
    document = {"request": request(number), "requestIndex": index, "seed": number, "verdict": verdict}
    document |= {"simulationTimeMillis": 1000, "verdictReason": "drives: 2 m of 9 m"}
    rare = {"rare": "yes"} if number == 7 else {}
    tags = {"suite": "nightly", **rare}
    parent = f"{ARN}:{BATCH}/batch-{batch:012d}"
    status = "Running" if batch == JOBS // IN_BATCH - 1 and index >= IN_BATCH // 2 else "Completed"
    return row("simulation-job", JOBS + number, f"sim-{number:012d}", document, parent=parent, tags=tags, status=status)


def batch(number: int) -> dict[str, Any]:
    requests = [request(number * IN_BATCH + index) for index in range(IN_BATCH)]
    policy = {"timeoutInSeconds": 600, "maxConcurrency": 4}
    document = {"request": {"createSimulationJobRequests": requests}, "batchPolicy": policy, "requestCount": IN_BATCH}
    status = "InProgress" if number == JOBS // IN_BATCH - 1 else "Completed"
    return row(BATCH, number + 1, f"batch-{number:012d}", document, status=status)


@pytest.fixture(scope="module")
def full(tmp_path_factory: pytest.TempPathFactory) -> Settings:
    """Settings of a service with 100 batches of 1,000 jobs; the last one goes on."""
    settings = Settings.from_environment({"ROBOMAKER_HOME": str(tmp_path_factory.mktemp("full") / "home")})
    Service.open(settings, {}).catalog.close()
    engine = create_engine(settings.catalog_url)
    with engine.begin() as connection:
        connection.exec_driver_sql("DELETE FROM resources")
        for number in range(JOBS // IN_BATCH):
            connection.execute(insert(resources), [batch(number)])
            connection.execute(insert(resources), [job(number * IN_BATCH + index) for index in range(IN_BATCH)])
        rows = connection.execute(select(resources.c.kind, resources.c.sequence, resources.c.tags)).all()
        for kind, sequence, tags in rows:
            insert_tags(connection, kind, sequence, tags)
    engine.dispose()
    return settings


@pytest.fixture(scope="module")
def server(full: Settings) -> Iterator[tuple[int, int]]:
    """Port and process id of `robomaker serve` on it, which runs no jobs."""
    command = [sys.executable, "-m", "prefect_robomaker.deployments.cli.main", "serve", "--port", "0"]
    environ = {"ROBOMAKER_HOME": str(full.home)}
    with started([*command, "--execute", "none"], environ, stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        port = int(process.stdout.readline().split(":")[2].split()[0])
        yield port, process.pid
        process.terminate()


def fetched(port: int, path: str) -> float:
    """Seconds that a page takes."""
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=60)
    began = time.perf_counter()
    connection.request("GET", path)
    answer = connection.getresponse()
    body = answer.read()
    elapsed = time.perf_counter() - began
    assert answer.status in (200, 404), body[:500]  # a search may find nothing
    connection.close()
    return elapsed


def test_pages_of_a_large_catalog(server: tuple[int, int]) -> None:
    port, pid = server
    last = f"batch-{JOBS // IN_BATCH - 1:012d}"
    paths = ("", "/jobs", "/jobs?status=Completed", "/jobs?tag=suite%3Dnightly", "/jobs?tag=rare%3Dyes",
             "/jobs?tag=rare%3Dyes&status=Completed", "/jobs?tag=suite%3Dnightly&status=Running", "/batches",
             "/batches?tag=suite%3Dnightly", f"/batches/{last}", f"/jobs/sim-{JOBS - 1:012d}", "/worlds", "/runs",
             "/fleets", "/robots", "/applications", "/search?q=nowhere")  # fmt: skip
    for path in paths:
        rounds = ROUNDS
        fetched(port, f"/console{path}")
        before = cpu_s(pid)
        times = sorted(fetched(port, f"/console{path}") for _ in range(rounds))
        each = (cpu_s(pid) - before) / rounds * 1000
        p95 = times[int(len(times) * 0.95)] * 1000
        print(f"\n/console{path}: p50 {median(times) * 1000:.1f} ms, p95 {p95:.1f} ms, CPU {each:.1f} ms", end="")


def test_a_followed_batch_of_1000_jobs(server: tuple[int, int], full: Settings) -> None:
    port, pid = server
    last = f"{JOBS // IN_BATCH - 1:012d}"
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=60)
    connection.request("GET", f"/console/batches/batch-{last}/live")
    stream = connection.getresponse()
    received = [0]

    def read() -> None:
        with contextlib.suppress(http.client.HTTPException, OSError, ValueError):  # the server ends it
            while part := stream.read1(65_536):
                received[0] += len(part)

    threading.Thread(target=read, daemon=True).start()
    time.sleep(3)
    engine = create_engine(full.catalog_url)
    before, sent = cpu_s(pid), received[0]
    for second in range(int(FOLLOWED_S)):  # two jobs end in each
        with engine.begin() as connection_:
            now = int(datetime.now(UTC).timestamp() * 1_000_000)
            ended = "updated_at = :now, status = 'Completed', revision = revision + 1"
            change = text(f"UPDATE resources SET {ended} WHERE id IN (:one, :two)")
            ids = [f"sim-{JOBS - 1 - 2 * second - each:012d}" for each in (0, 1)]
            connection_.execute(change, {"now": now, "one": ids[0], "two": ids[1]})
        time.sleep(1)
    share = (cpu_s(pid) - before) / FOLLOWED_S
    engine.dispose()
    print(f"\none follower: {100 * share:.1f} % of a core, {(received[0] - sent) / FOLLOWED_S / 1000:.1f} kB/s")


def cpu_s(pid: int) -> float:
    """CPU time that a process has used."""
    with open(f"/proc/{pid}/stat") as stat:  # noqa: PTH123 - a file of the kernel
        fields = stat.read().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
