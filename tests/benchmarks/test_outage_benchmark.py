"""What an outage of the object store costs a batch, of the outage's own length."""

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import pytest
from helpers.s3_server import MortalS3Server

from prefect_robomaker.flows.lookup import find_perform_flow
from prefect_robomaker.tasks.operations.registry import call
from prefect_robomaker.tasks.service.service import Service
from prefect_robomaker.tasks.storage.s3 import S3Store

JOBS, JOB_S, AT_ONCE = 12, 5, 2
OUTAGE_S = 60.0


@dataclass(frozen=True)
class Done:
    """A batch that came to its end."""

    wall_s: float
    outage_s: float
    """How long the server was away."""


@pytest.fixture
def service(service: Service, mortal_s3: MortalS3Server) -> Service:
    """Objects on a server that may be killed; all times as in production."""
    server = mortal_s3.server
    return replace(service, store=S3Store(server.endpoint, "us-east-1", server.session()))


@pytest.mark.benchmark
@pytest.mark.timeout(900)
def test_what_an_outage_costs_a_batch(
    service: Service, order: Callable[..., dict[str, Any]], mortal_s3: MortalS3Server, prefect_server: str
) -> None:
    def run(outage_s: float) -> Done:
        requests = [order({"DURATION_S": str(JOB_S)}) for _ in range(JOBS)]
        batch = {"createSimulationJobRequests": requests, "batchPolicy": {"maxConcurrency": AT_ONCE}}
        arn = call("StartSimulationJobBatch", batch, service)["arn"]
        away_s = 0.0

        def outage() -> None:
            nonlocal away_s
            while "Completed" not in service.catalog.count_children(arn, kind="simulation-job"):
                time.sleep(0.1)
            mortal_s3.kill()
            killed = time.perf_counter()
            time.sleep(outage_s)
            mortal_s3.come_back()
            away_s = time.perf_counter() - killed

        trouble = threading.Thread(target=outage)
        if outage_s:
            trouble.start()
        began = time.perf_counter()
        with service.activated():
            ended = find_perform_flow("StartSimulationJobBatch")(arn)
        wall_s = time.perf_counter() - began
        if outage_s:
            trouble.join()
        assert [job["status"] for job in ended["createdRequests"]] == ["Completed"] * JOBS
        return Done(wall_s, away_s)

    run(0.0)  # what is imported and started once
    without, through = run(0.0), run(OUTAGE_S)

    cost_s = through.wall_s - without.wall_s
    print(
        f"\n{JOBS} jobs of {JOB_S} s, {AT_ONCE} at a time: {without.wall_s:.1f} s; with the server away for "
        f"{through.outage_s:.1f} s: {through.wall_s:.1f} s; the outage costs {cost_s / through.outage_s:.2f} of itself"
    )
