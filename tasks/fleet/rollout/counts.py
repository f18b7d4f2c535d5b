"""How many robots of a rollout stand how, and which wave it is at."""

from collections import Counter
from collections.abc import Sequence

from ....schemas.rollouts.robots import RobotDeploymentState
from ....schemas.rollouts.rollout import Rollout


def counts_of(rollout: Rollout) -> Counter[str]:
    """How many robots have succeeded, failed, were canceled, are deploying, or wait."""
    return Counter(_word(state) for state in rollout.robots.values())


def current_wave(rollout: Rollout, waves: Sequence[Sequence[str]]) -> int:
    """The number, from 1, of the first wave that has robots which have not ended; of the last if there is none."""
    for number, robots in enumerate(waves, 1):
        if not all(rollout.robots[robot].has_ended for robot in robots):
            return number
    return len(waves)


def _word(state: RobotDeploymentState) -> str:
    if state.has_ended:
        return state.outcome or "canceled"
    return "deploying" if state.is_open else "waiting"
