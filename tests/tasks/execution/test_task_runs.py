"""What Prefect shows of a job under way: steps, and that it waits for a person."""

from typing import Any

from prefect import flow
from prefect.artifacts import Artifact
from prefect.client.orchestration import get_client
from prefect.context import FlowRunContext
from prefect.states import Cancelling

from prefect_robomaker.tasks.execution.task_pool import as_task, directly, show_note, shown_as, step_runner


def _state() -> tuple[str, str | None, str | None]:
    """Type, name and message of the running flow's state, as the server has them."""
    context = FlowRunContext.get()
    assert context is not None
    assert context.flow_run is not None
    with get_client(sync_client=True) as client:
        state = client.read_flow_run(context.flow_run.id).state
        assert state is not None
        return state.type.value, state.name, state.message


def test_a_run_that_waits_has_a_state_with_a_name_and_steps_go_on(prefect_server: str) -> None:
    seen: list[tuple[str, str | None, str | None]] = []

    @flow(name="waits")
    def waits() -> int:
        assert step_runner() is as_task
        with shown_as("AwaitingApproval", "robomaker fleet approve x"):
            seen.append(_state())
            answer = step_runner()("approval", lambda: 7)
            show_note("deployment-note", "waits for approval")
        seen.append(_state())
        return answer

    assert waits() == 7
    assert seen[0] == ("RUNNING", "AwaitingApproval", "robomaker fleet approve x")
    assert seen[1][:2] == ("RUNNING", "Running")
    found: Any = Artifact.get("deployment-note")  # typed as if this were a coroutine
    assert found.data == "waits for approval"


def test_a_run_that_is_cancelled_meanwhile_stays_so(prefect_server: str) -> None:
    seen: list[tuple[str, str | None, str | None]] = []

    @flow(name="is-cancelled")
    def is_cancelled() -> None:
        context = FlowRunContext.get()
        assert context is not None
        assert context.flow_run is not None
        with shown_as("AwaitingApproval", "approve"), get_client(sync_client=True) as client:
            client.set_flow_run_state(context.flow_run.id, Cancelling(), force=True)
        seen.append(_state())

    is_cancelled(return_state=True)
    assert seen[0][:2] == ("CANCELLING", "Cancelling")


def test_outside_a_flow_run_nothing_is_shown() -> None:
    assert step_runner() is directly
    with shown_as("AwaitingApproval", "approve"):
        show_note("note", "text")
