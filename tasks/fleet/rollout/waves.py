"""The waves of a rollout: its robots in groups whose turn comes one after the other."""

from math import ceil

from ....schemas.rollouts.plan import RolloutPlan

_MOST_WAVES = 100  # each is a task run


def waves_of(plan: RolloutPlan) -> list[tuple[str, ...]]:
    """The robots that can get the application, in groups.

    A group is as large as the number of robots that may have orders at the same time. The next group's first robots get
    theirs as soon as some of the group have ended; but those behind the canaries wait until all canaries have.

    Args:
        plan: the rollout's plan.

    Returns:
        Their ARNs; the canaries' groups come first.
    """
    fit = [robot.arn for robot in plan.robots if robot.unfit_code is None]
    canaries = [arn for arn in plan.canaries if arn in frozenset(fit)]
    others = [arn for arn in fit if arn not in frozenset(plan.canaries)]
    size = max(plan.concurrency, ceil(len(fit) / (_MOST_WAVES - 1)))
    return [*_groups(canaries, size), *_groups(others, size)]


def _groups(robots: list[str], size: int) -> list[tuple[str, ...]]:
    return [tuple(robots[start : start + size]) for start in range(0, len(robots), size)]
