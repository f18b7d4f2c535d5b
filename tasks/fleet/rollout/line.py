"""Sequence of robots in a rollout: canaries, then the others in the plan's order, then robots that were away."""

from collections import deque
from collections.abc import Iterator, Mapping
from itertools import islice

from ....schemas.rollouts.plan import RolloutPlan
from ....schemas.rollouts.robots import RobotDeploymentState


def waits(state: RobotDeploymentState) -> bool:
    """Whether a robot waits for its first order."""
    return state.order == "none" and not state.has_ended


def waits_again(state: RobotDeploymentState) -> bool:
    """Whether a robot that was away waits for another order."""
    return state.returned and state.gone is None


class Line:
    """The robots that wait, in order; robots that do not wait any more drop out when their turn comes."""

    def __init__(self, plan: RolloutPlan, robots: Mapping[str, RobotDeploymentState]) -> None:
        """Lines up the robots of a rollout.

        Args:
            plan: its plan.
            robots: how each stands; read whenever the line is asked.
        """
        self._robots = robots
        self._canaries = deque(arn for arn in plan.canaries if waits(robots[arn]))
        self._in_order = deque(arn for arn in plan.order if waits(robots[arn]))
        self._returned = {arn for arn in plan.order if waits_again(robots[arn])}
        self._place = {robot: place for place, robot in enumerate(plan.order)}

    def update(self, robot: str) -> None:
        """Lines up a robot that was away and is back, or takes it out of the line again."""
        if waits_again(self._robots[robot]):
            self._returned.add(robot)
        else:
            self._returned.discard(robot)

    @property
    def has_returns(self) -> bool:
        """Whether robots that were away wait for another order."""
        return bool(self._returned)

    def next(self, count: int, *, first: bool, others: bool) -> tuple[str, ...]:
        """The robots whose turn it is.

        Args:
            count: how many at most.
            first: whether robots get their first order.
            others: whether these may be others than canaries.
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
