"""A deployment that is followed, where nothing can be redrawn: one line for each change."""

import time
from collections.abc import Callable
from typing import TextIO

from .....schemas.rollouts.robots import RobotDeploymentState
from .....schemas.rollouts.rollout import Rollout
from .....schemas.rollouts.standings import DeploymentStanding
from .....schemas.wire.arns import ResourceArn
from .....tasks.fleet.rollout.statuses import robot_status
from .....tasks.fleet.rollout.waits import in_words
from .....tasks.fleet.views.following import Look
from .....tasks.fleet.views.notes import notes_of
from .....tasks.fleet.views.standings import deployment_standing
from ..durations import duration
from .text import counts_text

MOST_LINES = 20
"""Lines for single robots at once; of more that changed, only how many stand how."""

_OVER = {
    "PAUSED": "resumed",
    "APPROVAL": "approved",
    "MAINTENANCE_WINDOW": "its maintenance window is open",
}
"""Words for what it waits for no more."""

HEARTBEAT_S = 60.0
"""Longest silence."""


class LineWatcher:
    """Writes a line for each change.

    Args:
        stream: where to.
        clock: seconds on a clock that only runs forward.
    """

    def __init__(self, stream: TextIO, clock: Callable[[], float] = time.monotonic) -> None:
        self._stream = stream
        self._clock = clock
        self._began_s = self._told_s = clock()
        self._before: Look | None = None

    def __call__(self, look: Look) -> None:
        """Takes the next look."""
        lines = changes(self._before, look)
        self._before = look
        if not lines and self._clock() - self._told_s >= HEARTBEAT_S:
            lines = [counts_text(deployment_standing(look.job, look.rollout, look.at_s)) or look.job.status]
        if lines:
            self._told_s = self._clock()
            at = duration(self._told_s - self._began_s)
            self._stream.write("".join(f"[{at:>12}] {line}\n" for line in lines))
            self._stream.flush()


def changes(before: Look | None, after: Look) -> list[str]:
    """Describes the changes between two looks, a line each.

    Args:
        before: the earlier look; nothing: there was none.
        after: the later one.
    """
    standing = deployment_standing(after.job, after.rollout, after.at_s)
    lines: list[str] = []
    if before is None:
        fleet = ResourceArn.parse(str(after.job.parent)).name
        lines.append(f"{standing.application} {standing.version} to {fleet}: {standing.job.rpartition('/')[2]}")
    if before is None or (before.job.status != after.job.status and not after.has_ended):
        begun = f", {standing.robots:,} robots in {standing.waves} waves" if standing.waves is not None else ""
        lines.append(f"{standing.status}{begun}")
    if after.rollout is not None:
        lines += _of_robots(before, after, after.rollout)
        lines += _of_waits(before, standing)
    if after.has_ended:
        why = f": {standing.failure_code}: {standing.failure_reason}" if standing.failure_code else ""
        counts = counts_text(standing)
        lines += [counts] if counts else []
        lines.append(f"{standing.status}{why}")
        lines += notes_of(standing)
    return lines


def _of_waits(before: Look | None, standing: DeploymentStanding) -> list[str]:
    """Describes the waits that began since the earlier look, and those that ended."""
    old = () if before is None else deployment_standing(before.job, before.rollout, before.at_s).waits
    now = {wait.cause for wait in standing.waits}
    was = {wait.cause for wait in old}
    begun = [in_words(wait, standing.job) for wait in standing.waits if wait.cause not in was]
    return [*begun, *(_OVER[cause] for cause in _OVER if cause in was - now and standing.status == "InProgress")]


def _of_robots(before: Look | None, after: Look, rollout: Rollout) -> list[str]:
    old = before.rollout.robots if before is not None and before.rollout is not None else {}
    number = {robot: number for number, wave in enumerate(after.waves, 1) for robot in wave}
    active = rollout.status == "InProgress"
    lines: list[str] = []
    for robot, state in rollout.robots.items():
        said = robot_line(state, active=active)
        earlier = old.get(robot)
        was = None if earlier is None else robot_line(earlier, active=True)
        if said is not None and said != was:
            wave = f" (wave {number[robot]})" if robot in number else ""
            lines.append(f"{ResourceArn.parse(robot).name}{wave}: {said}")
    if len(lines) <= MOST_LINES:
        return lines
    return [f"{len(lines):,} robots changed: {counts_text(deployment_standing(after.job, rollout, after.at_s))}"]


def robot_line(state: RobotDeploymentState, *, active: bool) -> str | None:
    """How a robot stands in one line; nothing while its turn has not come.

    Args:
        state: the robot.
        active: whether the rollout goes on.
    """
    if state.outcome == "failed":
        return f"{robot_status(state, active=active) or 'Failed'}: {state.failure_code}" + (
            f": {state.failure_reason}" if state.failure_reason else ""
        )
    if state.outcome == "succeeded":
        return "InSync"
    if state.gone is not None:
        return "left the fleet" if state.gone == "left" else "deleted"
    if state.order == "fetched":
        return state.step or "fetched its order"
    return f"order {state.action_id}" if state.order == "offered" else None
