"""Environments whose observations and actions are of every kind, or not what their specs say."""

import time
from types import SimpleNamespace

import dm_env
import numpy as np
from dm_env import specs

STEPS = 5


class Unusual(dm_env.Environment):
    """Nested, of all types, with things that cannot be sent; echoes actions."""

    def __init__(self):
        self.taken = []

    def reset(self):
        return dm_env.restart(self.observation({"grip": False, "arms": [np.zeros(2), 0]}))

    def step(self, action):
        self.taken.append(action)
        make = dm_env.termination if len(self.taken) == STEPS else dm_env.transition
        return make(-1.5, self.observation(action))

    def observation(self, action):
        return {
            "camera": {"rgb": np.arange(24, dtype=np.uint8).reshape(2, 4, 3), "say": "cheese"},
            "echo": {"grip": action["grip"], "arms": list(action["arms"])},
            "half": np.float16(0.1),
            "count": len(self.taken),
            "big": np.array([2**63, 1], np.uint64),
            "none": np.zeros((0, 3)),
        }

    def action_spec(self):
        wheels = specs.BoundedArray((2,), np.float32, [-1, -np.inf], [1, 2], name="wheels: rad/s, left and right")
        return {"grip": specs.Array((), bool), "arms": [wheels, specs.DiscreteArray(4)]}

    def observation_spec(self):
        return {
            "camera": {"rgb": specs.BoundedArray((2, 4, 3), np.uint8, 0, 255), "say": specs.StringArray(())},
            "echo": self.action_spec(),
            "half": specs.Array((), np.float16),
            "count": specs.Array((), np.int64),
            "big": specs.Array((2,), np.uint64),
            "none": specs.Array((0, 3), np.float64),
        }

    def control_timestep(self):
        return 0.25

    def run_result(self):
        kinds = [type(action["arms"][1]).__name__ for action in self.taken]
        owned = len({id(action["arms"][0]) for action in self.taken})
        taken = [[bool(action["grip"]), action["arms"][0].tolist(), int(action["arms"][1])] for action in self.taken]
        return {"extra": {"kinds": kinds, "owned": owned, "taken": taken}}


def make_unusual(context):
    return Unusual()


class Camera(dm_env.Environment):
    """A megabyte to look at, twenty times a second."""

    steps = 0

    def reset(self):
        return dm_env.restart(self.image())

    def step(self, action):
        self.steps += 1
        return dm_env.transition(0.0, self.image()) if self.steps < 30 else dm_env.termination(0.0, self.image())

    def image(self):
        return np.full((512, 1024, 3), self.steps, np.uint8)

    def action_spec(self):
        return specs.Array((), np.float64)

    def observation_spec(self):
        return specs.Array((512, 1024, 3), np.uint8)

    def control_timestep(self):
        return 0.02


def make_camera(context):
    return Camera()


class Timed(Camera):
    """Notes when it is stepped, and with what."""

    time_limit_s = 0.6

    def __init__(self):
        self.times, self.actions = [], []

    def image(self):
        return np.full((), self.steps)

    def step(self, action):
        self.times.append(time.monotonic())
        self.actions.append(float(action))
        return super().step(action)

    def observation_spec(self):
        return specs.Array((), np.int64)

    def run_result(self):
        return {"extra": {"times": self.times, "actions": self.actions}}


def make_timed(context):
    return Timed()


def _lying(make_observation):
    """An environment whose third observation is not what it says."""

    class Lying(Timed):
        def image(self):
            return make_observation() if self.steps == 2 else super().image()

    return lambda context: Lying()


wrong_shape = _lying(lambda: np.zeros(3))
wrong_type = _lying(lambda: np.array(0.5))
wrong_structure = _lying(lambda: {"a": [1, [2]]})


class Hopeless(Timed):
    def action_spec(self):
        return {"say": specs.StringArray(())}


def hopeless(context):
    return Hopeless()


def no_spec(context):
    return SimpleNamespace(reset=None.__class__, step=None.__class__)


class NoClock(Unusual):
    control_timestep = None


def no_clock(context):
    return NoClock()
