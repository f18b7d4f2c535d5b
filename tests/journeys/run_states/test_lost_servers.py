"""Runs whose Prefect server dies or falls silent: they say so at once, go on, and end with their report."""

import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from helpers.processes import started, wait_for, working_below

from prefect_robomaker.schemas.reports.run_record import RunRecord
from prefect_robomaker.tasks.service.service import Service

pytestmark = pytest.mark.deep
Order = Callable[..., dict[str, Any]]
ROBOMAKER = [sys.executable, "-m", "prefect_robomaker.deployments.cli.main"]
PIPES = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}


def run_without(
    number: signal.Signals, service: Service, spec: Callable[..., Path], order: Order, own: Any, limit_s: float
) -> tuple[RunRecord, str, str]:
    """Runs a batch whose server gets a signal while its simulations run; returns the record and what was said."""
    variables, pid = own
    batch = {
        "createSimulationJobRequests": [order({"DURATION_S": "8"}) for _ in range(3)],
        "batchPolicy": {"maxConcurrency": 2},
    }
    path = spec({"drive": {"operation": "StartSimulationJobBatch", "input": batch}})
    environ = {**variables, "ROBOMAKER_HOME": str(service.settings.home), "CI": "true"}
    with started([*ROBOMAKER, "run", str(path), "-o", "json"], environ, **PIPES) as robomaker:
        wait_for(lambda: len(working_below(service.settings.home / "jobs")) >= 2, "the simulations")
        os.killpg(pid, number)
        out, err = robomaker.communicate(timeout=limit_s)
    assert robomaker.returncode == 0, err
    assert "Traceback" not in err
    assert "Error logging" not in err
    return RunRecord.model_validate_json(out), err, f"the Prefect server at {variables['PREFECT_API_URL']}"


@pytest.mark.endurance
def test_a_killed_server_is_waited_for_once_and_the_run_ends_with_its_report(
    service: Service, order: Order, spec: Callable[..., Path], own_server: Any
) -> None:
    # Before there was one place that waits, this took six minutes.
    record, err, server = run_without(signal.SIGKILL, service, spec, order, own_server, limit_s=200)

    assert record.state == "succeeded"
    assert [job.status for job in record.jobs] == ["Completed"] * 3
    assert record.report_path is not None
    assert record.report_path.is_file()
    assert err.count(f"{server} does not answer: it does not run") == 1
    assert err.count(f"{server} is not waited for any longer") == 1
    said, ended = err.index("does not answer"), err.index("3 completed of 3")
    assert said < ended, "it is said at once, not at the end"


def test_a_silent_server_is_waited_for_once_and_the_run_ends_with_its_report(
    service: Service, order: Order, spec: Callable[..., Path], own_server: Any
) -> None:
    try:
        record, err, server = run_without(signal.SIGSTOP, service, spec, order, own_server, limit_s=280)
    finally:
        os.killpg(own_server[1], signal.SIGCONT)

    assert record.state == "succeeded"
    assert record.report_path is not None
    assert err.count(f"{server} does not answer: it is silent") == 1
    assert "90 s at most in all" in err
    assert err.count(f"{server} is not waited for any longer") == 1
