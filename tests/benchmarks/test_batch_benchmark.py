"""What orchestration costs: a batch of one-second jobs against the same processes under a plain pool."""

import shutil
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest
from helpers.paths import BUNDLES

from prefect_robomaker.flows.lookup import find_perform_flow
from prefect_robomaker.schemas.runs.plan import ApplicationPlan, RunPlan
from prefect_robomaker.tasks.jobs.job_runs import launcher
from prefect_robomaker.tasks.operations.registry import call
from prefect_robomaker.tasks.service.service import Service

JOBS = 50
WORKERS = 2


def _plan(folder: Path, number: int) -> RunPlan:
    work, output = folder / str(number) / "work", folder / str(number) / "output"
    work.mkdir(parents=True)
    output.mkdir()
    applications = BUNDLES / "sleeper"
    variables = {"DURATION_S": "1"}
    return RunPlan(
        job_id=f"sim-{number:012d}",
        job_arn=f"arn:aws:robomaker:us-east-1:000000000000:simulation-job/sim-{number:012d}",
        run_id="run",
        seed=number,
        max_duration_s=60.0,
        work_dir=work,
        output_dir=output,
        simulation_application=ApplicationPlan(
            role="simulation",
            name="sleeper",
            attribute="sleeper.make_environment",
            path=applications,
            environment_variables=variables,
        ),
        robot_application=ApplicationPlan(
            role="robot", name="watcher", attribute="sleeper.make_agent", path=applications
        ),
    )


@pytest.mark.benchmark
@pytest.mark.timeout(600)
def test_a_batch_against_a_plain_pool(
    service: Service, order: Callable[..., dict[str, Any]], prefect_server: str, tmp_path: Path
) -> None:
    launcher().start()
    plans = [_plan(tmp_path / "plain", number) for number in range(JOBS)]

    started = time.perf_counter()
    with ThreadPoolExecutor(WORKERS) as pool:
        outcomes = list(pool.map(lambda plan: launcher().run(plan, lambda: None), plans))
    plain_s = time.perf_counter() - started
    shutil.rmtree(tmp_path / "plain")

    requests = [order({"DURATION_S": "1"}) for _ in range(JOBS)]
    batch = {"createSimulationJobRequests": requests, "batchPolicy": {"maxConcurrency": WORKERS}}
    arn = call("StartSimulationJobBatch", batch, service)["arn"]
    started = time.perf_counter()
    with service.activated():
        ended = find_perform_flow("StartSimulationJobBatch")(arn)
    batch_s = time.perf_counter() - started

    assert {outcome.status for outcome in outcomes} == {"Completed"}
    assert [job["status"] for job in ended["createdRequests"]] == ["Completed"] * JOBS
    print(
        f"\n{JOBS} jobs of 1 s, {WORKERS} at a time: plain pool {plain_s:.1f} s, batch {batch_s:.1f} s, "
        f"ratio {batch_s / plain_s:.2f}"
    )
