"""State transitions of one robot's deployment, and estimates of its remaining download time; pure functions."""

import math
from typing import Any

from ....schemas.fleet.operations.deployment_jobs import DeploymentJobErrorCode
from ....schemas.fleet.rollouts.rollout import Canceled, CancelRefused, Failed, Fetched, Progressed, Report, Succeeded
from ....schemas.fleet.rollouts.rollout import RobotDeploymentState as State
from ....schemas.wire.common import shorten

_DOWNLOAD = "DownloadingExtracting"


def with_progress(state: State, event: Progressed, now_s: float) -> State:
    """Returns a robot's rollout state after a progress report.

    The speed of a download that begins, or begins again after a loss of power, is measured from that report on.
    """
    step = event.step or state.step
    times = state.step_times
    if step is not None and step not in times:
        times = {**times, step: round(now_s, 1)}
    if step != _DOWNLOAD or event.percent_done is None:
        return state.model_copy(update={"step": step, "step_times": times})
    news = {"step": step, "step_times": times, "percent_done": event.percent_done, "percent_at_s": now_s}
    if state.percent_done is None or state.step != _DOWNLOAD or event.percent_done < state.percent_done:
        news |= {"download_from_percent": event.percent_done, "download_from_s": now_s}
    return state.model_copy(update=news)


def remaining_s(state: State, now_s: float) -> int | None:
    """Estimates how long a robot's download will still take, in whole seconds.

    The speed is that between its first and its last report; since the last report, the time left runs down.

    Args:
        state: the robot.
        now_s: the time.

    Returns:
        The time left; nothing while no speed is known, and in other steps.
    """
    done, at_s = state.percent_done, state.percent_at_s
    from_percent, from_s = state.download_from_percent, state.download_from_s
    if state.step != _DOWNLOAD or done is None or at_s is None or from_percent is None or from_s is None:
        return None
    gained, took_s = done - from_percent, at_s - from_s
    if gained <= 0 or took_s <= 0:
        return None
    left_s = took_s * (100 - done) / gained - max(0.0, now_s - at_s)
    return max(0, math.ceil(left_s))


_CLOSING = Succeeded | Failed | Canceled


def changed(state: State, **members: Any) -> State:
    """Returns a copy of a robot's rollout state with some members changed."""
    return state.model_copy(update=members)


def offered(state: State, action_id: int, now_s: float, timeout_s: float) -> State:
    """Returns a robot's rollout state with a new order, which it has to fetch in time."""
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
    """Returns a robot's rollout state with its unfetched order held back; its time limit stops."""
    if state.order != "offered" or state.deadline_s is None:
        return state
    return changed(state, deadline_s=None, left_s=max(0.0, state.deadline_s - now_s))


def let_go(state: State, now_s: float) -> State:
    """Returns a robot's rollout state with its held-back order open again, for the time that was left."""
    return state if state.left_s is None else changed(state, deadline_s=now_s + state.left_s, left_s=None)


def reported(state: State, event: Report, now_s: float, timeout_s: float) -> State:
    """Returns a robot's rollout state after a report; the same object if nothing changes.

    Args:
        state: the robot before it.
        event: the report, about its latest order or that of an earlier rollout.
        now_s: time of the event, in seconds since the epoch.
        timeout_s: time limit for the installation after the robot fetched its order, in seconds.
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
            return _failed(_closed(state, now_s), event.code, reason, now_s)
        case Canceled():
            return _canceled(state, now_s)
        case CancelRefused():
            return _refused(state, now_s, timeout_s)


def timed_out(state: State, timeout_s: float) -> State:
    """Returns a robot's rollout state after its order timed out: it failed, and the order is cancelled."""
    at_s = state.deadline_s or 0.0
    if state.started_s is None:
        code: DeploymentJobErrorCode = "RobotDeploymentNoResponse"
        reason = f"the robot did not fetch its order within {timeout_s:g} s"
    else:
        code = "RobotAgentConnectionTimeout"
        silent_s = at_s - (state.heard_s or state.started_s)
        step = f", while {state.step}" if state.step else ""
        reason = (
            f"the robot did not end within {timeout_s:g} s of fetching its order; "
            f"it was last heard of {silent_s:g} s earlier{step}"
        )
    return _failed(withdrawn(state), code, reason, at_s)


def revoked(state: State, now_s: float, code: DeploymentJobErrorCode, reason: str) -> State:
    """Returns a robot's rollout state after its order was cancelled: failed if it had begun, else waiting."""
    begun = state.started_s is not None and not state.has_ended
    return _failed(withdrawn(state), code, reason, now_s) if begun else withdrawn(state)


def withdrawn(state: State) -> State:
    """Returns a robot's rollout state after its order was cancelled without counting as a failure."""
    return changed(state, order="canceling", deadline_s=None, left_s=None)


def _failed(state: State, code: DeploymentJobErrorCode, reason: str | None, now_s: float) -> State:
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
        return _failed(state, "RobotDeploymentAborted", "the deployment was stopped while the robot began", now_s)
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
        return _failed(_closed(state, now_s), "RobotDeploymentAborted", reason, now_s)
    return changed(state, order="closed", returned=state.no_response)


def _refused(state: State, now_s: float, timeout_s: float) -> State:
    return changed(_begun(state, now_s, timeout_s), order="refused") if state.order == "canceling" else state


def _closed(state: State, now_s: float) -> State:
    started_s = now_s if state.started_s is None else state.started_s
    return changed(state, order="closed", deadline_s=None, left_s=None, started_s=started_s, heard_s=now_s)
