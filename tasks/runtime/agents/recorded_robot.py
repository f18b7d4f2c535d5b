"""Robot that plays back recorded actions, so that a rerun needs neither the robot program nor its timing."""

import math
from collections.abc import Callable
from typing import Any

import dm_env

from ....schemas.runs.plan import RecordedActions
from ....schemas.wire.common import counted
from ....schemas.wire.errors import LaunchError
from ..episode.context import ActionError, RobotProgramError, SimulationContext
from ..episode.progress import RunEnded
from ..episode.run_results import Findings, Observer
from .action_log import ActionLog, ActionLogError, ActionLogHeader, header_of
from .agent_client import ACTION_HEADER
from .agent_protocol import read_action
from .remote_robot import action_layout

_NO_NUMBER = ACTION_HEADER.pack(0)


class RecordedRobot(Observer):
    """Robot of a rerun: it plays back recorded actions instead of running the robot program."""

    next_time_s = math.inf

    def __init__(self, recorded: RecordedActions, robot: str) -> None:
        """Opens the recorded actions of a robot program, to play them back.

        Args:
            recorded: The actions, and how the run ended.
            robot: The robot application's name.

        Raises:
            LaunchError: The recorded actions cannot be read.
        """
        try:
            self._log = ActionLog(recorded.path)
        except ActionLogError as error:
            raise LaunchError(f"the recorded actions of robot application {robot}: {error}") from error
        self._ended_by = recorded.ended_by
        self._robot = robot
        self._taken = 0

    def make_agent(self, context: SimulationContext, environment: dm_env.Environment) -> Callable[..., Any]:
        """Returns an agent that plays back the recorded actions, one for each time step.

        Args:
            context: Context of the run.
            environment: Environment in which the actions are played back.

        Raises:
            LaunchError: The environment takes other actions than those that were recorded.
        """
        del context
        layout = action_layout(environment)
        if _comparable_parts(header_of(self._log.header.mode, layout)) != _comparable_parts(self._log.header):
            raise LaunchError(
                f"the recorded actions of robot application {self._robot} are {self._log.header}; this "
                f"environment takes {layout.summary()}"
            )
        actions = iter(self._log)

        def agent(timestep: dm_env.TimeStep) -> Any:
            del timestep
            action = next(actions, None)
            if action is None:
                raise self._end()
            self._taken += 1
            try:
                return read_action(layout, memoryview(_NO_NUMBER + action), range(1))
            except ActionError as error:  # the file was made elsewhere
                raise RobotProgramError(f"recorded action {self._taken - 1}: {error}") from error

        return agent

    def actions(self) -> None:
        """Returns `None`: a rerun records no actions."""

    def close(self, ended_by: str | None) -> Findings:
        """Returns the findings about the robot for the run's result: mode, and number of played back actions.

        The reason of the run's end does not matter.
        """
        del ended_by
        return Findings(extra={"agent": {"mode": "recorded", "actions": self._taken}})

    def _end(self) -> Exception:
        """Returns the exception to raise after the last recorded action, so that the rerun ends as the run did.

        That is `StopIteration` or `RunEnded`, or `RobotProgramError` if the recorded run failed there.
        """
        if self._ended_by == "agent":
            return StopIteration()
        if self._ended_by is not None:
            return RunEnded(self._ended_by)
        return RobotProgramError(
            f"the recorded actions of robot application {self._robot} end here, after {counted(self._taken, 'step')}, "
            "where the run failed; the program itself is not run again"
        )


def _comparable_parts(header: ActionLogHeader) -> list[tuple[Any, ...]]:
    """Returns the parts of an action log's header that must equal an environment's for the actions to fit it."""
    return [(array.path, array.dtype, array.shape, array.offset) for array in header.arrays]
