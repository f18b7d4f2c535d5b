"""Simulation application for the smallest job: a ball falls for 0.5 s. `robomaker doctor` tests backends with it."""

# dm_control and dm_env have no types, so overriding their methods looks wrong to a type checker.
# pyright: reportIncompatibleMethodOverride=false

from typing import Any

import dm_env
import numpy as np
from dm_control import mujoco
from dm_env import specs

_MODEL = """
<mujoco model="falling ball">
  <worldbody>
    <geom type="plane" size="1 1 .1"/>
    <body pos="0 0 1"><freejoint/><geom size=".1"/></body>
  </worldbody>
</mujoco>
"""
_STEPS = 50
_STEPS_EACH = 5  # of 2 ms


class FallingBall(dm_env.Environment):
    """Smallest example environment: a ball falls, and the run passes if the ball is lower at the end."""

    def __init__(self) -> None:
        self._physics = mujoco.Physics.from_xml_string(_MODEL)
        self._steps = 0

    @property
    def physics(self) -> mujoco.Physics:
        """The ball's dm_control physics."""
        return self._physics

    def reset(self) -> dm_env.TimeStep:
        """Puts the ball back up, and returns the first time step."""
        self._physics.reset()
        self._steps = 0
        return dm_env.restart(self._height())

    def step(self, action: Any) -> dm_env.TimeStep:  # noqa: ARG002 - nothing moves the ball
        """Simulates ten milliseconds of the ball's fall; the last time step ends the run, after half a second."""
        self._physics.step(_STEPS_EACH)
        self._steps += 1
        ends = self._steps >= _STEPS
        return dm_env.termination(0.0, self._height()) if ends else dm_env.transition(0.0, self._height())

    def observation_spec(self) -> specs.Array:
        """Returns the observation's spec: the ball's height in metres, shape (1,)."""
        return specs.Array((1,), float)

    def action_spec(self) -> specs.Array:
        """Returns the action's spec: no actions, shape (0,)."""
        return specs.Array((0,), float)

    def run_result(self) -> dict[str, Any]:
        """Returns the verdict, PASS if the ball has fallen, and its height in metres."""
        fell = bool(self._height()[0] < 1.0)
        return {"verdict": "PASS" if fell else "FAIL", "metrics": {"height_m": float(self._height()[0])}}

    def _height(self) -> np.ndarray:
        return self._physics.data.qpos[2:3].copy()


def make_environment(context: Any) -> FallingBall:  # noqa: ARG001 - the interface of applications
    """Makes the environment of the smallest example: a falling ball."""
    return FallingBall()


def make_agent(context: Any, environment: Any) -> Any:  # noqa: ARG001 - the interface of applications
    """Makes an agent that does nothing: its action has no numbers."""
    return lambda _timestep: np.zeros(0)
