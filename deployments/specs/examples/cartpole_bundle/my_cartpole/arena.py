"""The simulation application: a pole on a cart, to be kept upright for ten seconds."""

# dm_control has no types, so overriding its methods looks wrong to a type checker.
# pyright: reportIncompatibleMethodOverride=false

import math

import numpy as np
from dm_control import mujoco
from dm_control.rl import control

MODEL = """
<mujoco model="cartpole">
  <option timestep="0.005"/>
  <asset><texture type="skybox" builtin="gradient" rgb1=".6 .7 .85" rgb2=".95 .95 1" width="64" height="64"/></asset>
  <worldbody>
    <light pos="0 -2 4"/>
    <camera name="side" pos="0 -4 1" xyaxes="1 0 0 0 0 1"/>
    <geom name="floor" type="plane" size="4 4 .1" pos="0 0 -.1" rgba=".7 .7 .7 1"/>
    <body name="cart">
      <joint name="slider" type="slide" axis="1 0 0" damping=".1"/>
      <geom type="box" size=".2 .1 .08" mass="1" rgba=".2 .4 .7 1" contype="0" conaffinity="0"/>
      <body name="pole">
        <joint name="hinge" type="hinge" axis="0 1 0"/>
        <geom type="capsule" fromto="0 0 0 0 0 1" size=".04" mass=".1" rgba=".8 .4 .1 1"
              contype="0" conaffinity="0"/>
      </body>
    </body>
  </worldbody>
  <actuator><motor name="push" joint="slider" gear="10" ctrlrange="-1 1" ctrllimited="true"/></actuator>
</mujoco>
"""
FALLEN_RAD = 0.5


class Balance(control.Task):
    """Cart-pole task: balance the pole; the episode ends when it has fallen."""

    def __init__(self, rng: np.random.Generator) -> None:
        self._rng = rng
        self.largest_angle = 0.0

    def initialize_episode(self, physics: mujoco.Physics):
        """Starts with the pole slightly off balance."""
        physics.named.data.qpos["hinge"] = self._rng.uniform(-0.05, 0.05)

    def before_step(self, action: np.ndarray, physics: mujoco.Physics):
        """Pushes the cart."""
        physics.set_control(action)

    def after_step(self, physics: mujoco.Physics):
        """Records the largest angle so far."""
        self.largest_angle = max(self.largest_angle, abs(physics.named.data.qpos["hinge"].item()))

    def action_spec(self, physics: mujoco.Physics):
        """Returns the spec of the action: one push between -1 and 1."""
        return mujoco.action_spec(physics)

    def get_observation(self, physics: mujoco.Physics):
        """Returns positions and velocities of cart and pole."""
        return {"position": physics.position(), "velocity": physics.velocity()}

    def get_reward(self, physics: mujoco.Physics):
        """Returns the reward: 1 when the pole is upright."""
        return math.cos(physics.named.data.qpos["hinge"].item())

    def get_termination(self, physics: mujoco.Physics):
        """Ends the episode when the pole has fallen."""
        fallen = abs(physics.named.data.qpos["hinge"].item()) > FALLEN_RAD
        return 0.0 if fallen else None


class Cartpole(control.Environment):
    """Cart-pole environment that gives a verdict on its run."""

    video_camera = "side"

    def run_result(self) -> dict:
        """Returns the verdict: PASS if the pole never fell."""
        angle = self.task.largest_angle
        upright = angle <= FALLEN_RAD
        detail = f"leaned {angle:.3f} rad at most, {FALLEN_RAD} rad is fallen"
        return {
            "verdict": "PASS" if upright else "FAIL",
            "summary": f"The pole {'stayed up' if upright else 'fell'}.",
            "requirements": [{"name": "upright", "satisfied": upright, "detail": detail}],
            "metrics": {"largest_angle_rad": angle},
        }


def make_environment(context) -> Cartpole:
    """Makes the cart-pole environment; the variable TIME_LIMIT_S changes its ten seconds."""
    limit = float(context.environment.get("TIME_LIMIT_S", "10"))
    print(f"cartpole with seed {context.plan.seed}, {limit:g} s")  # noqa: T201 (goes to logs/stdout.log)
    physics = mujoco.Physics.from_xml_string(MODEL)
    return Cartpole(physics, Balance(context.rng), time_limit=limit, control_timestep=0.02)
