"""Sweeps close what is open in dead runs of this package's flows, and nothing in those of others."""

from datetime import UTC, datetime, timedelta
from typing import Any
from unittest.mock import Mock
from uuid import UUID, uuid4

import pytest
from helpers.processes import wait_for
from prefect import flow, task
from prefect.client.orchestration import SyncPrefectClient, get_client
from prefect.events import emit_event
from prefect.events.filters import EventFilter, EventNameFilter, EventResourceFilter
from prefect.states import Completed, Crashed, Running

from prefect_robomaker.tasks.execution import dead_flow_runs
from prefect_robomaker.tasks.execution.dead_flow_runs import (
    _NO_SIGN,
    HEARTBEAT,
    UNHEARD_S,
    close_unheard,
    closed_as_dead,
    sweep,
    take_back,
    tell_ends,
)


@pytest.fixture
def ours() -> str:
    """Name of a flow that no other test runs on the same server meanwhile."""
    return f"of-this-test-{uuid4().hex[:8]}"


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


def running_run(client: SyncPrefectClient, name: str) -> UUID:
    """Makes a flow run that Prefect shows as running, though no process carries it out."""

    @flow(name=name)
    def begun() -> None:
        """Does nothing."""

    return client.create_flow_run(begun, state=Running()).id


def test_a_run_that_died_before_its_first_sign_of_life_is_closed(prefect_server: str, ours: str) -> None:
    began = datetime.now(UTC)
    with get_client(sync_client=True) as client:
        died, heard, of_others = (running_run(client, name) for name in (ours, ours, "of-others"))
        later = datetime.now(UTC) + timedelta(seconds=100)
        resource = {"prefect.resource.id": f"prefect.flow-run.{heard}"}
        for ago_s in (20, 30):
            emit_event(HEARTBEAT, resource=resource, occurred=later - timedelta(seconds=ago_s))

        def heartbeats() -> int:
            of_it = EventResourceFilter(id=[f"prefect.flow-run.{heard}"])
            asked = EventFilter.model_validate({"event": EventNameFilter(name=[HEARTBEAT]), "resource": of_it})
            asked.occurred.until = later  # type: ignore[assignment]
            return len(client.read_events(asked, limit=50).events)

        wait_for(lambda: heartbeats() == 2, "the signs of life")
        assert close_unheard(client, {ours}, began + timedelta(seconds=20)) == []
        closed: list[UUID] = []

        def is_closed() -> bool:
            closed.extend(close_unheard(client, {ours}, later))
            return died in closed

        wait_for(is_closed, "the end of the run that died")
        assert not {heard, of_others} & set(closed)
        states = [client.read_flow_run(run).state for run in (died, heard, of_others)]
        assert [state.type.value if state else "" for state in states] == ["CRASHED", "RUNNING", "RUNNING"]
        assert closed_as_dead(client, [died]) == [died], "a process that lives takes it back"
        take_back(client, [died])
        again = client.read_flow_run(died).state
        assert again is not None
        soon = again.timestamp + timedelta(seconds=UNHEARD_S - 0.001)
        assert died not in close_unheard(client, {ours}, soon), "its signs of life are on their way"
        assert died in close_unheard(client, {ours}, soon + timedelta(seconds=1))
        for run in (died, heard, of_others):
            client.set_flow_run_state(run, Crashed(), force=True)


def test_silence_says_nothing_where_a_server_keeps_no_events(
    prefect_server: str, ours: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    with get_client(sync_client=True) as client:
        run = running_run(client, ours)
        with monkeypatch.context() as patch:
            patch.setattr(client, "read_events", lambda *args, **kwargs: Mock(events=[]))
            assert close_unheard(client, {ours}, datetime.now(UTC) + timedelta(seconds=100)) == []
        state = client.read_flow_run(run).state
        assert state is not None
        assert state.type.value == "RUNNING"
        client.set_flow_run_state(run, Crashed(), force=True)


def ended_well(_: object) -> Any:
    return Completed(message="passed: 60 of 60 jobs passed")


def type_of(client: SyncPrefectClient, run: UUID) -> str:
    state = client.read_flow_run(run).state
    assert state is not None
    return state.type.value


def test_a_run_that_was_called_dead_and_had_ended_is_shown_as_it_ended_with_what_ran_in_it(
    prefect_server: str, ours: str
) -> None:
    with get_client(sync_client=True) as client:
        outer, dead = running_run(client, ours), running_run(client, ours)
        parent = client.create_task_run(open_task, outer, dynamic_key="0", state=Running()).id
        in_outer = client.create_task_run(open_task, outer, dynamic_key="1", state=Running()).id

        @flow(name=ours)
        def inner() -> None:
            """Does nothing."""

        part = client.create_flow_run(inner, parent_task_run_id=parent, state=Running()).id
        for run in (outer, dead):
            client.set_flow_run_state(run, Crashed(message=_NO_SIGN), force=True)

        def told() -> bool:
            tell_ends(client, {ours}, lambda run: None if run.id == dead else ended_well(run))
            return type_of(client, part) == "COMPLETED"

        wait_for(told, "the end of the part, which settles first")
        assert (type_of(client, outer), type_of(client, dead)) == ("COMPLETED", "CRASHED")
        shown = client.read_flow_run(outer).state
        assert shown is not None
        assert shown.message == "passed: 60 of 60 jobs passed"
        task_state = lambda: client.read_task_run(in_outer).state  # noqa: E731
        wait_for(lambda: (state := task_state()) is not None and state.is_completed(), "the end of the task run")


def test_before_a_run_is_closed_from_silence_those_are_asked_who_know_how_it_ended(
    prefect_server: str, ours: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        dead_flow_runs, "_with_event", lambda _client, runs, event, *_: [] if event == HEARTBEAT else runs
    )
    with get_client(sync_client=True) as client:
        ended, ends_now, died = (running_run(client, ours) for _ in range(3))

        def end_of(run: Any) -> Any:
            if run.id == ends_now:  # between the look at it and its closing
                client.set_flow_run_state(run.id, Completed())
            return ended_well(run) if run.id == ended else None

        closed = close_unheard(client, {ours}, datetime.now(UTC) + timedelta(seconds=100), end_of)
        assert set(closed) >= {died}
        assert [type_of(client, run) for run in (ended, ends_now, died)] == ["COMPLETED", "COMPLETED", "CRASHED"]
