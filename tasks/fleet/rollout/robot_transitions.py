"""State transitions of one robot's deployment; pure functions."""

from typing import Any

from ....schemas.fleet.operations.deployment_jobs import DeploymentJobErrorCode
from ....schemas.fleet.rollouts.rollout import Canceled, CancelRefused, Failed, Fetched, Progressed, Report, Succeeded
from ....schemas.fleet.rollouts.rollout import RobotDeploymentState as State
from ....schemas.wire.common import shorten
from .download_progress import with_progress

_CLOSING = Succeeded | Failed | Canceled


def changed(state: State, **members: Any) -> State:
    """Returns a copy of a robot's state in a deployment with some members changed."""
    return state.model_copy(update=members)


def offered(state: State, action_id: int, now_s: float, timeout_s: float) -> State:
    """Returns a robot's state in a deployment with a new order to install, which it has to fetch in time."""
    return changed(
        state,
        order="offered",
        action_id=action_id,
        returned=False,
        offered_s=now_s,
        started_s=None,
        step_times={},
        heard_s=None,
        step=None,
        percent_done=None,
        percent_at_s=None,
        download_from_percent=None,
        download_from_s=None,
        deadline_s=now_s + timeout_s,
        left_s=None,
    )


def held_back(state: State, now_s: float) -> State:
    """Returns a robot's state in a deployment with its unfetched order held back; its time limit stops."""
    if state.order != "offered" or state.deadline_s is None:
        return state
    return changed(state, deadline_s=None, left_s=max(0.0, state.deadline_s - now_s))


def let_go(state: State, now_s: float) -> State:
    """Returns a robot's state with its held-back order open again, for the time that was left to fetch it."""
    return state if state.left_s is None else changed(state, deadline_s=now_s + state.left_s, left_s=None)


def reported(state: State, event: Report, now_s: float, timeout_s: float) -> State:
    """Returns a robot's state in a deployment after a report of it; the same object if nothing changes.

    Args:
        state: The robot before it.
        event: The report, about its latest order or that of an earlier rollout.
        now_s: Time of the event, in seconds since the epoch.
        timeout_s: Time limit for the installation after the robot fetched its order, in seconds.
    """
    if event.action_id == state.earlier_action_id:
        return changed(state, earlier_action_id=None) if isinstance(event, _CLOSING) else state
    if event.action_id != state.action_id or state.order in ("none", "closed"):
        return state
    match event:
        case Fetched():
            return _begun(state, now_s, timeout_s)
        case Progressed():
            return with_progress(_begun(state, now_s, timeout_s), event, now_s)
        case Succeeded():
            return _succeeded(state, now_s)
        case Failed():
            reason = None if event.reason is None else shorten(event.reason)
            return failed(_closed(state, now_s), event.code, reason, now_s)
        case Canceled():
            return _canceled(state, now_s)
        case CancelRefused():
            return _refused(state, now_s, timeout_s)


def revoked(state: State, now_s: float, code: DeploymentJobErrorCode, reason: str) -> State:
    """Returns a robot's state after its order was cancelled: failed if it had begun, else without an outcome."""
    begun = state.started_s is not None and not state.has_ended
    return failed(withdrawn(state), code, reason, now_s) if begun else withdrawn(state)


def withdrawn(state: State) -> State:
    """Returns a robot's state after its order to install was cancelled, which does not count as a failure."""
    return changed(state, order="canceling", deadline_s=None, left_s=None)


def failed(state: State, code: DeploymentJobErrorCode, reason: str | None, now_s: float) -> State:
    """Returns a robot's state after its deployment failed; unchanged if it had left the fleet or was deleted before."""
    if state.gone is not None and state.outcome is None:  # people took it away: no failure of the version
        return state
    return changed(state, outcome="failed", failure_code=code, failure_reason=reason, finished_s=now_s, returned=False)


def _begun(state: State, now_s: float, timeout_s: float) -> State:
    """Returns the state of a robot that has shown that it has its order."""
    if state.started_s is not None:
        return changed(state, heard_s=now_s)
    state = changed(state, started_s=now_s, heard_s=now_s)
    if state.order == "offered":
        return changed(state, order="fetched", deadline_s=now_s + timeout_s, left_s=None)
    if state.outcome is None:  # the order was canceled on its way to the robot
        return failed(state, "RobotDeploymentAborted", "the deployment was stopped while the robot began", now_s)
    return state


def _succeeded(state: State, now_s: float) -> State:
    state = _closed(state, now_s)
    if state.gone is not None and state.outcome is None:
        return state
    return changed(
        state,
        outcome="succeeded",
        step="Finished",
        failure_code=None,
        failure_reason=None,
        finished_s=now_s,
    )


def _canceled(state: State, now_s: float) -> State:
    if state.is_open:
        reason = "the robot gave up its order by itself"
        return failed(_closed(state, now_s), "RobotDeploymentAborted", reason, now_s)
    return changed(state, order="closed", returned=state.no_response)


def _refused(state: State, now_s: float, timeout_s: float) -> State:
    return changed(_begun(state, now_s, timeout_s), order="refused") if state.order == "canceling" else state


def _closed(state: State, now_s: float) -> State:
    started_s = now_s if state.started_s is None else state.started_s
    return changed(state, order="closed", deadline_s=None, left_s=None, started_s=started_s, heard_s=now_s)
