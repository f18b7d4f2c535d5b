"""Requirements that nothing could miss are errors, and say why."""

import itertools
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import dm_env
import mujoco
import numpy as np
import pytest
from helpers.stop_flags import StopFlag

from prefect_robomaker.schemas.runs.plan import RunPlan, RunResult
from prefect_robomaker.schemas.runs.requirement_kinds.kind import RequirementError
from prefect_robomaker.tasks.runtime.episode.progress import RunEnded
from prefect_robomaker.tasks.runtime.episode.run_results import make_result
from prefect_robomaker.tasks.runtime.process.run_loop import run_episode
from prefect_robomaker.tasks.runtime.recording.recording import Recorder
from prefect_robomaker.tasks.runtime.requirements.observer import RequirementsObserver
from prefect_robomaker.tasks.runtime.requirements.scene import Scene

MODEL = """
<mujoco><option timestep="0.02"/><worldbody>
  <geom name="floor" type="plane" size="9 9 .1"/>
  {before}
  <body name="crate" pos=".6 0 .2"><geom name="crate" type="box" size=".1 .1 .2"/></body>
  <body name="puck" pos="0 0 .06"><joint name="x" type="slide" axis="1 0 0"/>
    <geom name="puck" type="cylinder" size=".1 .05" mass="2" {bits}/></body>
  {after}
</worldbody><actuator><velocity joint="x" kv="40"/></actuator></mujoco>
"""
GENTLE = {"kind": "no_collision", "name": "gentle", "max_force_N": 1.0}
POLITE = {"kind": "clearance", "name": "polite", "min_m": 0.05}
FAR = [{"kind": "goal", "name": "far", "x": 100.0, "y": 0.0}]


class Arena(dm_env.Environment):
    """A puck that drives east, to a crate."""

    robot_body = "puck"

    def __init__(self, steps: int = 100, bits: str = "", before: str = "", after: str = "") -> None:
        model = mujoco.MjModel.from_xml_string(MODEL.format(bits=bits, before=before, after=after))
        self.physics = SimpleNamespace(model=model, data=mujoco.MjData(model))
        self._last, self._done, self.is_closed = steps, 0, False

    def reset(self) -> dm_env.TimeStep:
        mujoco.mj_forward(self.physics.model, self.physics.data)
        return dm_env.restart({})

    def step(self, action: Any) -> dm_env.TimeStep:
        self._done += 1
        self.physics.data.ctrl[:] = action
        mujoco.mj_step(self.physics.model, self.physics.data)
        return dm_env.termination(0.0, {}) if self._done >= self._last else dm_env.transition(0.0, {})

    def close(self) -> None:
        self.is_closed = True

    def observation_spec(self) -> Any:
        raise NotImplementedError

    action_spec = observation_spec


class Cut:
    """Ends a run as the duration limit of its job does."""

    next_time_s = 0.5

    def watch(self, environment: Any, time_s: float) -> None:
        raise RunEnded("duration limit")


def judged(folder: Path, *requirements: dict[str, Any], arena: Any = None, watchers: tuple[Any, ...] = ()) -> RunResult:
    plan = RunPlan.model_validate({
        "job_id": "sim-1", "job_arn": "arn:aws:robomaker:us-east-1:111122223333:simulation-job/sim-1",
        "run_id": "run-1", "seed": 1, "max_duration_s": 60.0, "work_dir": str(folder), "output_dir": str(folder),
        "requirements": list(requirements),
    }, strict=False)  # fmt: skip
    observer = RequirementsObserver(plan)
    episode = run_episode(
        lambda: arena or Arena(), lambda environment: lambda timestep: np.array([0.5]), mark=lambda phase: None,
        stop=StopFlag(), recorder=Recorder(), watchers=[observer, *watchers],
        wall_clock=itertools.count(0.0, 1.0).__next__,
    )  # fmt: skip
    return make_result(episode, 1, [observer.close(episode.ended_by)])


def test_the_puck_does_hit_the_crate(tmp_path: Path) -> None:
    assert judged(tmp_path, GENTLE, POLITE).verdict == "FAIL"


@pytest.mark.parametrize("bits", ['contype="0" conaffinity="0"', 'contype="2" conaffinity="2"'])
@pytest.mark.parametrize("requirement", [GENTLE, POLITE])
def test_a_robot_that_goes_through_everything(tmp_path: Path, bits: str, requirement: dict[str, Any]) -> None:
    result = judged(tmp_path, requirement, arena=Arena(bits=bits))
    assert result.verdict == "ERROR"
    assert "the robot has no shape that collides with anything else" in (result.reason or "")


@pytest.mark.parametrize("requirement", [GENTLE, POLITE])
def test_names_that_fit_nothing(tmp_path: Path, requirement: dict[str, Any]) -> None:
    result = judged(tmp_path, {**requirement, "others": ["crate", "Chairs*"]})
    assert result.verdict == "ERROR"
    assert "nothing is named like 'Chairs*'; there are crate, floor" in (result.reason or "")


def test_a_robot_and_its_obstacle_in_one_fixed_body(tmp_path: Path) -> None:
    arena = Arena(before='<body name="hall">', after="</body>")
    assert judged(tmp_path, GENTLE, arena=arena).verdict == "FAIL"


def test_a_time_limit_that_the_jobs_limit_cuts(tmp_path: Path) -> None:
    quick = {"kind": "time_limit", "name": "quick", "limit_s": 50.0}
    result = judged(tmp_path, quick, watchers=(Cut(),))
    assert result.verdict == "ERROR"
    assert "it was not over when the job's duration limit ended it, at 0.50 of 50 s" in (result.reason or "")
    assert result.remarks == ["the job's duration limit ended the run at 0.50 of 50 s: 99 % were not driven"]


def test_a_time_limit_that_the_environments_own_limit_comes_before(tmp_path: Path) -> None:
    arena: Any = Arena()
    arena._time_limit = 2.0  # where dm_control's environments have it
    late = judged(tmp_path, {"kind": "time_limit", "name": "quick", "limit_s": 2.0}, arena=arena)
    assert late.verdict == "ERROR"
    assert "the environment ends its runs at 2 s, so a limit of 2 s is never over" in (late.reason or "")
    arena = Arena()
    arena._time_limit = 2.5
    assert judged(tmp_path, {"kind": "time_limit", "name": "quick", "limit_s": 2.4}, arena=arena).verdict == "PASS"


def test_a_time_limit_that_the_limit_which_an_environment_names_comes_before(tmp_path: Path) -> None:
    arena: Any = Arena()
    arena.time_limit_s, arena.run_result = 2.0, lambda: {"verdict": "PASS"}
    late = judged(tmp_path, {"kind": "time_limit", "name": "quick", "limit_s": 3.0}, arena=arena)
    assert "the environment ends its runs at 2 s, so a limit of 3 s is never over" in (late.reason or "")


@pytest.mark.parametrize("requirement", [GENTLE, POLITE])
def test_an_empty_hall(tmp_path: Path, requirement: dict[str, Any]) -> None:
    ignoring = judged(tmp_path, {**requirement, "ignore": ["cra*"]})
    assert ignoring.verdict == "ERROR"
    assert "beside the robot and the floor there is nothing that is not ignored" in (ignoring.reason or "")


def test_a_goal_where_the_robot_starts(tmp_path: Path) -> None:
    start = {"kind": "goal", "name": "start", "x": 0.0, "y": 0.0}
    going_on = judged(tmp_path, start)
    assert going_on.verdict == "PASS"
    assert going_on.remarks == ["start: reached where the robot starts, before it moved"]
    ended = judged(tmp_path, {**start, "stop": True})
    assert ended.verdict == "ERROR"
    assert "nothing was simulated: a goal that is reached where the robot starts" in (ended.reason or "")


def test_a_function_is_asked_at_the_end_before_the_environment_is_closed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "rules_of_the_end.py").write_text(
        "def open_and_early(environment, time_s):\n    return not environment.is_closed and time_s < 0.59\n"
    )
    monkeypatch.syspath_prepend(str(tmp_path))
    rule = {"kind": "predicate", "name": "rule", "attribute": "rules_of_the_end.open_and_early", "period_s": 0.5}
    assert judged(tmp_path, rule, arena=Arena(steps=29)).verdict == "PASS"
    late = judged(tmp_path, rule, arena=Arena(steps=30))
    assert late.verdict == "FAIL"
    assert "did not hold at 0.60 s" in (late.reason or "")


class TestRequirementsOfTheEnvironment:
    def test_without_physics(self, tmp_path: Path) -> None:
        class Blind(Arena):
            def __init__(self) -> None:
                super().__init__(steps=5)
                self._physics = self.physics
                del self.physics

            def reset(self) -> dm_env.TimeStep:
                return dm_env.restart({})

            def step(self, action: Any) -> dm_env.TimeStep:
                self._done += 1
                return dm_env.termination(0.0, {}) if self._done >= 5 else dm_env.transition(0.0, {})

            def requirements(self) -> Any:
                return FAR

        result = judged(tmp_path, arena=Blind())
        assert result.verdict == "ERROR"
        assert "the environment has no `physics` to judge it by" in (result.reason or "")

    def test_as_a_list(self, tmp_path: Path) -> None:
        arena: Any = Arena()
        arena.requirements = FAR
        with pytest.raises(RequirementError, match=r"environment\.requirements is of type list; it has to be a method"):
            judged(tmp_path, arena=arena)


def test_kinds_without_members_for_bodies_and_things_measure_the_robot_and_everything() -> None:
    arena = Arena()
    arena.reset()
    rule: Any = SimpleNamespace(asked=SimpleNamespace(name="own", kind="own"), error=None)
    scene = Scene(arena, arena.physics.model, arena.physics.data, RunPlan.model_construct(), lambda: None)

    assert list(scene.position(rule)) == pytest.approx([0, 0, 0.06])
    assert scene.contacts(rule)() == {}
    assert scene.clearance(rule)(1.0) == (pytest.approx(0.4), "crate")
