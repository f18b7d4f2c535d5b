"""Interruptions of real processes: nothing goes on running, nothing is left half done, nothing is done twice."""

import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from helpers.processes import process_worker, started, wait_for, working_below

from prefect_robomaker.schemas.reports.run_record import RunRecord
from prefect_robomaker.tasks.catalog import Resource
from prefect_robomaker.tasks.operations.registry import call, registry
from prefect_robomaker.tasks.service.service import Progress, Service

pytestmark = pytest.mark.slow
Order = Callable[..., dict[str, Any]]
ROBOMAKER = [sys.executable, "-m", "prefect_robomaker.deployments.cli.main"]
LONG = {"DURATION_S": "200"}
PERFORM = """
import os, sys
from dataclasses import replace
from prefect_robomaker.tasks.operations.registry import registry
from prefect_robomaker.schemas.settings import Settings
from prefect_robomaker.tasks.service.service import Service
from prefect_robomaker.tasks.service.service import Timing

service = Service.open(Settings.from_environment(os.environ))
service = replace(service, timing=Timing(lease_s=6.0, renew_lease_every_s=0.5))
registry()["StartSimulationJobBatch"].perform(sys.argv[1], service)
"""


@pytest.fixture
def run_spec(environ: dict[str, str], spec: Callable[[dict[str, Any]], Path]) -> Callable[..., Any]:
    """Starts `robomaker run` on steps."""

    def run(steps: dict[str, Any]) -> Any:
        command = [*ROBOMAKER, "run", str(spec(steps)), "-o", "json"]
        return started(command, environ, stdout=subprocess.PIPE, stderr=subprocess.PIPE)

    return run


@pytest.fixture
def spec(tmp_path: Path) -> Callable[[dict[str, Any]], Path]:
    """Writes a specification."""

    def write(steps: dict[str, Any]) -> Path:
        path = tmp_path / "spec.yaml"
        path.write_text(json.dumps({"version": 1, "name": "long", "steps": steps}))
        return path

    return write


def batch_of(*requests: dict[str, Any], at_once: int) -> dict[str, Any]:
    return {"createSimulationJobRequests": list(requests), "batchPolicy": {"maxConcurrency": at_once}}


def jobs(service: Service) -> list[Resource]:
    return list(reversed(service.catalog.list("simulation-job").resources))


def running(service: Service, count: int) -> set[int]:
    """Waits until simulations run; returns their processes."""
    folder = service.settings.home / "jobs"

    def processes() -> set[int] | None:
        found = working_below(folder)
        return found if len(found) == count and sum(job.status == "Running" for job in jobs(service)) == count else None

    found = wait_for(processes, f"{count} running simulations")
    assert found is not None
    return found


@pytest.mark.deep
def test_ctrl_c_ends_a_batch_and_reports_it(service: Service, order: Order, run_spec: Callable[..., Any]) -> None:
    batch = batch_of(*[order(LONG) for _ in range(3)], at_once=2)
    with run_spec({"drive": {"operation": "StartSimulationJobBatch", "input": batch}}) as robomaker:
        running(service, 2)
        # As a terminal does: to everything in the foreground.
        os.killpg(robomaker.pid, signal.SIGINT)
        out, err = robomaker.communicate(timeout=120)

    assert robomaker.returncode == 130, err
    assert not working_below(service.settings.home)
    (stored,) = service.catalog.list("simulation-job-batch").resources
    described = call("DescribeSimulationJobBatch", {"batch": stored.arn}, service)
    assert described["status"] == "Canceled"
    assert [job["status"] for job in described["createdRequests"]] == ["Canceled", "Canceled"]
    assert [request["failureCode"] for request in described["failedRequests"]] == ["BatchCanceled"]
    assert described["pendingRequests"] == []
    assert {job.document["failureCode"] for job in jobs(service)} == {"BatchCanceled"}
    record = RunRecord.model_validate_json(out)
    assert record.state == "canceled"
    assert [(step.status, step.error) for step in record.steps] == [("Canceled", "interrupted")]
    assert [job.status for job in record.jobs] == ["Canceled", "Canceled", "NotCreated"]
    assert record.report_path is not None
    assert record.report_path.is_file()
    assert "robomaker: interrupted" in err
    assert "Traceback" not in err
    assert not limits(stored)


def final_state(client: Any, run: Any) -> Any:
    """The state a flow run ended with; nothing before."""
    state = client.read_flow_run(run).state
    return state if state.is_final() else None


@pytest.mark.deep
def test_cancelling_a_flow_run_ends_its_batch(
    service: Service, order: Order, environ: dict[str, str], tmp_path: Path
) -> None:
    from prefect.client.orchestration import get_client
    from prefect.states import Cancelling

    batch = call("StartSimulationJobBatch", batch_of(*[order(LONG) for _ in range(3)], at_once=2), service)
    log = tmp_path / "worker.log"
    with get_client(sync_client=True) as client, process_worker(f"pool-{tmp_path.name}", environ, log):
        run = deploy(client, f"pool-{tmp_path.name}", batch["arn"])
        running(service, 2)
        client.set_flow_run_state(run, Cancelling())
        end = wait_for(lambda: final_state(client, run), "the end of the flow run")

    assert end.type.value == "CANCELLED", log.read_text()
    assert not working_below(service.settings.home)
    described = call("DescribeSimulationJobBatch", {"batch": batch["arn"]}, service)
    assert described["status"] == "Canceled"
    assert [job["status"] for job in described["createdRequests"]] == ["Canceled", "Canceled"]
    assert service.catalog.get(batch["arn"]).status == "Canceled"


def deploy(client: Any, pool: str, arn: str) -> Any:
    """Has a worker perform a batch; returns the flow run's id."""
    from prefect_robomaker.flows.lookup import find_perform_flow

    flow = client.create_flow(find_perform_flow("StartSimulationJobBatch"))
    wait_for(lambda: has_pool(client, pool), "the worker's pool")
    deployment = client.create_deployment(
        flow_id=flow,
        name=pool,
        work_pool_name=pool,
        entrypoint="prefect_robomaker.flows.operations:PerformSimulationJobBatch",
        pull_steps=[],
    )
    return client.create_flow_run_from_deployment(deployment, parameters={"arn": arn}).id


def has_pool(client: Any, name: str) -> bool:
    return name in {pool.name for pool in client.read_work_pools()}


def limits(batch: Resource) -> list[str]:
    """Concurrency limits of a batch that the server still has."""
    from prefect.client.orchestration import get_client

    with get_client(sync_client=True) as client:
        found = client.read_global_concurrency_limits(limit=100, offset=0)
    return [limit.name for limit in found if batch.id in limit.name]


@pytest.mark.endurance  # test_dead_nights.py kills in the middle of a batch, and sees what is done twice, too
def test_a_killed_worker_batch_is_carried_on(service: Service, order: Order, environ: dict[str, str]) -> None:
    requests = [order({"DURATION_S": duration}) for duration in ("0.1", "2.5", "0.1")]
    batch = call("StartSimulationJobBatch", batch_of(*requests, at_once=1), service)

    with started([sys.executable, "-c", PERFORM, batch["arn"]], environ, stderr=subprocess.PIPE) as worker:
        wait_for(lambda: [job.status for job in jobs(service)] == ["Completed", "Running"], "the second job")
        simulations = running(service, 1)
        worker.kill()
        wait_for(lambda: not simulations & working_below(service.settings.home), "the simulation's death")
    before = jobs(service)
    assert [job.status for job in before] == ["Completed", "Running"]

    ended = registry()["StartSimulationJobBatch"].perform(batch["arn"], service)

    assert ended["status"] == "Completed"
    after = jobs(service)
    assert [job.status for job in after] == ["Completed"] * 3
    assert [job.arn for job in after[:2]] == [job.arn for job in before]
    assert after[0] == before[0]
    assert after[1].document["runId"] != before[1].document["runId"]
    assert not limits(service.catalog.get(batch["arn"]))


@pytest.mark.deep
def test_a_cancelled_generation_job_stops_soon_and_keeps_its_worlds(
    service: Service, template: str, prefect_server: str
) -> None:
    count = {"floorplanCount": 20, "interiorCountPerFloorplan": 1}
    job = call("CreateWorldGenerationJob", {"template": template, "worldCount": count, "seed": 7}, service)

    def cancel_after_the_first(progress: Progress) -> None:
        service.catalog.request_cancel(job["arn"])

    ended = registry()["CreateWorldGenerationJob"].perform(job["arn"], service.watched_by(cancel_after_the_first))

    assert ended["status"] == "Canceled"
    summary = ended["finishedWorldsSummary"]
    assert 1 <= summary["finishedCount"] == len(summary["succeededWorlds"]) <= 4
    assert summary["failureSummary"]["totalFailureCount"] == 0
    for world in summary["succeededWorlds"]:
        assert call("DescribeWorld", {"world": world}, service)["generationJob"] == job["arn"]
