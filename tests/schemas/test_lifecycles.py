"""The lives of jobs and batches."""

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from prefect_robomaker.schemas.lifecycles import ACTIVE, LIFECYCLES, batch_outcome, is_terminal
from prefect_robomaker.schemas.state_machines import Lifecycle, next_state
from prefect_robomaker.schemas.wire.errors import StateConflictError

NEVER_REACHED = {"simulation-job": {"Terminated"}}

machines = pytest.mark.parametrize("kind", LIFECYCLES)


def reachable(machine: Lifecycle[Any], start: str) -> set[str]:
    found, waiting = {start}, [start]
    while waiting:
        state = waiting.pop()
        after = {end for (begin, _), end in machine.transitions.items() if begin == state} - found
        found |= after
        waiting += after
    return found


@machines
def test_every_state_is_reached(kind: str) -> None:
    machine = LIFECYCLES[kind]

    assert reachable(machine, machine.initial) == set(machine.states) - NEVER_REACHED.get(kind, set())


@machines
def test_terminal_states_are_exactly_those_without_a_way_out(kind: str) -> None:
    machine = LIFECYCLES[kind]
    left = {state for state, _ in machine.transitions}

    assert machine.terminal == set(machine.states) - left


@machines
def test_every_state_leads_to_an_end(kind: str) -> None:
    machine = LIFECYCLES[kind]

    assert all(reachable(machine, state) & machine.terminal for state in machine.states)


@given(st.data())
def test_no_sequence_of_events_leaves_an_end_or_the_table(data: st.DataObject) -> None:
    kind = data.draw(st.sampled_from(sorted(LIFECYCLES)))
    machine = LIFECYCLES[kind]
    state: str = machine.initial
    for event in data.draw(st.lists(st.sampled_from(sorted(machine.events)), max_size=20)):
        if (state, event) in machine.transitions:
            assert not is_terminal(kind, state)
            state = next_state(machine, state, event)
            assert state in machine.states
        else:
            with pytest.raises(StateConflictError, match=f"is {state}: '{event}' cannot happen"):
                next_state(machine, state, event)


@pytest.mark.parametrize(
    ("events", "end"),
    [
        ("prepare start terminate complete", "Completed"),
        ("prepare start terminate fail", "Failed"),
        ("prepare start crash terminate cancel", "Canceled"),
        ("prepare fail", "Failed"),
        ("terminate cancel", "Canceled"),
        ("prepare start prepare start terminate complete", "Completed"),
        ("prepare start restart prepare start finish complete", "Completed"),
        ("prepare start restart terminate cancel", "Canceled"),
    ],
)
def test_published_lives_of_a_simulation_job(events: str, end: str) -> None:
    machine = LIFECYCLES["simulation-job"]
    state: str = machine.initial
    for event in events.split():
        state = next_state(machine, state, event)

    assert state == end


def test_no_run_finishes_past_a_restart() -> None:
    with pytest.raises(StateConflictError, match="is Restarting: 'finish' cannot happen"):
        next_state(LIFECYCLES["simulation-job"], "Restarting", "finish")


def test_a_conflict_says_what_is_possible() -> None:
    machine = LIFECYCLES["world-export-job"]

    with pytest.raises(StateConflictError, match=r"the world export job is Canceling: .* possible are canceled"):
        next_state(machine, "Canceling", "complete")
    with pytest.raises(StateConflictError, match="nothing is possible any more"):
        next_state(machine, "Completed", "start")


def test_active_states_are_the_services() -> None:
    assert {"Pending", "Preparing", "Running", "Restarting", "RunningFailed", "Terminating"} == ACTIVE


@pytest.mark.parametrize(
    ("pending", "failed", "created", "flags", "status"),
    [
        (3, [], [], {}, "Pending"),
        (2, [], ["Pending"], {}, "InProgress"),
        (2, ["InvalidInput"], [], {}, "InProgress"),
        (0, [], ["Completed", "Terminating"], {}, "Completing"),
        (0, [], ["Completed", "Canceled"], {}, "Completed"),
        (0, ["InvalidInput", "ResourceNotFound"], ["Failed"], {}, "Completed"),
        (0, ["InvalidInput"], [], {}, "Completed"),
        (0, ["InternalServiceError"], ["Completed"], {}, "Failed"),
        (0, ["InternalServiceError"], ["Running"], {}, "Completing"),
        (0, ["BatchTimedOut"], ["Terminating"], {"timed_out": True}, "TimingOut"),
        (0, ["BatchTimedOut"], ["Canceled"], {"timed_out": True}, "TimedOut"),
        (0, ["BatchTimedOut", "InternalServiceError"], ["Canceled"], {"timed_out": True}, "Failed"),
        (1, [], ["Running"], {"canceled": True}, "Canceling"),
        (0, ["BatchCanceled"], ["Canceled"], {"canceled": True}, "Canceled"),
        (0, ["InternalServiceError"], [], {"canceled": True, "timed_out": True}, "Canceled"),
    ],
)
def test_how_a_batch_ends(
    pending: int, failed: list[str], created: list[str], flags: dict[str, bool], status: str
) -> None:
    assert batch_outcome(pending, failed, created, **flags) == status


@given(
    st.integers(0, 3),
    st.lists(st.sampled_from(["InvalidInput", "InternalServiceError", "BatchTimedOut"]), max_size=3),
    st.lists(st.sampled_from(LIFECYCLES["simulation-job"].states), max_size=3),
    st.booleans(),
    st.booleans(),
)
def test_a_batch_with_an_active_job_has_not_ended(
    pending: int, failed: list[str], created: list[str], timed_out: bool, canceled: bool
) -> None:
    status = batch_outcome(pending, failed, created, timed_out=timed_out, canceled=canceled)

    if set(created) & ACTIVE:
        assert not is_terminal("simulation-job-batch", status)
