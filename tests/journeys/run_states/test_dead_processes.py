"""Flow runs and task runs of processes that were killed: closed in Prefect within a minute."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from helpers.endpoint_process import Serve
from helpers.processes import started, wait_for, working_below
from prefect.events.schemas.automations import EventTrigger

from prefect_robomaker.tasks.execution.dead_flow_runs import AUTOMATION, UNHEARD_S, ensure_automation
from prefect_robomaker.tasks.operations.registry import call
from prefect_robomaker.tasks.service.service import Service

pytestmark = pytest.mark.deep
Order = Callable[..., dict[str, Any]]
ROBOMAKER = [sys.executable, "-m", "prefect_robomaker.deployments.cli.main"]
LONG = {"DURATION_S": "300"}
WITHIN_S = 60.0
SLOW_MACHINE_S = 180.0
"""Tests run beside others, on machines that are busy."""


def open_task_runs(flow_run: Any) -> list[str]:
    """Names of task runs that Prefect shows as running."""
    from prefect.client.orchestration import get_client
    from prefect.client.schemas.filters import FlowRunFilter, FlowRunFilterId

    with get_client(sync_client=True) as client:
        tasks = client.read_task_runs(flow_run_filter=FlowRunFilter(id=FlowRunFilterId(any_=[flow_run])))
    return [task.name for task in tasks if task.state is None or not task.state.is_final()]


@pytest.fixture
def apart(own_server: Any, monkeypatch: pytest.MonkeyPatch) -> Iterator[dict[str, str]]:
    """Variables of a server of the test's own, which Prefect in this process uses, too: others need the automation."""
    from prefect.settings import PREFECT_API_AUTH_STRING, PREFECT_API_URL, temporary_settings

    variables, _ = own_server
    for name, value in variables.items():
        monkeypatch.setenv(name, value)
    chosen: dict[Any, Any] = {
        PREFECT_API_URL: variables["PREFECT_API_URL"],
        PREFECT_API_AUTH_STRING: variables["PREFECT_API_AUTH_STRING"],
    }
    with temporary_settings(chosen):
        yield variables


@pytest.mark.endurance  # below, one that slept is closed so, and two that were killed
def test_a_killed_run_is_closed_with_its_subflows_and_tasks(
    service: Service, order: Order, environ: dict[str, str], spec: Any, flow_run: Any, state_of: Any
) -> None:
    path = spec({"drive": {"operation": "CreateSimulationJob", "input": order(LONG)}})
    with started([*ROBOMAKER, "run", str(path)], environ, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as robomaker:
        wait_for(lambda: working_below(service.settings.home), "the simulation")
        (job,) = service.catalog.list("simulation-job").resources
        outer, inner = flow_run(str(path)).id, flow_run(job.id).id
        wait_for(lambda: open_task_runs(inner), "an open task run")
        time.sleep(2)
        robomaker.kill()
    killed_at = time.monotonic()

    seen = state_of(outer, WITHIN_S + SLOW_MACHINE_S)
    assert (seen.type.value, seen.message.partition(":")[0]) == ("CRASHED", "gave no sign of life for 30 s")
    assert state_of(inner, WITHIN_S + SLOW_MACHINE_S).type.value == "CRASHED"
    wait_for(
        lambda: not open_task_runs(outer) + open_task_runs(inner),
        "the ends of the task runs",
        WITHIN_S + SLOW_MACHINE_S,
    )
    print(f"closed after {time.monotonic() - killed_at:.0f} s, load {os.getloadavg()[0]:.1f}")


def test_the_automation_is_made_once_and_a_killed_run_that_it_missed_is_closed_all_the_same(
    service: Service, order: Order, environ: dict[str, str], spec: Any, flow_run: Any, state_of: Any, apart: Any
) -> None:
    automation_is_made_once()
    without_automation()
    path = spec({"drive": {"operation": "CreateSimulationJob", "input": order(LONG)}})
    with started([*ROBOMAKER, "run", str(path)], {**environ, **apart}, stderr=subprocess.PIPE) as robomaker:
        wait_for(lambda: working_below(service.settings.home), "the simulation")
        outer = flow_run(str(path)).id
        robomaker.kill()

    seen = state_of(outer, UNHEARD_S + WITHIN_S + SLOW_MACHINE_S)
    assert (seen.type.value, seen.message.partition(":")[0]) == ("CRASHED", "gave no sign of life for 30 s")


def automation_is_made_once() -> None:
    from prefect.client.orchestration import get_client

    with get_client(sync_client=True) as client:
        # The server has made it when it started.
        wait_for(lambda: client.read_automations_by_name(AUTOMATION), "the automation")
        first = ensure_automation(client)
        assert ensure_automation(client) == first
        client.delete_automation(first)
        for _ in range(2):  # of an earlier release, and of two servers that started together
            client.create_automation(_of_an_earlier_release())
        ensure_automation(client)
        (found,) = client.read_automations_by_name(AUTOMATION)
    assert isinstance(found.trigger, EventTrigger)
    assert found.trigger.within.total_seconds() == 30.0


def _of_an_earlier_release() -> Any:
    from datetime import timedelta

    from prefect.events.actions import DoNothing
    from prefect.events.schemas.automations import AutomationCore, Posture

    trigger = EventTrigger(posture=Posture.Proactive, within=timedelta(seconds=99), after={"a"}, expect={"b"})
    return AutomationCore(name=AUTOMATION, trigger=trigger, actions=[DoNothing()])


def without_automation() -> None:
    """Takes the automation from the server."""
    from prefect.client.orchestration import get_client

    with get_client(sync_client=True) as client:
        (automation,) = wait_for(lambda: client.read_automations_by_name(AUTOMATION), "the automation")
        client.delete_automation(automation.id)


def test_a_process_that_slept_takes_its_runs_back_and_goes_on(
    service: Service, order: Order, environ: dict[str, str], spec: Any, flow_run: Any, state_of: Any
) -> None:
    path = spec({"drive": {"operation": "CreateSimulationJob", "input": order({"DURATION_S": "150"})}})
    with started([*ROBOMAKER, "run", str(path)], environ, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as robomaker:
        wait_for(lambda: working_below(service.settings.home), "the simulation")
        (job,) = service.catalog.list("simulation-job").resources
        runs = [flow_run(str(path)).id, flow_run(job.id).id]
        wait_for(lambda: open_task_runs(runs[1]), "an open task run")
        time.sleep(2)
        robomaker.send_signal(signal.SIGSTOP)  # as a machine that is suspended
        outer, inner = (state_of(run, WITHIN_S + SLOW_MACHINE_S) for run in runs)
        assert (outer.name, outer.message.partition(":")[0]) == ("Crashed", "gave no sign of life for 30 s")
        assert inner.name == "Crashed"
        closed = lambda: not open_task_runs(runs[0]) + open_task_runs(runs[1])  # noqa: E731
        wait_for(closed, "the ends of the task runs", WITHIN_S + SLOW_MACHINE_S)
        robomaker.send_signal(signal.SIGCONT)
        wait_for(lambda: [name_of(run) for run in runs] == ["Running", "Running"], "the runs that are taken back", 120)
        _, err = robomaker.communicate(timeout=240)

    assert robomaker.returncode == 0, err
    assert service.catalog.get(job.arn).status == "Completed"
    assert [state_of(run).name for run in runs] == ["Completed", "Completed"]
    wait_for(lambda: not open_task_runs(runs[1]), "the ends of the task runs", WITHIN_S + SLOW_MACHINE_S)


def name_of(run: Any) -> str | None:
    """The name of a flow run's state."""
    from prefect.client.orchestration import get_client

    with get_client(sync_client=True) as client:
        state = client.read_flow_run(run).state
    return state.name if state else None


@pytest.mark.endurance  # the server's automation, which does not know programs: above, it closes two runs
def test_a_run_of_serve_is_closed_though_no_job_worker_takes_it_up_again(
    service: Service, order: Order, environ: dict[str, str], serve: Serve, flow_run: Any, state_of: Any
) -> None:
    with serve(**environ) as served:
        served.wait_until_ready()
        job = served.call("CreateSimulationJob", order(LONG))["arn"]
        wait_for(lambda: service.catalog.get(job).status == "Running", "the job to run")
        run = flow_run(job.rpartition("/")[2]).id
        time.sleep(2)
        worker = served.worker()["pid"]
        os.kill(served.process.pid, signal.SIGKILL)
        os.kill(worker, signal.SIGKILL)

    assert state_of(run, WITHIN_S + SLOW_MACHINE_S).type.value == "CRASHED"
    wait_for(lambda: not open_task_runs(run), "the ends of the task runs", WITHIN_S + SLOW_MACHINE_S)


@pytest.mark.endurance
def test_a_run_of_serve_can_be_cancelled_in_prefect(
    service: Service, order: Order, environ: dict[str, str], serve: Serve, flow_run: Any, state_of: Any
) -> None:
    with serve(**environ) as served:
        served.wait_until_ready()
        job = served.call("CreateSimulationJob", order(LONG))["arn"]
        wait_for(lambda: service.catalog.get(job).status == "Running", "the job to run")
        run = flow_run(job.rpartition("/")[2]).id
        cancel(run, environ)
        wait_for(lambda: service.catalog.get(job).status == "Canceled", "the end of the job")
        seen = state_of(run)

    assert (seen.type.value, seen.name) == ("CANCELLED", "Cancelled")


def test_a_run_of_the_command_line_can_be_cancelled_in_prefect(
    service: Service, order: Order, environ: dict[str, str], spec: Any, flow_run: Any, state_of: Any
) -> None:
    later = {"operation": "ListWorlds", "needs": ["drive"]}
    path = spec({"drive": {"operation": "CreateSimulationJob", "input": order(LONG)}, "later": later})
    with started([*ROBOMAKER, "run", str(path)], environ, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as robomaker:
        wait_for(lambda: working_below(service.settings.home), "the simulation")
        run = flow_run(str(path)).id
        cancel(run, environ)
        out, err = robomaker.communicate(timeout=200)

    assert robomaker.returncode == 4, err
    assert "states: canceled" in out
    assert state_of(run).type.value == "CANCELLED"


def cancel(run: Any, environ: dict[str, str]) -> None:
    """Cancels a flow run with Prefect's own command."""
    command = [sys.executable, "-m", "prefect", "flow-run", "cancel", str(run)]
    told = subprocess.run(command, env={**os.environ, **environ}, capture_output=True, text=True, timeout=120)
    assert told.returncode == 0, told.stdout + told.stderr


@pytest.mark.endurance  # backends/test_work_pools.py kills a Prefect worker alone, too, and sees orphan and state
def test_a_flow_process_ends_when_its_prefect_worker_was_killed(
    service: Service, order: Order, environ: dict[str, str], tmp_path: Path, state_of: Any
) -> None:
    from prefect.client.orchestration import get_client

    job = call("CreateSimulationJob", order(LONG), service)["arn"]
    pool = f"orphans-{tmp_path.name}"
    command = [sys.executable, "-m", "prefect", "worker", "start", "--pool", pool, "--type", "process"]
    log = tmp_path / "worker.log"
    with (
        log.open("w") as output,
        get_client(sync_client=True) as client,
        started(command, environ, stdout=output, stderr=subprocess.STDOUT) as worker,
    ):
        run = deploy(client, pool, job)
        wait_for(lambda: service.catalog.get(job).status == "Running", "the job to run", 180)
        wait_for(lambda: working_below(service.settings.home), "the simulation")
        worker.kill()
        wait_for(lambda: not working_below(service.settings.home), "the end of the orphan and its simulation", 120)

    seen = state_of(run)
    assert seen.type.value == "CRASHED"
    assert seen.message == (
        f"its Prefect worker has died, so that it ended itself; `robomaker perform {job}` goes on with what it ran"
    )
    assert service.catalog.get(job).status == "Running"
    assert [each.arn for each in service.catalog.unfinished(["simulation-job"])] == [job], "free for others at once"


def deploy(client: Any, pool: str, arn: str) -> Any:
    """Has a worker perform a job; returns the flow run's id."""
    from prefect_robomaker.flows.lookup import find_perform_flow

    flow = client.create_flow(find_perform_flow("CreateSimulationJob"))
    wait_for(lambda: pool in {each.name for each in client.read_work_pools()}, "the worker's pool")
    deployment = client.create_deployment(
        flow_id=flow,
        name=pool,
        work_pool_name=pool,
        entrypoint="prefect_robomaker.flows.operations:PerformSimulationJob",
        pull_steps=[],
    )
    return client.create_flow_run_from_deployment(deployment, parameters={"arn": arn}).id
