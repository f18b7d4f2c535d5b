"""Time-outs of robots, the earliest first; those that came at the same moment in the plan's order."""

import heapq
from collections.abc import Mapping

from ....schemas.rollouts.robots import RobotDeploymentState


class Deadlines:
    """The moments at which open orders time out."""

    def __init__(self, robots: Mapping[str, RobotDeploymentState]) -> None:
        """Reads the deadlines of robots.

        Args:
            robots: how each stands, in the plan's order; read whenever deadlines are asked for.
        """
        self._robots = robots
        self._place = {robot: place for place, robot in enumerate(robots)}
        self._heap: list[tuple[float, int, str]] = []
        for robot, state in robots.items():
            self.add(robot, state)

    def add(self, robot: str, state: RobotDeploymentState) -> None:
        """Takes in the deadline of a robot, if it has one; its earlier ones do not hold any more."""
        if state.deadline_s is not None:
            heapq.heappush(self._heap, (state.deadline_s, self._place[robot], robot))

    def next(self) -> tuple[float, str] | None:
        """The earliest deadline that holds, and whose it is."""
        while self._heap:
            deadline_s, _, robot = self._heap[0]
            if self._robots[robot].deadline_s == deadline_s:
                return deadline_s, robot
            heapq.heappop(self._heap)
        return None
