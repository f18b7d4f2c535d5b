"""A puck that drives round a crate, and the ways to spoil it or its simulation, chosen by the variable SABOTAGE.

With the variable HANG something does not return: `act`, `step`, `result` or `agent`. It blocks in native code, where
no signal reaches it; with `act-in-python` it computes for ever.
"""

import ctypes
import os
import signal
import time
from pathlib import Path

import dm_env
import numpy as np
from dm_control import mujoco
from dm_env import specs
from drive import command

MODEL = """
<mujoco>
  <option timestep="0.01"/>
  <worldbody>
    <geom name="floor" type="plane" size="9 9 .1"/>
    <geom name="south" type="box" size="2 .05 .2" pos="0 -.4 .2"/>
    <body name="crate" pos=".8 0 .2"><geom name="crate" type="box" size=".1 .1 .2"/></body>
    <body name="puck" pos="0 0 .06">
      <joint name="x" type="slide" axis="1 0 0"/><joint name="y" type="slide" axis="0 1 0"/>
      <geom name="puck" type="cylinder" size=".1 .05" mass="2" {bits}/>
    </body>
  </worldbody>
  <actuator><velocity joint="x" kv="40"/><velocity joint="y" kv="40"/></actuator>
</mujoco>
"""
END_S = 5.0
ARRIVED_M = 1.2
SPOILT = Path(__file__).with_name("spoilt.txt")
"""Names the sabotage of a spoilt bundle."""


def hang(context, place):
    """Blocks if the variable HANG names the place, and leaves a file that says so."""
    if context.environment.get("HANG", "") == place:
        Path("busy").touch()
        ctypes.PyDLL(None).sleep(10_000)


def sabotage_of(context):
    """The sabotage that the job asks for, else the one that is in the bundle."""
    return context.environment.get("SABOTAGE") or (SPOILT.read_text() if SPOILT.exists() else "")


class Yard(dm_env.Environment):
    robot_body = "puck"

    def __init__(self, context):
        self.context, self.variables = context, context.environment
        self.sabotage = sabotage_of(context)
        bits = 'contype="0" conaffinity="0"' if self.sabotage == "ghost" else ""
        self.physics = mujoco.Physics.from_xml_string(MODEL.format(bits=bits))
        self.steps = 0

    def observation(self):
        return {"place": self.physics.data.qpos[:2].copy()}

    def reset(self):
        if self.sabotage == "gone":
            return dm_env.TimeStep(dm_env.StepType.LAST, None, None, self.observation())
        return dm_env.restart(self.observation())

    def step(self, action):
        self.steps += 1
        if self.steps == 37:
            hang(self.context, "step")
        if self.steps >= int(self.variables.get("KILL_AT", "1000000")) and not Path("killed").exists():
            if list(Path(self.variables["CHECKPOINTS"]).glob("checkpoint-*.bin")):
                Path("killed").touch()
                os.kill(os.getpid(), signal.SIGKILL)
            time.sleep(1.0)  # checkpoints are a hundredth of the time: after a slow one the next is seconds away
        self.physics.data.ctrl[:] = action
        self.physics.step(2)
        is_over = self.physics.data.qpos[0] >= ARRIVED_M or self.physics.data.time >= END_S
        return dm_env.termination(0.0, self.observation()) if is_over else dm_env.transition(0.0, self.observation())

    def observation_spec(self):
        return {"place": specs.Array((2,), np.float64, "place")}

    def action_spec(self):
        return specs.BoundedArray((2,), np.float64, -1, 1, "velocity")

    def control_timestep(self):
        return 0.02

    def state(self):
        return {"steps": self.steps}

    def restore(self, state):
        self.steps = state["steps"]


class OwnYard(Yard):
    """A yard that drives its robot itself, and says itself what it is judged by."""

    def step(self, action):
        return super().step(command(self.physics.data.qpos[:2], self.sabotage))

    def requirements(self):
        return self.asked


class JudgingYard(Yard):
    def run_result(self):
        hang(self.context, "result")
        return {"verdict": "PASS"}


class Driver:
    def __init__(self, context):
        self.context, self.sabotage, self.acts = context, sabotage_of(context), 0

    def __call__(self, timestep):
        self.acts += 1
        if self.acts == 37:
            hang(self.context, "act")
            if self.context.environment.get("HANG") == "act-in-python":
                Path("busy").touch()
                while True:
                    time.sleep(0.02)
        return command(timestep.observation["place"], self.sabotage)

    def state(self):
        return None

    def restore(self, state):
        pass


def make_environment(context):
    return Yard(context)


def make_own_environment(context):
    import json

    environment = OwnYard(context)
    environment.asked = json.loads(context.environment["ASKED"])
    return environment


def make_judging_environment(context):
    return JudgingYard(context)


def make_agent(context, environment):
    hang(context, "agent")
    return Driver(context)


def moves(environment, time_s):
    """Says whether the robot gets on: 0.3 m from its start after a second."""
    away_m = float(np.linalg.norm(environment.physics.data.qpos[:2]))
    return time_s < 1 or away_m > 0.3, f"{away_m:.2f} m from its start"
