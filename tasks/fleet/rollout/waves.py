"""The waves of a rollout, and how many of its robots stand how."""

from collections import Counter
from math import ceil

from ....schemas.rollouts.robots import RobotDeploymentState
from ....schemas.rollouts.rollout import Rollout

_MOST_WAVES = 100  # each is a task run in Prefect


def waves_of(rollout: Rollout) -> list[tuple[str, ...]]:
    """The robots that can get the application, in groups whose turn comes one after the other.

    A group is as large as the number of robots that may have orders at the same time. The next group's first robots get
    theirs as soon as some of the group have ended.
    """
    plan = rollout.plan
    robots = [robot.arn for robot in plan.robots if robot.unfit_code is None]
    size = max(plan.concurrency, ceil(len(robots) / _MOST_WAVES))
    return [tuple(robots[start : start + size]) for start in range(0, len(robots), size)]


def current_wave(rollout: Rollout, waves: list[tuple[str, ...]]) -> int:
    """The number, from 1, of the first wave that has robots which have not ended; of the last if there is none."""
    for number, robots in enumerate(waves, 1):
        if not all(rollout.robots[robot].has_ended for robot in robots):
            return number
    return len(waves)


def counts_of(rollout: Rollout) -> Counter[str]:
    """How many robots have succeeded, failed, were canceled, are deploying, or wait."""
    return Counter(_word(state) for state in rollout.robots.values())


def _word(state: RobotDeploymentState) -> str:
    if state.has_ended:
        return state.outcome or "canceled"
    return "deploying" if state.is_open else "waiting"
