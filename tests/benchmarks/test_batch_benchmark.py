"""What orchestration costs: a batch of one-second jobs against the same processes under a plain pool."""

import shutil
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from helpers.clusters import cluster_of
from helpers.paths import BUNDLES

from prefect_robomaker.flows.lookup import find_perform_flow
from prefect_robomaker.schemas.runs.plan import ApplicationPlan, RunPlan
from prefect_robomaker.tasks.backends.backend import open_backend
from prefect_robomaker.tasks.jobs.job_runs import launcher
from prefect_robomaker.tasks.operations.registry import call
from prefect_robomaker.tasks.service.service import Service

WORKERS = 2


def _plan(folder: Path, number: int, **variables: str) -> RunPlan:
    work, output = folder / str(number) / "work", folder / str(number) / "output"
    work.mkdir(parents=True)
    output.mkdir()
    applications = BUNDLES / "sleeper"
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
@pytest.mark.timeout(1200)
@pytest.mark.parametrize(
    ("jobs", "variables"),
    [(50, {"DURATION_S": "1"}), (200, {"DURATION_S": "2", "COMPUTES": "1"})],
    ids=["that wait", "that compute"],
)
def test_a_batch_against_a_plain_pool(
    jobs: int,
    variables: dict[str, str],
    service: Service,
    order: Callable[..., dict[str, Any]],
    prefect_server: str,
    tmp_path: Path,
) -> None:
    launcher().start()
    plans = [_plan(tmp_path / "plain", number, **variables) for number in range(jobs)]

    started = time.perf_counter()
    with ThreadPoolExecutor(WORKERS) as pool:
        outcomes = list(pool.map(lambda plan: launcher().run(plan, lambda: None), plans))
    plain_s = time.perf_counter() - started
    shutil.rmtree(tmp_path / "plain")

    requests = [order(variables) for _ in range(jobs)]
    batch = {"createSimulationJobRequests": requests, "batchPolicy": {"maxConcurrency": WORKERS}}
    arn = call("StartSimulationJobBatch", batch, service)["arn"]
    started = time.perf_counter()
    with service.activated():
        ended = find_perform_flow("StartSimulationJobBatch")(arn)
    batch_s = time.perf_counter() - started

    assert {outcome.status for outcome in outcomes} == {"Completed"}
    assert [job["status"] for job in ended["createdRequests"]] == ["Completed"] * jobs
    print(
        f"\n{jobs} jobs of {variables}, {WORKERS} at a time: plain pool {plain_s:.1f} s, batch {batch_s:.1f} s, "
        f"ratio {batch_s / plain_s:.2f}"
    )


MANY_JOBS, MANY_AT_ONCE = 1000, 16


@pytest.mark.benchmark
@pytest.mark.timeout(1200)
def test_what_a_job_costs_its_coordinator(
    service: Service, order: Callable[..., dict[str, Any]], prefect_server: str
) -> None:
    """CPU of the one process that runs the batch: jobs and Prefect's server are other processes."""
    requests = [order({"DURATION_S": "1"}) for _ in range(MANY_JOBS)]
    batch = {"createSimulationJobRequests": requests, "batchPolicy": {"maxConcurrency": MANY_AT_ONCE}}
    arn = call("StartSimulationJobBatch", batch, service)["arn"]
    many = replace(service, settings=service.settings.model_copy(update={"max_jobs": MANY_AT_ONCE}))
    began, began_cpu = time.perf_counter(), time.process_time()
    with many.activated():
        ended = find_perform_flow("StartSimulationJobBatch")(arn)
    wall_s, cpu_s = time.perf_counter() - began, time.process_time() - began_cpu

    assert {job["status"] for job in ended["createdRequests"]} == {"Completed"}
    print(
        f"\n{MANY_JOBS} jobs of 1 s, {MANY_AT_ONCE} at a time: {wall_s:.1f} s, the coordinator's CPU "
        f"{cpu_s:.1f} s, {cpu_s / MANY_JOBS * 1000:.0f} ms a job"
    )


ELSEWHERE_JOBS = 40


@pytest.mark.benchmark
@pytest.mark.timeout(900)
@pytest.mark.parametrize("kind", ["dask", "ray"])
def test_a_batch_on_two_machines_of_a_cluster_against_a_plain_pool(
    kind: str, service: Service, order: Callable[..., dict[str, Any]], prefect_server: str, tmp_path: Path
) -> None:
    """Jobs of two seconds, that wait: all servers and machines share the cores here."""
    launcher().start()
    plans = [_plan(tmp_path / "plain", number, DURATION_S="2") for number in range(ELSEWHERE_JOBS)]
    started = time.perf_counter()
    with ThreadPoolExecutor(WORKERS) as pool:
        list(pool.map(lambda plan: launcher().run(plan, lambda: None), plans))
    plain_s = time.perf_counter() - started
    shutil.rmtree(tmp_path / "plain")

    variables = {
        "ROBOMAKER_CATALOG_URL": service.settings.catalog_url,
        "ROBOMAKER_OBJECT_STORE": service.settings.object_store,
        "ROBOMAKER_MAX_JOBS": "1",
    }
    requests = [order({"DURATION_S": "2"}) for _ in range(ELSEWHERE_JOBS)]
    batch = {"createSimulationJobRequests": requests, "batchPolicy": {"maxConcurrency": WORKERS}}
    arn = call("StartSimulationJobBatch", batch, service)["arn"]
    with cluster_of(kind, tmp_path / "cluster", variables) as cluster:
        cluster.add("first")
        cluster.add("second")
        began = time.time()
        with replace(service, backend=open_backend(cluster.backend)).activated():
            ended = find_perform_flow("StartSimulationJobBatch")(arn)
        whole_s = time.time() - began

    assert [job["status"] for job in ended["createdRequests"]] == ["Completed"] * ELSEWHERE_JOBS
    jobs = [call("DescribeSimulationJob", {"job": job["arn"]}, service) for job in ended["createdRequests"]]
    first, second, *_ = sorted(job["lastStartedAt"].timestamp() for job in jobs)
    last = max(job["lastStartedAt"].timestamp() + job["simulationTimeMillis"] / 1000 for job in jobs)
    print(
        f"\n{ELSEWHERE_JOBS} jobs of 2 s on 2 machines of {kind}: plain pool {plain_s:.1f} s, from the start of the "
        f"first job to the end of the last {last - first:.1f} s, ratio {(last - first) / plain_s:.3f}; start-up "
        f"{first - began:.1f} s, second machine {second - first:.1f} s later, end {began + whole_s - last:.1f} s"
    )
