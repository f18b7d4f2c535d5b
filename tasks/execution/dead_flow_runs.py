"""Closes flow runs and task runs in Prefect whose process has died, as Prefect would show them as running for ever.

A flow run without a heartbeat for `SILENCE_S` is set to `Crashed` by an automation on the server; `close_unheard`
closes those that the automation missed, such as one that died before its first heartbeat. Nothing in Prefect closes the
task runs in them: `sweep` does. A process that only slept, or was stopped, sets its runs back to running.

Silence is no proof: a process may have ended while the server was away. So `tell_ends` looks up how runs ended, and
sets that state; `close_unheard` looks it up before it closes one.
"""

import logging
from collections.abc import Callable, Collection, Iterable
from contextlib import nullcontext
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from typing import Any, TypeAlias
from uuid import UUID

import httpx
from prefect.client.orchestration import SyncPrefectClient
from prefect.client.schemas.filters import FlowFilter, FlowRunFilter, FlowRunFilterId, Operator, TaskRunFilter
from prefect.client.schemas.objects import FlowRun, State, StateType
from prefect.events.actions import ChangeFlowRunState
from prefect.events.filters import EventFilter, EventNameFilter, EventOccurredFilter, EventResourceFilter
from prefect.events.schemas.automations import AutomationCore, EventTrigger, Posture
from prefect.events.schemas.events import ResourceSpecification
from prefect.exceptions import ObjectNotFound, PrefectException
from prefect.states import Completed, Crashed, Running

from .prefect_settings import asking_once

EndOf: TypeAlias = Callable[[FlowRun], State[Any] | None]
"""Function that returns the end state of a flow run, as its own process recorded it; `None`: unknown."""

HEARTBEAT = "robomaker.flow-run.heartbeat"
"""Name of the Prefect events that are heartbeats of flow runs."""

AUTOMATION = "robomaker: close dead runs"
"""Name of the Prefect automation that closes dead runs."""

SILENCE_S = 30.0
"""Time without a heartbeat after which a run counts as dead: three of them may be late."""

UNHEARD_S = 90.0
"""Time without a heartbeat after which a run is closed without the automation, which is quicker."""

_SETTLE_S = 5.0
"""Time after the end of a flow run in which delayed events may still close its task runs, in seconds."""

_NO_SIGN = f"gave no sign of life for {SILENCE_S:g} s: its process or machine has died"
_PART_OF_DEAD = "the flow run that it is a part of has died"
_TASK_OF_DEAD = "the flow run that it belongs to has died"
_TASK_OF_ENDED = "its flow run has ended; the server was not told how this task did"
_PART_OF_ENDED = "the flow run that it is a part of has ended; the server was not told how this one did"

_OPEN = [StateType.RUNNING, StateType.PENDING]
_CLOSED = [StateType.CRASHED, StateType.CANCELLED]
_ENDED_BY_ITSELF = [StateType.COMPLETED, StateType.FAILED]
_ENDED = [*_CLOSED, *_ENDED_BY_ITSELF]
_BEGAN = "prefect.flow-run.Running"
_EVENTS_KEPT = timedelta(days=30)
"""Period in which events are searched, longer than servers keep them (a week by default)."""

_EVENTS_PAGE = 50  # the most that the server gives at once
_TOLD_FOR = timedelta(days=1)
"""Time after a run was closed as dead during which its true end is searched for."""

_LATE_S = 300.0
"""Longest delay of task runs' states at a server that is flooded with them, in seconds; 240 s were seen."""

_MAX_FLOW_DEPTH = 4
"""Limit of the depth of nested flows."""

_ENDS = ("Completed", "Failed", "Crashed", "Cancelled", "TimedOut", "Paused", "Suspended")

_logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class Swept:
    """Numbers of the flow runs and task runs that a sweep (cleaning up after dead processes) has closed."""

    flow_runs: int
    task_runs: int


def ensure_automation(client: SyncPrefectClient) -> UUID:
    """Makes sure that one Prefect automation marks flow runs as crashed that send no heartbeats.

    Deletes automations of the same name that have another content, or are there twice; creates one if none is left.

    Returns:
        Id of the automation.
    """
    wanted = _automation()
    found = client.read_automations_by_name(AUTOMATION)
    current = [each.id for each in found if each.trigger == wanted.trigger and each.actions == wanted.actions]
    for each in found:
        if each.id not in current[:1]:  # of another release, or of two servers that started together
            client.delete_automation(each.id)
    return current[0] if current else client.create_automation(wanted)


def has_open_runs(client: SyncPrefectClient, flow_names: Iterable[str], since: datetime) -> bool:
    """Whether a flow run of some flows is running or ended lately; only then there can be dead runs to clean up.

    Args:
        client: The server's client.
        flow_names: Names of the flows that are asked about.
        since: A run that has ended since then counts, too.
    """
    open_states = _with_states([*_OPEN, StateType.CANCELLING])
    chosen = _flow_runs(operator=Operator.or_, state=open_states, end_time={"after_": since})
    return bool(client.read_flow_runs(flow_filter=_flows_named(flow_names), flow_run_filter=chosen, limit=1))


def sweep(client: SyncPrefectClient, flow_names: Iterable[str], now: datetime | None = None) -> Swept:
    """Closes task runs and subflow runs left open by flow runs that died or were cancelled; returns their numbers.

    Args:
        client: The server's client.
        flow_names: Names of the flows whose task runs and subflow runs these are; others on the server are left alone.
        now: The time; absent: the present.
    """
    before = (now or datetime.now(UTC)) - timedelta(seconds=_SETTLE_S)
    ours = _flows_named(flow_names)
    is_open = TaskRunFilter.model_validate({"state": _with_states(_OPEN)})
    flow_runs = task_runs = 0
    for _ in range(_MAX_FLOW_DEPTH):
        tasks = client.read_task_runs(flow_filter=ours, task_run_filter=is_open, flow_run_filter=_dead(before))
        flows = [run.id for run in _parts_of(client, _open_parts(client, ours), _dead(before))]
        for task in tasks:
            client.set_task_run_state(task.id, Crashed(message=_TASK_OF_DEAD), force=True)
        for flow_run in flows:
            # Not by force: one that has come to its end meanwhile stays as it is.
            client.set_flow_run_state(flow_run, Crashed(message=_PART_OF_DEAD))
        flow_runs, task_runs = flow_runs + len(flows), task_runs + len(tasks)
        if not flows:
            break
        before = datetime.now(UTC) + timedelta(seconds=1)  # those that have just been closed are dead, too
    if flow_runs or task_runs:
        _logger.info("closed %d flow runs and %d task runs of dead processes", flow_runs, task_runs)
    return Swept(flow_runs, task_runs)


def tell_ends(client: SyncPrefectClient, flow_names: Iterable[str], end_of: EndOf) -> list[UUID]:
    """Corrects flow runs that were marked crashed in the last day although they had ended: sets their real end state.

    Subflow runs that are still open although their parent run ended are closed, too, after a delay: their own end may
    still be on its way to the server.

    Args:
        client: The server's client.
        flow_names: Names of the flows whose runs are corrected.
        end_of: Knows how flow runs ended.

    Returns:
        The ids of the flow runs whose state was changed.
    """
    now = datetime.now(UTC)
    ours = _flows_named(flow_names)
    crashed = _ended_since(now - _TOLD_FOR, [StateType.CRASHED])
    told: list[UUID] = []
    for run in client.read_flow_runs(flow_filter=ours, flow_run_filter=crashed):
        if (end := end_of(run)) is not None:
            _tell_end(client, run.id, end)
            told.append(run.id)
    open_parts = _open_parts(client, ours)
    settled = now - timedelta(seconds=_SETTLE_S)
    for part in _parts_of(client, open_parts, _ended_since(now - _TOLD_FOR, _ENDED, before=settled)):
        if (end := end_of(part)) is not None:
            _tell_end(client, part.id, end)
            told.append(part.id)
    late = now - timedelta(seconds=_LATE_S)
    unheard = [part for part in open_parts if part.id not in told]
    for part in _parts_of(client, unheard, _ended_since(now - _TOLD_FOR, _ENDED_BY_ITSELF, before=late)):
        client.set_flow_run_state(part.id, Crashed(message=_PART_OF_ENDED))
    is_open = TaskRunFilter.model_validate({"state": _with_states(_OPEN)})
    for end in _ENDED_BY_ITSELF:
        ended = _ended_since(now - _TOLD_FOR, [end], before=late)
        for task in client.read_task_runs(flow_filter=ours, task_run_filter=is_open, flow_run_filter=ended):
            client.set_task_run_state(task.id, _end_of_task(end), force=True)
    if told:
        _logger.info("%d flow runs that were called dead had come to their end, and are shown so", len(told))
    return told


def _tell_end(client: SyncPrefectClient, run: UUID, end: State[Any]) -> None:
    """Sets the state in which a flow run really ended, and closes its task runs that are still open."""
    client.set_flow_run_state(run, end.model_copy(update={"data": None}), force=True)
    unheard = TaskRunFilter.model_validate({"state": _with_states([*_OPEN, StateType.CRASHED])})
    for task in client.read_task_runs(task_run_filter=unheard, flow_run_filter=_flow_runs(id={"any_": [run]})):
        if task.state and (not task.state.is_crashed() or task.state.message == _TASK_OF_DEAD):
            client.set_task_run_state(task.id, _end_of_task(end.type), force=True)


def _end_of_task(flow: StateType) -> State[Any]:
    """Returns the end state for a task run that sent no events: in a flow that completed, each task has returned."""
    ended = Completed if flow is StateType.COMPLETED else Crashed
    return ended(message=_TASK_OF_ENDED)


def was_silent(run: FlowRun) -> bool:
    """Whether a flow run is not marked as crashed, or only because it, or its parent flow run, sent no heartbeats.

    False for a run without a state.
    """
    state = run.state
    return state is not None and (not state.is_crashed() or state.message in (_NO_SIGN, _PART_OF_DEAD))


def close_unheard(
    client: SyncPrefectClient,
    flow_names: Iterable[str],
    now: datetime | None = None,
    end_of: EndOf = lambda _: None,
) -> list[UUID]:
    """Marks flow runs as crashed that have run for `UNHEARD_S` seconds without sending a heartbeat.

    Where a server keeps no events, silence says nothing: only runs are closed of which it knows that they began.

    Args:
        client: Client of a server that has answered for as long: else it may not have heard those that live.
        flow_names: Names of the flows that give signs of life; others on the server are left alone.
        now: The time; absent: the present.
        end_of: Knows how flow runs ended; those of which it does not are closed as dead.

    Returns:
        Ids of the flow runs that were marked as crashed.
    """
    until = now or datetime.now(UTC)
    since = until - timedelta(seconds=UNHEARD_S)
    chosen = _flow_runs(
        state=_with_states([StateType.RUNNING]), start_time={"before_": since}, parent_task_run_id={"is_null_": True}
    )
    ours = _flows_named(flow_names)
    found = client.read_flow_runs(flow_filter=ours, flow_run_filter=chosen)
    # One that was taken back a moment ago runs for long already, and its signs are still on their way.
    runs = [run.id for run in found if run.state and run.state.timestamp < since]
    unheard: list[UUID] = []
    for at in range(0, len(runs), _EVENTS_PAGE):
        page = runs[at : at + _EVENTS_PAGE]
        heard = _with_event(client, page, HEARTBEAT, since, until)
        silent = [run for run in page if run not in heard]
        unheard += _with_event(client, silent, _BEGAN, until - _EVENTS_KEPT, until) if silent else ()
    dead: list[UUID] = []
    for run in (run for run in found if run.id in unheard):
        if (end := end_of(run)) is not None:
            _tell_end(client, run.id, end)
        else:  # not by force: one that has come to its end meanwhile stays as it is
            client.set_flow_run_state(run.id, Crashed(message=_NO_SIGN))
            dead.append(run.id)
    if dead:
        _logger.info("closed %d flow runs that were not heard of for %g s", len(dead), UNHEARD_S)
    return dead


def closed_as_dead(client: SyncPrefectClient, runs: Collection[UUID]) -> list[UUID]:
    """Returns the flow runs that were marked crashed because they sent no heartbeats.

    Args:
        client: The server's client.
        runs: Ids of the flow runs.
    """
    crashed = _flow_runs(id={"any_": list(runs)}, state=_with_states([StateType.CRASHED]))
    found = client.read_flow_runs(flow_run_filter=crashed)
    return [run.id for run in found if run.state and run.state.message in (_NO_SIGN, _PART_OF_DEAD)]


def take_back(client: SyncPrefectClient, runs: Collection[UUID]) -> None:
    """Sets flow runs that were wrongly marked crashed back to `Running`, with their task runs.

    Args:
        client: The server's client.
        runs: Ids of flow runs whose process lives and goes on.
    """
    again = Running(message="its process slept or was stopped, and goes on")
    for run in runs:
        client.set_flow_run_state(run, again, force=True)
    crashed = TaskRunFilter.model_validate({"state": _with_states([StateType.CRASHED])})
    in_runs = _flow_runs(id={"any_": list(runs)})
    for task in client.read_task_runs(task_run_filter=crashed, flow_run_filter=in_runs):
        if task.state and task.state.message == _TASK_OF_DEAD:
            client.set_task_run_state(task.id, again, force=True)


def tell_of_dead(flow_run: str, words: str, client: SyncPrefectClient | None = None) -> bool:
    """Writes into a dead flow run's state which process continues its work; a failure to do so is only logged.

    Args:
        flow_run: Id of the dead flow run.
        words: Text that says which process finishes it, or how a person can.
        client: The server's client; `None`: of the server that Prefect's settings name.

    Returns:
        Whether somebody has cancelled it, so that its work is to end.
    """
    try:
        with asking_once() if client is None else nullcontext(client) as asked:
            state = asked.read_flow_run(UUID(flow_run)).state
            if state is not None and (state.is_cancelled() or state.is_cancelling()):
                return True
            if state is None or not state.is_final() or state.is_crashed():
                asked.set_flow_run_state(UUID(flow_run), Crashed(message=words), force=True)
    except ObjectNotFound:
        _logger.debug("the flow run %s was deleted", flow_run)
    except (httpx.HTTPError, PrefectException, RuntimeError) as error:
        _logger.warning("Prefect is not told what becomes of the flow run %s: %s", flow_run, error)
    return False


def _automation() -> AutomationCore:
    trigger = EventTrigger(
        posture=Posture.Proactive,
        threshold=1,
        within=timedelta(seconds=SILENCE_S),
        match=ResourceSpecification({"prefect.resource.id": "prefect.flow-run.*"}),
        for_each={"prefect.resource.id"},
        after={HEARTBEAT},
        expect={HEARTBEAT, *(f"prefect.flow-run.{end}" for end in _ENDS)},
    )
    action = ChangeFlowRunState(name="Crashed", state=StateType.CRASHED, message=_NO_SIGN, force=False)
    words = "Closes flow runs of RoboMaker operations whose process has died; made by prefect-robomaker."
    return AutomationCore(name=AUTOMATION, description=words, trigger=trigger, actions=[action])


def _with_event(client: SyncPrefectClient, runs: list[UUID], event: str, since: datetime, until: datetime) -> set[UUID]:
    """Finds the flow runs that had an event between two times; at most a page of them."""
    resource_of = {f"prefect.flow-run.{run}": run for run in runs}
    asked = EventFilter(
        occurred=EventOccurredFilter.model_validate({"since": since, "until": until}),
        event=EventNameFilter(name=[event]),
        resource=EventResourceFilter(id=list(resource_of), distinct=True),
    )
    return {resource_of[found.resource.id] for found in client.read_events(asked, limit=_EVENTS_PAGE).events}


def _with_states(states: Collection[StateType]) -> dict[str, Any]:
    """Returns the part of a filter of Prefect runs that selects runs in these types of state."""
    return {"type": {"any_": list(states)}}


def _flows_named(names: Iterable[str]) -> FlowFilter:
    return FlowFilter.model_validate({"name": {"any_": sorted(names)}})


def _flow_runs(**chosen: Any) -> FlowRunFilter:
    return FlowRunFilter.model_validate(chosen)


def _dead(before: datetime) -> FlowRunFilter:
    """Returns a filter for flow runs that crashed or were cancelled before a time."""
    return _flow_runs(state=_with_states(_CLOSED), end_time={"before_": before})


def _ended_since(since: datetime, states: list[StateType], before: datetime | None = None) -> FlowRunFilter:
    return _flow_runs(state=_with_states(states), end_time={"after_": since, "before_": before})


def _open_parts(client: SyncPrefectClient, ours: FlowFilter) -> list[FlowRun]:
    """Reads from the Prefect server the subflow runs of this project's flows that have not ended."""
    chosen = _flow_runs(state=_with_states(_OPEN), parent_task_run_id={"is_null_": False})
    return client.read_flow_runs(flow_filter=ours, flow_run_filter=chosen)


def _parts_of(client: SyncPrefectClient, subflows: Collection[FlowRun], outer: FlowRunFilter) -> list[FlowRun]:
    """Returns those of some subflow runs whose parent flow run a filter chooses, asking the Prefect server."""
    if not subflows:
        return []
    ids = [run.parent_task_run_id for run in subflows if run.parent_task_run_id]
    parents = client.read_task_runs(task_run_filter=TaskRunFilter.model_validate({"id": {"any_": ids}}))
    flow_of = {task.id: task.flow_run_id for task in parents if task.flow_run_id}
    of_them = outer.model_copy(update={"id": FlowRunFilterId(any_=list(set(flow_of.values())))})
    chosen_ones = {run.id for run in client.read_flow_runs(flow_run_filter=of_them)}
    return [run for run in subflows if run.parent_task_run_id and flow_of.get(run.parent_task_run_id) in chosen_ones]
