"""Progress of a robot's download: from its reports, and how long the rest will take; pure functions."""

import math

from ....schemas.fleet.rollouts.rollout import Progressed
from ....schemas.fleet.rollouts.rollout import RobotDeploymentState as State

_DOWNLOAD = "DownloadingExtracting"


def with_progress(state: State, event: Progressed, now_s: float) -> State:
    """Returns a robot's state in a deployment after its report of progress: step and downloaded share.

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
        state: The robot.
        now_s: The time.

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
