"""A ball falls onto a floor; after END_S seconds the run ends as END says.

Every step takes PAUSE_S seconds longer, until the file UNTIL is there.
"""

import os
import signal
import time
from pathlib import Path

from dm_control import mujoco
from dm_control.rl import control

MODEL = """
<mujoco>
  <worldbody>
    <light pos="0 0 5"/>
    <camera name="side" pos="0 -4 1" xyaxes="1 0 0 0 0 1"/>
    <geom type="plane" size="3 3 .1" rgba=".2 .6 .2 1"/>
    <body name="ball" pos="0 0 1.8"><freejoint/><geom size=".3" rgba="1 0 0 1"/></body>
  </worldbody>
</mujoco>
"""


class Fall(control.Task):
    def __init__(self, variables):
        self.end, self.end_s = variables.get("END", "pass"), float(variables.get("END_S", "1"))
        self.pause_s = float(variables.get("PAUSE_S", "0"))
        self.until = Path(variables["UNTIL"]) if "UNTIL" in variables else None

    def initialize_episode(self, physics):
        pass

    def before_step(self, action, physics):
        if self.until is None or not self.until.exists():
            time.sleep(self.pause_s)

    def action_spec(self, physics):
        return mujoco.action_spec(physics)

    def get_observation(self, physics):
        return {"height": physics.data.qpos[2:3].copy()}

    def get_reward(self, physics):
        return 0.0

    def get_termination(self, physics):
        if physics.data.time < self.end_s - 1e-9:
            return None
        if self.end == "raise":
            raise ValueError("the ball burst")
        if self.end == "kill":
            os.kill(os.getpid(), signal.SIGKILL)
        if self.end == "hang":
            while True:
                time.sleep(1)
        return 0.0


class Falling(control.Environment):
    video_camera = "side"

    def run_result(self):
        return {"verdict": "FAIL" if self.task.end == "fail" else "PASS"}


def make_environment(context):
    physics = mujoco.Physics.from_xml_string(MODEL)
    return Falling(physics, Fall(context.environment), control_timestep=0.02)


def make_agent(context, environment):
    return lambda timestep: []
