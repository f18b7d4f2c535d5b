"""Sweeps close what is open in dead runs of this package's flows, and nothing in those of others."""

from datetime import UTC, datetime, timedelta
from typing import Any
from uuid import UUID

from helpers.processes import wait_for
from prefect import flow, task
from prefect.client.orchestration import SyncPrefectClient, get_client
from prefect.states import Crashed, Running

from prefect_robomaker.tasks.execution.dead_flow_runs import sweep


@task(name="open")
def open_task() -> None:
    """Does nothing."""


def crashed_run(client: SyncPrefectClient, name: str) -> UUID:
    """Makes a flow run that has crashed; returns the id of a task run that is open in it."""

    @flow(name=name)
    def dead() -> None:
        """Does nothing."""

    run = client.create_flow_run(dead, state=Running())
    task_run = client.create_task_run(open_task, run.id, dynamic_key="0", state=Running())
    client.set_flow_run_state(run.id, Crashed(), force=True)
    return task_run.id


def test_what_others_run_on_the_same_server_is_left_alone(prefect_server: str) -> None:
    with get_client(sync_client=True) as client:

        def state_of(task_run: UUID) -> Any:
            state = client.read_task_run(task_run).state
            assert state is not None
            return state.type.value

        ours, of_others = (crashed_run(client, name) for name in ("PerformSimulationJob", "of-another-team"))
        for _ in range(2):
            sweep(client, {"PerformSimulationJob"}, datetime.now(UTC) + timedelta(seconds=60))

        wait_for(lambda: state_of(ours) == "CRASHED", "the end of our task run")
        assert state_of(of_others) == "RUNNING"
