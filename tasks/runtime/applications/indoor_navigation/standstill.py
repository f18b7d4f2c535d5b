"""Notes about robots that are told to drive and hardly move, and about robots that never move."""

# MuJoCo ships no types for its compiled module.
# pyright: reportAttributeAccessIssue=false

import math

import mujoco
import numpy as np

from ...episode.context import KeepsAttributes
from ...robots.drives import DifferentialDrive, PlanarDrive, VelocityDrive
from ...robots.robot import CONTROL_TIMESTEP_S, Action, Robot
from .telemetry import RobotState

_WINDOW_STEPS = 20
"""Control steps of a window, 1 s: long against the ramp of a start, short against a drive that ends at an obstacle."""

_TOLD_M = 0.05
"""Distance in metres of the commands of a window from which it counts: a robot that settles on its wheels moves less
than a tenth of it.
"""

_TOLD_RAD = 0.1
"""Angle in radians of the commands of a window from which it counts; it moves a wheel of Scout as far as 2 cm."""

_OBEYED = 0.1
"""Share of the commands of a window from which the robot has moved: wheels that slip, delays and long ramps leave more
at some time of a run.
"""

_FEWEST_WINDOWS = 3
"""Fewest windows with commands, or in which nothing moves, for a note: a shorter run tells nothing of the robot."""

_STILL_M = 0.05
_STILL_RAD = 0.1
"""Angle in radians, as `_STILL_M` in metres, within which a robot has never moved: it settles and is nudged so far."""

_AT_LIMIT = 0.99
"""Share of an actuator's force limit from which the actuator is at the limit."""


class Standstill(KeepsAttributes):
    """Watch over a robot's commands and motion, in windows of a second, for a note if the robot hardly moves.

    A single window in which the robot moved as told is enough: a robot that is blocked later, or waits, gets no note.
    """

    KEPT = (
        *("_steps", "_windows", "_told_m", "_told_rad", "_linear", "_angular", "_at_limit", "_obeyed", "_drove"),
        *("_began", "_last_yaw", "_yaw", "_start", "_turned_rad", "_moved_m"),
    )

    def __init__(self, robot: Robot, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """Prepares the watch over a run, before its first step.

        Args:
            robot: The robot; one whose actions are no velocities gets no notes.
            model: The world with the robot.
            data: State of the model.
        """
        self._limits = robot.limits if isinstance(robot.drive, VelocityDrive) else None
        self._data = data
        names = [f"{robot.prefix}{name}" for name in _actuators(robot)]
        ids = [int(model.actuator(name).id) for name in names]
        self._limited = np.array([each for each in ids if model.actuator_forcelimited[each]], np.intp)
        self._labels = [_label(model, int(each), robot.prefix) for each in self._limited]
        self._force_range = model.actuator_forcerange[self._limited]
        self._steps = self._windows = 0
        self._told_m = self._told_rad = self._linear = self._angular = 0.0
        self._at_limit = np.zeros(len(self._limited), np.int64)
        self._obeyed = self._drove = False
        self._start: tuple[float, float] | None = None
        self._began = (0.0, 0.0, 0.0)
        self._last_yaw = self._yaw = self._turned_rad = self._moved_m = 0.0

    def command(self, action: Action) -> None:
        """Adds a command of the agent, which the robot's controller has accepted, for the next control step."""
        if self._limits is None:
            return
        linear, angular = (float(value) for value in action)
        linear = max(-self._limits.linear_mps, min(self._limits.linear_mps, linear))
        angular = max(-self._limits.angular_radps, min(self._limits.angular_radps, angular))
        self._told_m += linear * CONTROL_TIMESTEP_S
        self._told_rad += angular * CONTROL_TIMESTEP_S
        self._linear, self._angular = max(self._linear, abs(linear)), max(self._angular, abs(angular))

    def look(self, state: RobotState) -> None:
        """Compares the robot's motion with its commands, at the beginning and after each control step."""
        if self._limits is None:
            return
        if self._start is None:
            self._start, self._last_yaw = (state.x, state.y), state.yaw
            self._began = (state.x, state.y, 0.0)
            return
        self._yaw += math.remainder(state.yaw - self._last_yaw, math.tau)
        self._last_yaw = state.yaw
        self._steps += 1
        if self._steps % _WINDOW_STEPS == 0:
            self._end_window(state.x, state.y)

    def notes(self) -> list[str]:
        """Returns the note about the run so far; empty if the robot moved, or the run was too short to tell."""
        if self._windows >= _FEWEST_WINDOWS and not self._obeyed:
            return [f"the robot was told to {self._in_words}{self._at_its_limit}"]
        is_still = self._moved_m < _STILL_M and self._turned_rad < _STILL_RAD
        if self._steps < _FEWEST_WINDOWS * _WINDOW_STEPS or not is_still:
            return []
        was_told = self._linear or self._angular
        return ["the robot never moved" if was_told else "the robot never moved: it was only told to stand still"]

    def _end_window(self, x: float, y: float) -> None:
        assert self._start is not None
        was_x, was_y, was_yaw = self._began
        self._began = (x, y, self._yaw)
        self._moved_m = max(self._moved_m, math.dist((x, y), self._start))
        self._turned_rad = max(self._turned_rad, abs(self._yaw))
        told_m, told_rad = abs(self._told_m), abs(self._told_rad)
        self._told_m = self._told_rad = 0.0
        drives, turns = told_m >= _TOLD_M, told_rad >= _TOLD_RAD
        if not (drives or turns):
            return
        self._windows += 1
        self._drove |= drives
        self._obeyed |= drives and math.dist((x, y), (was_x, was_y)) >= _OBEYED * told_m
        self._obeyed |= turns and abs(self._yaw - was_yaw) >= _OBEYED * told_rad
        forces = self._data.actuator_force[self._limited]
        low, high = self._force_range[:, 0], self._force_range[:, 1]
        self._at_limit += (forces <= _AT_LIMIT * low) | (forces >= _AT_LIMIT * high)

    @property
    def _in_words(self) -> str:
        if self._drove:
            return f"drive at up to {self._linear:.2f} m/s and moved {self._moved_m:.2f} m"
        return f"turn at up to {self._angular:.2f} rad/s and turned {self._turned_rad:.2f} rad"

    @property
    def _at_its_limit(self) -> str:
        """Names the actuators that were at their force limit in most windows, by limit; empty without any."""
        named: dict[str, list[str]] = {}
        for (name, limit), count in zip(self._labels, self._at_limit.tolist(), strict=True):
            if 2 * count > self._windows:
                named.setdefault(limit, []).append(name)
        return "".join(
            f"; {', '.join(names)} {'are at their' if len(names) > 1 else 'is at its'} force limit of {limit}"
            for limit, names in named.items()
        )


def _actuators(robot: Robot) -> list[str]:
    """Returns the names of the actuators that move a robot's base; none are known of robots with legs."""
    drive = robot.drive
    if isinstance(drive, DifferentialDrive):
        return [*drive.left, *drive.right]
    if isinstance(drive, PlanarDrive):
        return [name for name in (drive.x, drive.y, drive.yaw) if name is not None]
    return []


def _label(model: mujoco.MjModel, actuator: int, prefix: str) -> tuple[str, str]:
    """Returns an actuator's name without the robot's prefix, and its force limit with the unit."""
    is_joint = model.actuator_trntype[actuator] == mujoco.mjtTrn.mjTRN_JOINT
    joint = int(model.actuator_trnid[actuator, 0])
    is_slide = is_joint and model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_SLIDE
    limit = float(np.abs(model.actuator_forcerange[actuator]).max())
    return model.actuator(actuator).name.removeprefix(prefix), f"{limit:g} {'N' if is_slide else 'Nm'}"
