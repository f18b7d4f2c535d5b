"""Cost of videos of failures: twenty jobs that compute for eight seconds and fail, with and without videos.

Measured is the time until the last job has simulated, since what is left then holds up no other job. It needs a machine
with nothing beside it: a job computes for the processor time that it is given.
"""

from collections.abc import Callable
from datetime import datetime
from typing import Any

import pytest

from prefect_robomaker.schemas.documents.simulation_jobs import SimulationJobDocument
from prefect_robomaker.tasks.operations.registry import call, registry
from prefect_robomaker.tasks.service.service import Service

JOBS, AT_ONCE, STEPS = 20, 2, 400
COMPUTED = {"COMPUTE_S": f"{8 / STEPS}", "TIME_LIMIT_S": f"{STEPS * 0.02}", "LIMIT": "-9"}


@pytest.mark.benchmark
@pytest.mark.timeout(1800)
def test_failing_jobs_simulate_as_fast_with_videos_as_without(
    service: Service, swing: Callable[..., dict[str, Any]], prefect_server: str
) -> None:
    took = {}
    for video in ("none", "on-failure"):
        job = swing(perform=False, job={"video": video}, **COMPUTED)
        request = service.catalog.get(job["arn"]).document["request"]
        requests = [{**request, "seed": seed} for seed in range(JOBS)]
        order = {"createSimulationJobRequests": requests, "batchPolicy": {"maxConcurrency": AT_ONCE}}
        batch = service.catalog.get(call("StartSimulationJobBatch", order, service)["arn"])
        registry()["StartSimulationJobBatch"].perform(batch.arn, service)
        documents = [SimulationJobDocument.of(each) for each in service.catalog.children(batch.arn, "simulation-job")]
        assert {document.verdict for document in documents} == {"FAIL"}
        simulated = max(datetime.fromisoformat(document.simulated_at or "") for document in documents)
        ended = service.catalog.get(batch.arn).updated_at
        took[video] = (simulated - batch.created_at).total_seconds(), (ended - batch.created_at).total_seconds()
        drawn_s = sum(document.video_s or 0.0 for document in documents)
        print(f"\n{video}: simulated in {took[video][0]:.1f} s, ended in {took[video][1]:.1f} s, drew {drawn_s:.1f} s")
    print(f"ratio {took['on-failure'][0] / took['none'][0]:.2f}, {JOBS} jobs of 8 s, {AT_ONCE} at once")
