"""Signals, and servers that die: what commands say then, and what Prefect shows."""

import json
import re
import signal
import socket
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from helpers.processes import started, wait_for, working_below
from helpers.tcp_proxy import TcpProxy

from prefect_robomaker.schemas.reports.run_record import RunRecord
from prefect_robomaker.tasks.operations.registry import call
from prefect_robomaker.tasks.service.service import Service

pytestmark = pytest.mark.deep
Order = Callable[..., dict[str, Any]]
ROBOMAKER = [sys.executable, "-m", "prefect_robomaker.deployments.cli.main"]
LONG = {"DURATION_S": "300"}
PIPES = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
SCRIPT = """
import json, sys
from prefect import flow
from prefect_robomaker import CreateSimulationJob

@flow(name="nightly")
def nightly(request):
    return CreateSimulationJob(**request)

nightly(json.loads(sys.argv[1]))
"""


@pytest.mark.parametrize(
    "number",
    [
        pytest.param(signal.SIGINT, marks=pytest.mark.endurance),
        signal.SIGTERM,
        pytest.param(signal.SIGHUP, marks=pytest.mark.endurance),
    ],
    ids=lambda number: number.name,
)
def test_a_signal_ends_a_run_with_its_summary(
    number: signal.Signals, service: Service, order: Order, environ: Any, spec: Any, flow_run: Any, state_of: Any
) -> None:
    path = spec({"drive": {"operation": "CreateSimulationJob", "input": order(LONG)}})
    with started([*ROBOMAKER, "run", str(path)], environ, **PIPES) as robomaker:
        wait_for(lambda: working_below(service.settings.home), "the simulation")
        robomaker.send_signal(number)
        out, err = robomaker.communicate(timeout=200)

    assert robomaker.returncode == (130 if number == signal.SIGINT else -number), err
    assert "states: canceled" in out
    report = re.search(r"report +(/\S+report\.html)", out)
    assert report, out
    assert Path(report[1]).is_file()
    assert err.strip().endswith("robomaker: interrupted")
    assert "Traceback" not in err
    (job,) = service.catalog.list("simulation-job").resources
    assert job.status == "Canceled"
    assert "outputs" in job.document
    assert not working_below(service.settings.home)
    record = RunRecord.model_validate_json((Path(report[1]).parent / "run.json").read_text())
    assert record.state == "canceled"
    for name in (str(path), job.id):
        seen = state_of(flow_run(name).id)
        assert (seen.type.value, seen.name) == ("CANCELLED", "Cancelled"), name
        assert seen.message == f"interrupted by {number.name}; what it ran was cancelled"


@pytest.mark.parametrize(
    "number",
    [pytest.param(signal.SIGTERM, marks=pytest.mark.endurance), signal.SIGHUP],
    ids=lambda number: number.name,
)
def test_a_signal_ends_a_call_that_waits(
    number: signal.Signals, service: Service, order: Order, environ: Any, flow_run: Any, state_of: Any
) -> None:
    command = [*ROBOMAKER, "call", "CreateSimulationJob", "--wait", "--input", json.dumps(order(LONG))]
    with started(command, environ, **PIPES) as robomaker:
        wait_for(lambda: working_below(service.settings.home), "the simulation")
        robomaker.send_signal(number)
        out, err = robomaker.communicate(timeout=200)

    assert robomaker.returncode == -number, err
    assert json.loads(out)["status"] == "Canceled"
    assert state_of(flow_run(json.loads(out)["arn"].rpartition("/")[2]).id).type.value == "CANCELLED"


def test_sigterm_in_a_flow_of_a_user(
    service: Service, order: Order, environ: Any, tmp_path: Path, state_of: Any, prefect_server: str
) -> None:
    script = tmp_path / "nightly.py"
    script.write_text(SCRIPT)
    with started([sys.executable, str(script), json.dumps(order(LONG))], environ, **PIPES) as nightly:
        wait_for(lambda: working_below(service.settings.home), "the simulation")
        nightly.terminate()
        out, err = nightly.communicate(timeout=200)

    assert nightly.returncode == -signal.SIGTERM, err
    assert "PydanticSerializationError" not in out + err
    (job,) = service.catalog.list("simulation-job").resources
    assert job.status == "Canceled"
    from prefect.client.orchestration import get_client
    from prefect.client.schemas.filters import FlowFilter, FlowFilterName

    with get_client(sync_client=True) as client:
        of_user = FlowFilter(name=FlowFilterName(any_=["nightly"]))
        (outer,) = client.read_flow_runs(flow_filter=of_user)
        of_job = FlowFilter(name=FlowFilterName(any_=["CreateSimulationJob"]))
        subflows = [run for run in client.read_flow_runs(flow_filter=of_job) if run.name == job.id]
    assert state_of(outer.id).name == "Crashed"
    assert state_of(outer.id).message == "Execution was aborted by a termination signal."
    assert {state_of(run.id).name for run in subflows} == {"Cancelled"}


def test_a_server_that_dies_under_a_call_costs_a_clear_message(
    service: Service, order: Order, environ: Any, cable: TcpProxy
) -> None:
    variables = {**environ, "PREFECT_API_URL": f"http://127.0.0.1:{cable.port}/api"}
    command = [*ROBOMAKER, "call", "CreateSimulationJob", "--wait", "--input", json.dumps(order({"DURATION_S": "15"}))]
    with started(command, variables, **PIPES) as robomaker:
        wait_for(lambda: working_below(service.settings.home), "the simulation")
        cable.close()
        out, err = robomaker.communicate(timeout=200)

    # The job itself needs no server to come to its end.
    assert robomaker.returncode == 0, err
    assert json.loads(out)["status"] == "Completed"
    server = f"the Prefect server at {variables['PREFECT_API_URL']}"
    assert err.count(f"{server} does not answer: it does not run, or cannot be reached; what runs goes on") == 1
    assert f"{server} does not answer any more, and will not show how sim-" in err
    assert "Traceback" not in err


def test_a_server_that_dies_before_a_job_runs_costs_a_message_with_the_command_that_goes_on(
    service: Service, order: Order
) -> None:
    from prefect.settings import PREFECT_API_URL, temporary_settings

    from prefect_robomaker.flows.lookup import PrefectServerLostError, perform

    job = call("CreateSimulationJob", order(), service)["arn"]
    with socket.create_server(("127.0.0.1", 0)) as server:
        url = f"http://127.0.0.1:{server.getsockname()[1]}/api"  # of one that has died: nobody listens there any more
    with (
        temporary_settings({PREFECT_API_URL: url}),
        service.activated(),
        pytest.raises(PrefectServerLostError) as error,
    ):
        perform("CreateSimulationJob", job)

    assert str(error.value).endswith(
        f"and {job} is Pending; once it answers again (robomaker server status), go on with: robomaker perform {job}"
    )
