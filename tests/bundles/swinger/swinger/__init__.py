"""A driven double pendulum, chaotic and quick: its environment and its agent can be continued."""

import logging
import os
import signal
import time
from pathlib import Path

import dm_env
import numpy as np
from dm_control import mujoco
from dm_control.rl import control

MODEL = """
<mujoco>
  <option timestep="0.01"/>
  <worldbody>
    <body name="upper">
      <joint name="shoulder" axis="0 1 0" damping=".01"/><geom size=".05" pos=".2 0 0"/>
      <body name="lower" pos=".4 0 0"><joint name="elbow" axis="0 1 0"/><geom size=".05" pos=".2 0 0"/></body>
    </body>
    <body name="ball" pos="0 1 .3"><freejoint name="ball"/><geom size=".1"/></body>
    <geom type="plane" size="5 5 1" pos="0 0 -1"/>
  </worldbody>
  <actuator><motor name="motor" joint="shoulder"/></actuator>
</mujoco>
"""


class Swing(control.Task):
    """Kicks the elbow now and then, by chance; the verdict is the highest swing."""

    def __init__(self, context):
        self.rng, self.recorder, self.variables = context.rng, context.recorder, context.environment
        self.highest = 0.0
        self.steps = 0

    def initialize_episode(self, physics):
        physics.named.data.qpos["shoulder"] = self.rng.uniform(0.1, 1.0)

    def before_step(self, action, physics):
        physics.data.ctrl[:] = action
        self.steps += 1
        if self.steps % 7 == 0:
            physics.named.data.qvel["elbow"] += self.rng.normal()
        if self.steps == int(self.variables.get("DRIFT_AT", "-1")):
            # Eight bytes: with one, two runs in 256 drift alike.
            physics.named.data.qpos["elbow"] += 1e-6 * int.from_bytes(os.urandom(8), "big") / 2**64
        if self.steps == int(self.variables.get("FAIL_AT", "-1")):
            raise RuntimeError("the rope broke")
        if self.steps == int(self.variables.get("ABORT_AT", "-1")):
            os.kill(os.getpid(), signal.SIGABRT)
        is_due = self.steps == int(self.variables.get("KILL_AT", "-1"))
        if is_due and ("KILL_ALWAYS" in self.variables or not Path("killed").exists()):
            Path("killed").touch()
            os.kill(os.getpid(), signal.SIGKILL)
        time.sleep(float(self.variables.get("SLEEP_S", "0")))
        computes_until_s = time.process_time() + float(self.variables.get("COMPUTE_S", "0"))
        while time.process_time() < computes_until_s:
            pass

    def after_step(self, physics):
        self.highest = max(self.highest, float(physics.named.data.qpos["elbow"][0]))

    def get_reward(self, physics):
        return 0.0

    def get_observation(self, physics):
        return {"angles": physics.data.qpos[:2].copy()}

    def action_spec(self, physics):
        return mujoco.action_spec(physics)


class Swinging(control.Environment):
    def state(self):
        task = self._task
        return {"steps": task.steps, "highest": task.highest, "count": self._step_count}

    def restore(self, state):
        self._task.steps, self._task.highest = state["steps"], state["highest"]
        self._step_count, self._reset_next_step = state["count"], False

    def renew(self, context):
        self._task = Swing(context)

    def run_result(self):
        verdict = "PASS" if self._task.highest < float(self._task.variables.get("LIMIT", "inf")) else "FAIL"
        missed = {"name": "low", "satisfied": verdict == "PASS", "detail": f"{self._task.highest} rad"}
        return {"verdict": verdict, "metrics": {"highest_rad": self._task.highest}, "requirements": [missed]}


class ClosedSwinging(control.Environment):
    """The same, but it cannot be continued, and is made anew for each trial."""


def make_environment(context) -> dm_env.Environment:
    physics = mujoco.Physics.from_xml_string(MODEL)
    kind = ClosedSwinging if "CLOSED" in context.environment else Swinging
    limit_s = float(context.environment.get("TIME_LIMIT_S", "4"))
    return kind(physics, Swing(context), time_limit=limit_s, control_timestep=0.02, legacy_step=False)


class Map(dm_env.Environment):
    """A chaotic map without physics, which tells its state as bytes: of 0.02 s a step, for a simulated second."""

    def __init__(self, context):
        self.rng, self.variables = context.rng, context.environment
        self.value, self.steps = 0.0, 0

    def reset(self):
        self.value = self.rng.uniform(0.1, 0.9)
        return dm_env.restart(self._observed())

    def step(self, action):
        self.steps += 1
        if self.steps == int(self.variables.get("DRIFT_AT", "-1")):
            self.value = int.from_bytes(os.urandom(8), "big") / 2**64
        time.sleep(float(self.variables.get("SLEEP_S", "0")))
        self.value = (3.9 * self.value * (1 - self.value) + 1e-3 * float(action[0])) % 1
        if self.steps >= 50 * float(self.variables.get("TIME_LIMIT_S", "1")):
            return dm_env.termination(0.0, self._observed())
        return dm_env.transition(0.0, self._observed())

    def control_timestep(self):
        return 0.02

    def action_spec(self):
        return dm_env.specs.BoundedArray((1,), np.float64, -1, 1)

    def observation_spec(self):
        return {"angles": dm_env.specs.Array((1,), np.float64)}

    def _observed(self):
        return {"angles": np.array([self.value])}


class ToldMap(Map):
    def state(self):
        told = np.array([self.value]).tobytes()
        return told.hex() if self.steps == int(self.variables.get("TEXT_AT", "-1")) else told


class TextMap(Map):
    """Its state is for checkpoints only."""

    def state(self):
        return str(self.value)


def make_map(context) -> dm_env.Environment:
    return TextMap(context) if "SILENT" in context.environment else ToldMap(context)


class Pusher:
    """Pushes against the swing, more as time goes by, with a little noise."""

    def __init__(self, rng):
        self.rng = rng
        self.pushes = 0

    def __call__(self, timestep):
        self.pushes += 1
        return np.array([0.01 * self.pushes * np.sin(timestep.observation["angles"][0]) + 0.1 * self.rng.normal()])

    def state(self):
        return self.pushes

    def restore(self, state):
        self.pushes = state


def make_agent(context, environment):
    print("agent begins", flush=True)
    logging.warning("a joint squeaks")
    return Pusher(context.rng)
