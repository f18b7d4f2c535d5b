"""An environment that does nothing for a while, and an agent that watches: quick jobs for tests."""

import os
import subprocess
import time

import dm_env
import numpy as np
from dm_env import specs


class Sleep(dm_env.Environment):
    """Lasts for a given wall-clock time."""

    def __init__(self, duration_s: float, fail_at_step: int) -> None:
        self._duration_s = duration_s
        self._fail_at_step = fail_at_step
        self._end = 0.0
        self._steps = 0

    def reset(self) -> dm_env.TimeStep:
        self._end = time.monotonic() + self._duration_s
        return dm_env.restart(np.zeros(1))

    def step(self, action: object) -> dm_env.TimeStep:
        self._steps += 1
        if self._steps == self._fail_at_step:
            raise RuntimeError("the simulated floor gave way")
        time.sleep(0.01)
        if time.monotonic() >= self._end:
            return dm_env.termination(0.0, np.zeros(1))
        return dm_env.transition(0.0, np.zeros(1))

    def observation_spec(self) -> specs.Array:
        return specs.Array((1,), float)

    def action_spec(self) -> specs.Array:
        return specs.Array((1,), float)


def make_environment(context: object) -> Sleep:
    variables = context.environment
    if "DO" in variables:
        exec(variables["DO"], {"context": context})
    if "SPAWN" in variables:
        subprocess.Popen(["sleep", "300"], start_new_session=True)
    return Sleep(float(variables.get("DURATION_S", "0.1")), int(variables.get("FAIL_AT_STEP", "0")))


def make_agent(context: object, environment: Sleep) -> object:
    print("agent watches", os.environ["AWS_ROBOMAKER_SIMULATION_JOB_ID"], flush=True)
    return lambda timestep: np.zeros(1)
