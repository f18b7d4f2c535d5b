"""Waves of a rollout: groups of robots that get their orders one after the other."""

from collections import deque
from collections.abc import Iterator, Mapping
from itertools import islice
from math import ceil

from ....schemas.fleet.rollouts.rollout import RobotDeploymentState
from ....schemas.fleet.rollouts.rollout_plan import RolloutPlan

_MOST_WAVES = 100  # each is a task run


def waves_of(plan: RolloutPlan) -> list[tuple[str, ...]]:
    """Divides the robots of a deployment into waves (groups), which get their orders one after the other.

    A group is as large as the number of robots that may have orders at the same time. The next group's first robots get
    theirs as soon as some of the group have ended; but those behind the canaries wait until all canaries have.

    Args:
        plan: The rollout's plan.

    Returns:
        ARNs of the robots in each wave; the canaries' waves are first.
    """
    fit = [robot.arn for robot in plan.robots if robot.unfit_code is None]
    canaries = [arn for arn in plan.canaries if arn in frozenset(fit)]
    others = [arn for arn in fit if arn not in frozenset(plan.canaries)]
    size = max(plan.concurrency, ceil(len(fit) / (_MOST_WAVES - 1)))
    return [*_groups(canaries, size), *_groups(others, size)]


def _groups(robots: list[str], size: int) -> list[tuple[str, ...]]:
    return [tuple(robots[start : start + size]) for start in range(0, len(robots), size)]


def waits(state: RobotDeploymentState) -> bool:
    """Whether a robot waits for its first order to install in a deployment."""
    return state.order == "none" and not state.has_ended


def waits_again(state: RobotDeploymentState) -> bool:
    """Whether a robot that did not answer before waits for another order."""
    return state.returned and state.gone is None


class Line:
    """Queue of the robots of a deployment that wait for an order to install the application."""

    def __init__(self, plan: RolloutPlan, robots: Mapping[str, RobotDeploymentState]) -> None:
        """Lines up the robots of a rollout.

        Args:
            plan: The rollout's plan.
            robots: State of each robot; read whenever the queue is used.
        """
        self._robots = robots
        self._canaries = deque(arn for arn in plan.canaries if waits(robots[arn]))
        self._in_order = deque(arn for arn in plan.order if waits(robots[arn]))
        self._returned = {arn for arn in plan.order if waits_again(robots[arn])}
        self._place = {robot: place for place, robot in enumerate(plan.order)}

    def update(self, robot: str) -> None:
        """Puts a robot that contacts the server again into the queue, or removes it."""
        if waits_again(self._robots[robot]):
            self._returned.add(robot)
        else:
            self._returned.discard(robot)

    @property
    def has_returns(self) -> bool:
        """Whether robots that contact the server again wait for another order."""
        return bool(self._returned)

    def next(self, count: int, *, first: bool, others: bool) -> tuple[str, ...]:
        """Returns the robots that are next to get an order.

        Args:
            count: Largest number of robots.
            first: Whether robots get their first order.
            others: Whether these may be others than canaries.
        """
        return tuple(islice(self._all(first, others), max(0, count)))

    def _all(self, first: bool, others: bool) -> Iterator[str]:
        if first:
            yield from self._waiting(self._canaries)
            if others:
                yield from self._waiting(self._in_order)
        yield from sorted(self._returned, key=self._place.__getitem__)

    def _waiting(self, queue: deque[str]) -> Iterator[str]:
        while queue and not waits(self._robots[queue[0]]):
            queue.popleft()
        yield from (robot for robot in queue if waits(self._robots[robot]))
