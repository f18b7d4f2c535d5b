"""Runs in which the physics is not sound do not pass, and say in which step and at what time."""

import itertools
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import dm_env
import mujoco
import numpy as np
import pytest
from dm_control.rl.control import PhysicsError
from helpers.stop_flags import StopFlag

from prefect_robomaker.schemas.runs.plan import RunResult
from prefect_robomaker.tasks.runtime.episode.health import PhysicsHealth
from prefect_robomaker.tasks.runtime.episode.run_results import EnvironmentReport, make_result
from prefect_robomaker.tasks.runtime.process.run_loop import run_episode
from prefect_robomaker.tasks.runtime.recording.recording import Recorder

MODEL = """
<mujoco><option timestep="0.01">{flag}</option>{size}<worldbody>
  <geom name="floor" type="plane" size="9 9 .1"/>
  <body name="robot" pos="0 0 .12"><freejoint/><geom type="box" size=".1 .1 .1" mass="1" {bits}/>
    <body><joint name="wheel" type="hinge"/><geom size=".02" mass=".1" contype="0" conaffinity="0"/></body>
  </body>
{more}</worldbody><actuator><motor name="wheel" joint="wheel" gear=".001"/></actuator></mujoco>
"""
Change = Callable[["Yard", int], None]


class Yard(dm_env.Environment):
    """A box on a floor that judges itself and passes; `change` is called before each step."""

    def __init__(self, change: Change = lambda yard, step: None, steps: int = 40, **model: str) -> None:
        compiled = mujoco.MjModel.from_xml_string(
            MODEL.format(**{"flag": "", "size": "", "bits": "", "more": "", **model})
        )
        self.physics = SimpleNamespace(model=compiled, data=mujoco.MjData(compiled))
        self._change, self._last, self._done = change, steps, 0
        self.moves = True
        self.reward = 0.0
        self.seen: Any = np.zeros(2)

    def reset(self) -> dm_env.TimeStep:
        mujoco.mj_forward(self.physics.model, self.physics.data)
        return dm_env.restart({"seen": self.seen})

    def step(self, action: Any) -> dm_env.TimeStep:
        self._done += 1
        self.physics.data.ctrl[:] = action
        self._change(self, self._done)
        if self.moves:
            mujoco.mj_step(self.physics.model, self.physics.data)
        else:
            mujoco.mj_forward(self.physics.model, self.physics.data)
        end = dm_env.termination if self._done >= self._last else dm_env.transition
        return end(self.reward, {"seen": self.seen})

    def observation_spec(self) -> Any:
        raise NotImplementedError

    action_spec = observation_spec

    def run_result(self) -> EnvironmentReport:
        return EnvironmentReport(verdict="PASS")


def run(yard: Yard, action: float = 0.0) -> RunResult:
    health = PhysicsHealth()
    episode = run_episode(
        lambda: yard, lambda environment: lambda timestep: np.array([action]), mark=lambda phase: None,
        stop=StopFlag(), recorder=Recorder(), health=health, wall_clock=itertools.count(0.0, 1.0).__next__,
    )  # fmt: skip
    return make_result(episode, 1, [health.close(episode.ended_by)])


def test_a_sound_run_passes_without_a_word() -> None:
    result = run(Yard())
    assert (result.verdict, result.remarks) == ("PASS", [])


def test_commands_that_are_not_finite() -> None:
    result = run(Yard(), action=np.nan)
    assert result.verdict == "ERROR"
    assert result.reason == (
        "physics: the robot's command was not finite, and 0 was taken in its place, first in step 1, at 0.000 s"
    )


def test_contacts_that_are_dropped() -> None:
    places = [f"{1 + 0.03 * (ball % 6)} {0.03 * (ball // 6)} .05" for ball in range(36)]
    heap = "".join(f'<body pos="{place}"><freejoint/><geom size=".05"/></body>' for place in places)
    assert run(Yard(more=heap)).verdict == "PASS"
    result = run(Yard(more=heap, size='<size memory="200K"/>'))
    assert result.verdict == "ERROR"
    assert "dropped, because MuJoCo's memory is too small" in (result.reason or "")


@pytest.mark.parametrize("flag", ["", '<flag autoreset="disable"/>'])
def test_physics_that_diverges_whether_mujoco_begins_anew_or_not(flag: str) -> None:
    def explode(yard: Yard, step: int) -> None:
        yard.physics.data.qvel[0] = 1e20

    with pytest.raises(PhysicsError, match=r"diverged after 0\.0"):
        run(Yard(explode, flag=flag))


def test_numbers_of_an_environment_of_its_own_that_are_not_finite() -> None:
    def poison(yard: Yard, step: int) -> None:
        yard.moves = False  # `mj_forward` does not look at numbers
        yard.physics.data.time += 0.01
        if step > 5:
            yard.physics.data.qvel[0] = np.nan

    result = run(Yard(poison))
    assert result.verdict == "ERROR"
    assert "qvel of the physics is not finite" in (result.reason or "")


def test_time_that_stands() -> None:
    def hold(yard: Yard, step: int) -> None:
        yard.moves = False

    assert "simulated time stood at 0.000 s" in (run(Yard(hold)).reason or "")


def test_time_that_goes_back() -> None:
    def rewind(yard: Yard, step: int) -> None:
        if step == 30:
            yard.physics.data.time = 0.05

    result = run(Yard(rewind))
    assert result.verdict == "ERROR"
    assert "simulated time went back from 0.290 s, first in step 30" in (result.reason or "")


def test_a_robot_that_falls_through_the_floor() -> None:
    result = run(Yard(bits='contype="2" conaffinity="2"', steps=60))
    assert result.verdict == "FAIL"
    assert "above_floor: the robot is 0.2" in (result.reason or "")
    assert "m below the floor, first in step" in (result.reason or "")


def test_a_robot_that_jumps_is_noted() -> None:
    def jump(yard: Yard, step: int) -> None:
        if step == 20:
            yard.physics.data.qpos[0] += 3.0

    result = run(Yard(jump))
    assert result.verdict == "PASS"
    [note] = result.remarks
    assert note.startswith("the robot moved 3.00 m in one step, farther than it is long")


def test_rewards_and_observations_that_are_not_numbers_are_noted() -> None:
    def spoil(yard: Yard, step: int) -> None:
        yard.reward, yard.seen = np.nan, np.array([0.0, np.nan])

    result = run(Yard(spoil))
    assert result.verdict == "PASS"
    assert result.remarks == [
        "the reward was nan, first in step 1, at 0.010 s",
        "the observation 'seen' had NaN, first in step 1, at 0.010 s",
    ]


def test_where_nothing_is_judged_defects_are_notes() -> None:
    yard: Any = Yard()
    yard.run_result = lambda: EnvironmentReport()
    result = run(yard, action=np.nan)
    assert result.verdict == "NONE"
    assert result.remarks[0].startswith("the robot's command was not finite")
