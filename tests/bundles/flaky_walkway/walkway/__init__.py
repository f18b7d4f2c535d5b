"""A walkway without physics: a robot on a line has one simulated second to come far enough."""

import os
import time

import dm_env
import numpy as np

STEPS = 20
STEP_S = 0.05
FAR_ENOUGH_M = 0.4
"""The way that is asked for: a robot at 1 m/s comes 1 m, one at 0.1 m/s comes 0.1 m."""


def _kick_m(cause: str) -> float:
    """Distance by which the walkway itself moves the robot back, where a cause is planted in the simulation."""
    if cause == "entropy":
        return 0.9 * (os.urandom(1)[0] % 2)
    if cause == "clock":
        return 0.9 * (time.time_ns() // 1000 % 2)
    return 0.0


class Walkway(dm_env.Environment):
    """The position is the action's integral."""

    def __init__(self, context):
        self._cause = context.environment.get("WALKWAY", "")
        self._x_m, self._steps = 0.0, 0

    def reset(self):
        self._x_m, self._steps = 0.0, 0
        return dm_env.restart(self._observed())

    def step(self, action):
        self._steps += 1
        self._x_m += STEP_S * float(np.clip(action[0], -1.0, 1.0))
        if self._steps == STEPS // 2:
            self._x_m -= _kick_m(self._cause)
        if self._steps >= STEPS:
            return dm_env.termination(0.0, self._observed())
        return dm_env.transition(0.0, self._observed())

    def control_timestep(self):
        return STEP_S

    def action_spec(self):
        return dm_env.specs.BoundedArray((1,), np.float64, -1, 1, name="velocity")

    def observation_spec(self):
        return {"x": dm_env.specs.Array((1,), np.float64)}

    def state(self):
        return np.array([self._x_m]).tobytes()

    def run_result(self):
        is_far = self._x_m >= FAR_ENOUGH_M
        far = {"name": "far-enough", "satisfied": is_far, "detail": f"{self._x_m:.3f} m of {FAR_ENOUGH_M} m"}
        return {"verdict": "PASS" if is_far else "FAIL", "requirements": [far], "metrics": {"way_m": self._x_m}}

    def _observed(self):
        return {"x": np.array([self._x_m])}


def make_environment(context) -> dm_env.Environment:
    return Walkway(context)


def make_agent(context, environment):
    """A robot in the simulation's process, whose choice no seed repeats."""
    is_fast = os.urandom(1)[0] % 2 == 0
    return lambda timestep: np.array([1.0 if is_fast else 0.1])
