"""Runs whose Prefect server dies or falls silent: they say so at once, go on, and end with their report."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from helpers.prefect_server import provide_tables
from helpers.processes import started, wait_for, working_below
from helpers.tcp_proxy import TcpProxy

from prefect_robomaker.deployments.prefect_server.local_server import ensure_server, stop_server
from prefect_robomaker.deployments.prefect_server.outage import DEAD_PATIENCE_S
from prefect_robomaker.deployments.prefect_server.secret import auth_string, server_folder
from prefect_robomaker.schemas.reports.run_record import RunRecord
from prefect_robomaker.schemas.settings import Settings
from prefect_robomaker.tasks.service.service import Service

pytestmark = pytest.mark.deep
Order = Callable[..., dict[str, Any]]
ROBOMAKER = [sys.executable, "-m", "prefect_robomaker.deployments.cli.main"]
PIPES = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}


def run_without(
    lose: Callable[[], None], url: str, service: Service, spec: Callable[..., Path], order: Order, limit_s: float
) -> tuple[RunRecord, str, str]:
    """Runs a batch whose server is lost while its simulations run; returns the record and what was said."""
    batch = {
        "createSimulationJobRequests": [order({"DURATION_S": "8"}) for _ in range(3)],
        "batchPolicy": {"maxConcurrency": 2},
    }
    path = spec({"drive": {"operation": "StartSimulationJobBatch", "input": batch}})
    environ = {"PREFECT_API_URL": url, "ROBOMAKER_HOME": str(service.settings.home), "CI": "true"}
    with started([*ROBOMAKER, "run", str(path), "-o", "json"], environ, **PIPES) as robomaker:
        wait_for(lambda: len(working_below(service.settings.home / "jobs")) >= 2, "the simulations")
        lose()
        out, err = robomaker.communicate(timeout=limit_s)
    assert robomaker.returncode == 0, err
    assert "Traceback" not in err
    assert "Error logging" not in err
    return RunRecord.model_validate_json(out), err, f"the Prefect server at {url}"


@pytest.mark.endurance
def test_a_killed_server_is_waited_for_once_and_the_run_ends_with_its_report(
    service: Service, order: Order, spec: Callable[..., Path], cable: TcpProxy
) -> None:
    # Before there was one place that waits, this took six minutes.
    url = f"http://127.0.0.1:{cable.port}/api"
    record, err, server = run_without(cable.close, url, service, spec, order, limit_s=200)

    assert record.state == "succeeded"
    assert [job.status for job in record.jobs] == ["Completed"] * 3
    assert record.report_path is not None
    assert record.report_path.is_file()
    assert err.count(f"{server} does not answer: it does not run") == 1
    assert err.count(f"{server} is not waited for any longer") == 1
    said, ended = err.index("does not answer"), err.index("3 no verdict of 3")
    assert said < ended, "it is said at once, not at the end"


def test_a_silent_server_is_waited_for_once_and_the_run_ends_with_its_report(
    service: Service, order: Order, spec: Callable[..., Path], cable: TcpProxy
) -> None:
    url = f"http://127.0.0.1:{cable.port}/api"
    record, err, server = run_without(cable.silence, url, service, spec, order, limit_s=280)

    assert record.state == "succeeded"
    assert record.report_path is not None
    assert err.count(f"{server} does not answer: it is silent") == 1
    assert "90 s at most in all" in err
    assert err.count(f"{server} is not waited for any longer") == 1


def batch_of(order: Order, duration_s: float) -> dict[str, Any]:
    """The steps of a specification with a batch of three jobs, two at a time."""
    requests = [order({"DURATION_S": str(duration_s)}) for _ in range(3)]
    members = {"createSimulationJobRequests": requests, "batchPolicy": {"maxConcurrency": 2}}
    return {"drive": {"operation": "StartSimulationJobBatch", "input": members}}


def shown_by(variables: dict[str, str]) -> tuple[dict[str, str], list[str], list[str]]:
    """States of flow runs by the names of their flows, names of open task runs, and concurrency limits of batches."""
    from prefect.client.orchestration import SyncPrefectClient

    with SyncPrefectClient(
        variables["PREFECT_API_URL"], auth_string=variables.get("PREFECT_API_AUTH_STRING")
    ) as client:
        flows = {run.flow_id: client.read_flow(run.flow_id).name for run in client.read_flow_runs()}
        states = {str(flows[run.flow_id]): (run.state and run.state.name) or "" for run in client.read_flow_runs()}
        tasks = [task.name for task in client.read_task_runs() if not task.state or not task.state.is_final()]
        limits = client.read_global_concurrency_limits(limit=10, offset=0)
    return states, tasks, [limit.name for limit in limits]


ENDED_WELL = ({"RunPipeline": "Completed", "PerformSimulationJobBatch": "Completed"}, [], [])


def test_a_server_of_others_on_this_machine_that_is_away_for_a_while_shows_the_run_as_it_ended(
    service: Service, order: Order, spec: Callable[..., Path], own_server: Any, tmp_path: Path
) -> None:
    """Whoever keeps it, such as systemd or a container engine, starts it again."""
    variables, pid = own_server
    environ = {**variables, "ROBOMAKER_HOME": str(service.settings.home), "CI": "true"}
    with started([*ROBOMAKER, "run", str(spec(batch_of(order, 8)))], environ, **PIPES) as robomaker:
        wait_for(lambda: len(working_below(service.settings.home / "jobs")) >= 2, "the simulations")
        os.killpg(pid, signal.SIGKILL)
        batch = lambda: service.catalog.list("simulation-job-batch").resources[0]  # noqa: E731
        wait_for(lambda: batch().status == "Completed", "the end of the batch")
        time.sleep(2 * DEAD_PATIENCE_S)
        assert robomaker.poll() is None, "it waits, so that its end is shown"
        ensure_server(Settings.from_environment({"ROBOMAKER_HOME": str(tmp_path / "server")}), {})
        _, err = robomaker.communicate(timeout=200)

    assert robomaker.returncode == 0, err
    wait_for(lambda: shown_by(variables) == ENDED_WELL, "the states as they are")


def test_a_run_that_ended_while_its_homes_server_was_away_is_shown_as_it_ended_once_that_is_back(
    service: Service, order: Order, spec: Callable[..., Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("PREFECT_API_URL", "PREFECT_API_AUTH_STRING"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("PREFECT_PROFILES_PATH", os.devnull)
    provide_tables(server_folder(service.settings))
    url = ensure_server(service.settings, {})
    variables = {"PREFECT_API_URL": url, "PREFECT_API_AUTH_STRING": auth_string(service.settings)}
    try:
        environ = {"ROBOMAKER_HOME": str(service.settings.home), "CI": "true"}
        with started([*ROBOMAKER, "run", str(spec(batch_of(order, 8)))], environ, **PIPES) as robomaker:
            wait_for(lambda: len(working_below(service.settings.home / "jobs")) >= 2, "the simulations")
            stop_server(service.settings)
            _, err = robomaker.communicate(timeout=200)
        assert robomaker.returncode == 0, err

        assert ensure_server(service.settings, {}) == url
        wait_for(lambda: shown_by(variables) == ENDED_WELL, "the states as they are")
    finally:
        stop_server(service.settings)
