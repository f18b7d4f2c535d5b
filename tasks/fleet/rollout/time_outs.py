"""Time-outs of robots: the deadlines of their open orders, and how a robot has failed whose order has timed out."""

import heapq
from collections.abc import Mapping

from ....schemas.fleet.operations.deployment_jobs import DeploymentJobErrorCode
from ....schemas.fleet.rollouts.rollout import RobotDeploymentState
from ....schemas.fleet.rollouts.rollout import RobotDeploymentState as State
from .robot_transitions import failed, withdrawn


class Deadlines:
    """Queue of the times at which robots' open orders time out."""

    def __init__(self, robots: Mapping[str, RobotDeploymentState]) -> None:
        """Reads the deadlines of robots.

        Args:
            robots: State of each robot, in the plan's order; read whenever deadlines are needed.
        """
        self._robots = robots
        self._place = {robot: place for place, robot in enumerate(robots)}
        self._heap: list[tuple[float, int, str]] = []
        for robot, state in robots.items():
            self.add(robot, state)

    def add(self, robot: str, state: RobotDeploymentState) -> None:
        """Adds a robot's deadline, if it has one; its earlier deadlines are void."""
        if state.deadline_s is not None:
            heapq.heappush(self._heap, (state.deadline_s, self._place[robot], robot))

    def next(self) -> tuple[float, str] | None:
        """Returns the earliest valid deadline (seconds since the epoch) and its robot; `None` if there is none."""
        while self._heap:
            deadline_s, _, robot = self._heap[0]
            if self._robots[robot].deadline_s == deadline_s:
                return deadline_s, robot
            heapq.heappop(self._heap)
        return None


def timed_out(state: State, timeout_s: float) -> State:
    """Returns a robot's state after its order to install timed out: it failed, and the order is cancelled."""
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
    return failed(withdrawn(state), code, reason, at_s)
