"""Health checks of a run's physics: MuJoCo warnings, non-finite numbers, time, falls, jumps of the robot."""

# MuJoCo ships no types for its compiled module.
# pyright: reportAttributeAccessIssue=false, reportInvalidTypeForm=false

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import dm_env
import mujoco
import numpy as np
from dm_control.rl.control import PhysicsError

from ....schemas.runs.plan import Requirement
from .physics import floor_geoms, raw_physics, robot_bodies, robot_body
from .run_results import Findings, Observer

LOOK_EVERY_STEPS = 50
"""Steps between two searches for non-finite numbers, which do not become finite again. A search costs 10 us, a step of
a small model 40 us; the end of a run is always checked.
"""

BELOW_FLOOR_M = 0.2
"""Depth in metres below the floor at which the robot has fallen through it; soft contacts and low bodies stay above."""

_TIME_STANDS_AFTER = 3
"""Number of steps without progress of time after which the clock counts as stopped; an environment may prepare for a
step or two.
"""

_DIVERGED = (mujoco.mjtWarning.mjWARN_BADQPOS, mujoco.mjtWarning.mjWARN_BADQVEL, mujoco.mjtWarning.mjWARN_BADQACC)
_SPOILS_JUDGEMENT = {
    int(mujoco.mjtWarning.mjWARN_CONTACTFULL): "contacts were dropped, because MuJoCo's memory is too small",
    int(mujoco.mjtWarning.mjWARN_CNSTRFULL): "constraints were dropped, because MuJoCo's memory is too small",
    int(mujoco.mjtWarning.mjWARN_BADCTRL): "the robot's command was not finite, and 0 was taken in its place",
}


@dataclass(frozen=True)
class _First:
    """First occurrence of a defect of the physics, with its step and simulated time in seconds, for a message."""

    text: str
    step: int
    time_s: float

    def __str__(self) -> str:
        return f"{self.text}, first in step {self.step}, at {self.time_s:.3f} s"


class PhysicsHealth(Observer):
    """Observer that checks after each step that the physics is valid; defects become part of the verdict.

    It checks after every step, whatever the simulated time does.
    """

    next_time_s = -math.inf

    def __init__(self) -> None:
        self._model: mujoco.MjModel | None = None
        self._data: Any = None
        self._warnings: Any = None
        self._seen = b""
        self._before: Any = None
        self._body: int | None = None
        self._floor_m = -math.inf
        self._length_m = math.inf
        self._raw: Any = None
        self._xpos: Any = None
        self._place: list[float] = []
        self._steps = self._timesteps = 0
        self._time_s = 0.0
        self._still_steps = 0
        self._broken: dict[str, _First] = {}
        self._missed: dict[str, _First] = {}
        self._noted: dict[str, _First] = {}

    # The loop's watcher

    def watch(self, environment: Any, time_s: float) -> None:
        """Checks the physics after a step.

        Raises:
            PhysicsError: The physics diverged, and MuJoCo reset it.
        """
        data = environment.physics.data
        if data is not self._data:
            self._bind(environment)
        if self._warnings.tobytes() != self._seen:
            self._read_warnings(max(time_s, self._time_s))
        if time_s == self._time_s:
            self._still_steps += 1
        elif time_s < self._time_s:
            self._note(self._broken, "time", f"simulated time went back from {self._time_s:.3f} s")
        self._time_s = time_s
        if self._body is not None:
            self._look_at_robot()
        if self._steps % LOOK_EVERY_STEPS == 0:
            self._look_for_numbers()
        self._steps += 1

    def look_at_timestep(self, timestep: dm_env.TimeStep) -> None:
        """Notes a defect if a time step has a reward that is not finite; looks now and then for NaN in observations."""
        self._timesteps += 1
        reward = timestep.reward
        if isinstance(reward, float) and not math.isfinite(reward):
            self._note(self._noted, "reward", f"the reward was {reward}", self._timesteps)
        if self._timesteps % LOOK_EVERY_STEPS == 1 and (name := _nan_in(timestep.observation)):
            self._note(self._noted, "observation", f"the observation {name!r} had NaN", self._timesteps)

    def last_look(self, environment: Any) -> None:
        """Looks once more for bad numbers in the physics, at the end of the run; does nothing without physics."""
        if self._data is not None and getattr(environment, "physics", None) is not None:
            self._look_for_numbers()

    def state(self) -> dict[str, Any]:
        """Returns the defects found so far, with all counts of the watched run, for a checkpoint."""
        kept = ("_steps", "_timesteps", "_time_s", "_still_steps", "_broken", "_missed", "_noted")
        return {name: getattr(self, name) for name in kept}

    def restore(self, state: dict[str, Any], environment: Any) -> None:
        """Restores the found defects from a checkpoint's state, and reads from then on the environment's physics."""
        self.__dict__.update(state)
        self._bind(environment)

    def close(self, ended_by: str | None) -> Findings:
        """Returns the physics' defects, which count as missed requirements, and notes; none of a run that failed.

        Args:
            ended_by: Cause of the run's end; None if it failed.
        """
        if ended_by is None:
            return Findings()
        steps = self._steps - 1  # the first look is after the reset
        if steps > _TIME_STANDS_AFTER and self._still_steps >= steps:
            text = f"simulated time stood at {self._time_s:.3f} s"
            self._broken.setdefault("time", _First(text, 1, self._time_s))
        defects = [_defect(name, str(first), is_error=True) for name, first in self._broken.items()]
        defects += [_defect(name, str(first), is_error=False) for name, first in self._missed.items()]
        return Findings(defects=defects, notes=[str(first) for first in self._noted.values()])

    # Looks

    def _bind(self, environment: Any) -> None:
        """Caches constants of the environment's physics, which it may replace: robot body, floor, warnings."""
        model, data = raw_physics(environment.physics)
        self._data = environment.physics.data
        self._raw = data
        self._warnings = data.warning.number  # a view, which MuJoCo changes
        self._before = self._warnings.copy()
        self._seen = self._warnings.tobytes()
        self._model = model
        named = getattr(environment, "robot_body", None)
        found = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, named) if isinstance(named, str) else -1
        self._body = found if found > 0 else robot_body(model)
        collides = (model.geom_contype != 0) | (model.geom_conaffinity != 0)
        floor = floor_geoms(model, data) & collides  # the surface of water is none
        self._floor_m = float(data.geom_xpos[floor, 2].min()) if floor.any() else -math.inf
        if self._body is not None:
            self._length_m = 2 * _reach_m(model, data, self._body)
            self._xpos = data.xpos[self._body]
            self._place = self._xpos.tolist()

    def _read_warnings(self, time_s: float) -> None:
        new = np.flatnonzero(self._warnings > self._before).tolist()
        self._seen = self._warnings.tobytes()
        for kind in new:
            if kind in _DIVERGED:
                text = mujoco.mju_warningText(kind, int(self._raw.warning[kind].lastinfo))
                raise PhysicsError(f"the simulation diverged after {time_s:.3f} s: {text}")
            if kind in _SPOILS_JUDGEMENT:
                self._note(self._broken, "physics", _SPOILS_JUDGEMENT[kind])
            else:
                self._note(self._noted, f"warning {kind}", f"MuJoCo warned: {mujoco.mjtWarning(kind).name}")

    def _look_at_robot(self) -> None:
        place = self._xpos.tolist()
        moved_m = math.dist(place, self._place)
        self._place = place
        if (z := place[2]) < self._floor_m - BELOW_FLOOR_M:
            self._note(self._missed, "above_floor", f"the robot is {self._floor_m - z:.2f} m below the floor")
        if moved_m > self._length_m and self._steps:
            text = f"the robot moved {moved_m:.2f} m in one step, farther than it is long ({self._length_m:.2f} m)"
            self._note(self._noted, "jump", text)

    def _look_for_numbers(self) -> None:
        for name in ("qpos", "qvel", "act"):
            values = getattr(self._raw, name)
            if not np.isfinite(values).all():
                self._note(self._broken, "physics", f"{name} of the physics is not finite")

    def _note(self, place: dict[str, _First], name: str, text: str, step: int | None = None) -> None:
        if name not in place:
            place[name] = _First(text, self._steps if step is None else step, self._time_s)


def _defect(name: str, text: str, *, is_error: bool) -> Requirement:
    return Requirement(
        name=name, kind="health", satisfied=False, detail=text, error=text if is_error else None, unit=None
    )


def _nan_in(observation: Any, name: str = "") -> str:
    """Returns the name of an array with NaN in an observation; empty if no array has NaN."""
    if isinstance(observation, Mapping):
        return next((found for key, item in observation.items() if (found := _nan_in(item, str(key)))), "")
    if isinstance(observation, np.ndarray) and observation.dtype.kind == "f" and np.isnan(observation).any():
        return name or "array"
    return ""


def _reach_m(model: mujoco.MjModel, data: mujoco.MjData, body: int) -> float:
    """Returns the radius in metres of a sphere around the robot's body that encloses all of its geoms.

    It is infinite for a robot without geoms.
    """
    geoms = np.flatnonzero(robot_bodies(model, body)[model.geom_bodyid])
    if not len(geoms):
        return math.inf
    away = np.linalg.norm(data.geom_xpos[geoms] - data.xpos[body], axis=1) + model.geom_rbound[geoms]
    return float(away.max())
