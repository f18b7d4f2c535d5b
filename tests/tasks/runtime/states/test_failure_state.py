"""What a run leaves behind whose physics breaks."""

import re
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import dm_env
import mujoco
import numpy as np
import pytest
from dm_control.rl.control import PhysicsError
from helpers.paths import REPOSITORY
from helpers.stop_flags import StopFlag

from prefect_robomaker.schemas.runs.plan import ApplicationPlan, RunPlan
from prefect_robomaker.schemas.runs.programs import ApplicationRole
from prefect_robomaker.schemas.runs.provenance import FailureState
from prefect_robomaker.tasks.runtime.process.run_loop import run_episode
from prefect_robomaker.tasks.runtime.recording.recording import Recorder
from prefect_robomaker.tasks.runtime.states.digest import digest_of_model
from prefect_robomaker.tasks.runtime.states.failure_state import FailureRecorder
from prefect_robomaker.tasks.runtime.supervision.launcher import Launcher

DOCUMENTATION = REPOSITORY / "docs" / "verdicts.md"
MODEL = """
<mujoco>
  <option timestep="0.005"{option}/>
  <worldbody>
    <geom name="ground" type="plane" size="9 9 .1"/>
    <body name="crate" pos="3 0 .1"><freejoint name="crate"/><geom name="crate" type="box" size=".1 .1 .1"/></body>
    <body name="arm" pos="0 0 1">
      <joint name="elbow" type="hinge" axis="0 1 0"/><geom name="arm" type="capsule" size=".03" fromto="0 0 0 .3 0 0"/>
    </body>
  </worldbody>
  <actuator><motor name="push" joint="elbow" gear="1"/></actuator>
</mujoco>
"""


class Raw(dm_env.Environment):
    """Calls MuJoCo itself; something happens in each step."""

    def __init__(self, happens: Callable[[mujoco.MjData, int], None], option: str = "") -> None:
        model = mujoco.MjModel.from_xml_string(MODEL.format(option=option))
        self.physics = SimpleNamespace(model=model, data=mujoco.MjData(model))
        self._happens, self._count = happens, 0

    def reset(self) -> Any:
        mujoco.mj_forward(self.physics.model, self.physics.data)
        return dm_env.restart(0)

    def step(self, action: Any) -> Any:
        self._count += 1
        self._happens(self.physics.data, self._count)
        mujoco.mj_step(self.physics.model, self.physics.data, 4)
        return (dm_env.termination if self._count == 100 else dm_env.transition)(0.0, 0)

    action_spec = observation_spec = lambda self: None


def run(environment: Any, folder: Path) -> Any:
    keeper = FailureRecorder(folder)
    try:
        episode = run_episode(
            lambda: environment, lambda environment: lambda timestep: None, mark=lambda phase: None,
            stop=StopFlag(), recorder=Recorder(), watchers=[keeper],
        )  # fmt: skip
    except BaseException:
        keeper.close(None)
        raise
    return keeper.close(episode.ended_by)


@pytest.fixture(autouse=True)
def _scratch(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "work").mkdir()
    monkeypatch.chdir(tmp_path / "work")  # MuJoCo writes MUJOCO_LOG.TXT


def push(data: mujoco.MjData, count: int) -> None:
    """From 1 s on an ever larger force, until it is too much."""
    data.ctrl[0] = 0.1 if count < 50 else 1e3 * 10.0 ** (count - 50)


def test_the_state_before_it_diverged_is_kept(tmp_path: Path) -> None:
    with pytest.raises(PhysicsError, match="diverged"):
        run(Raw(push), tmp_path)
    state = FailureState.model_validate_json((tmp_path / "failure-state.json").read_bytes())
    assert state.began_anew
    (warning,) = state.warnings
    assert warning.warning in ("mjWARN_BADQACC", "mjWARN_BADQVEL", "mjWARN_BADQPOS")
    assert (warning.joint, warning.body) == ("elbow", "arm")
    assert state.joints[0].joint == "elbow"
    assert state.time_s == pytest.approx(state.step * 0.005)
    assert state.time_s >= 1.0
    assert state.control["push"] >= 0.1
    assert {state.contacts[0].first, state.contacts[0].second} == {"ground", "crate"}
    # A crate of 8 kg rests on four corners.
    assert sum(contact.normal_force_N or 0 for contact in state.contacts) == pytest.approx(8 * 9.81, rel=0.02)


def test_the_state_can_be_loaded_and_breaks_again(tmp_path: Path) -> None:
    """What the documentation shows."""
    with pytest.raises(PhysicsError):
        run(Raw(push), tmp_path)
    state = FailureState.model_validate_json((tmp_path / "failure-state.json").read_bytes())

    (shown,) = (text for text in re.findall(r"```python\n(.*?)```", DOCUMENTATION.read_text(), re.S) if "mj_" in text)
    names: dict[str, Any] = {}
    exec(shown, names)
    model, data = names["before_it_broke"](tmp_path)

    assert digest_of_model(model) == state.model_sha256
    assert data.time == state.time_s
    assert data.ctrl[0] == state.control["push"]
    assert data.qpos[-1] == state.joints[0].qpos[0]
    data.ctrl[0] = 1e12
    mujoco.mj_step(model, data, 20)
    assert any(warning.number for warning in data.warning)


def test_an_environment_that_goes_on_with_nan(tmp_path: Path) -> None:
    def poison(data: mujoco.MjData, count: int) -> None:
        if count == 20:
            data.qvel[2] = np.nan
        if count == 21:
            raise RuntimeError("the environment noticed")

    flag = '><flag autoreset="disable"/></option><option'
    with pytest.raises(PhysicsError, match="diverged"):
        run(Raw(poison, flag), tmp_path)
    state = FailureState.model_validate_json((tmp_path / "failure-state.json").read_bytes())
    assert not state.began_anew
    assert 2 in state.not_finite["qvel"]
    assert state.warnings[0].joint == "crate"
    assert np.isfinite(np.load(tmp_path / "failure-state.npy")).all()


def test_warnings_that_end_nothing_are_counted(tmp_path: Path) -> None:
    def bad_control(data: mujoco.MjData, count: int) -> None:
        data.ctrl[0] = np.nan if count in (10, 20) else 0.0

    findings = run(Raw(bad_control), tmp_path)
    # MuJoCo takes such a control for 0 in each of the step's four.
    assert findings.extra == {"mujoco_warnings": {"mjWARN_BADCTRL": 8}}
    assert findings.metrics == {"mujoco_warnings": 8.0}
    assert not (tmp_path / "failure-state.json").exists()


def test_a_run_without_trouble_says_nothing_and_a_crash_of_code_leaves_no_state(tmp_path: Path) -> None:
    findings = run(Raw(lambda data, count: None), tmp_path)
    assert (findings.extra, findings.metrics) == ({}, {})

    def crash(data: mujoco.MjData, count: int) -> None:
        raise ValueError("no fault of the physics")

    with pytest.raises(ValueError, match="no fault"):
        run(Raw(crash), tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["work"]


BUNDLE = """
import numpy as np
from dm_control import mujoco
from dm_control.rl import control


class Push(control.Task):
    def initialize_episode(self, physics): ...
    def before_step(self, action, physics): physics.set_control(action)
    def action_spec(self, physics): return mujoco.action_spec(physics)
    def get_observation(self, physics): return {}
    def get_reward(self, physics): return 0.0


def make_environment(context):
    physics = mujoco.Physics.from_xml_string(MODEL)
    return control.Environment(physics, Push(), time_limit=9, control_timestep=0.02)


def make_agent(context, environment):
    def agent(timestep):
        time_s = environment.physics.time()
        return np.array([0.1 if time_s < 1 else 1e3 * 10 ** (50 * (time_s - 1))])
    return agent
"""


def test_a_real_job_leaves_its_state_behind(
    launcher: Launcher, make_plan: Callable[..., RunPlan], tmp_path: Path
) -> None:
    bundle = tmp_path / "bundle"
    bundle.mkdir()
    (bundle / "pusher.py").write_text(f"MODEL = '''{MODEL.format(option='')}'''\n{BUNDLE}")
    roles: tuple[ApplicationRole, ...] = ("simulation", "robot")
    applications = {
        f"{role}_application": ApplicationPlan(role=role, name="pusher", attribute=f"pusher.{factory}", path=bundle)
        for role, factory in zip(roles, ("make_environment", "make_agent"), strict=True)
    }
    plan = make_plan(**applications)
    outcome = launcher.run(plan, lambda: None)
    assert (outcome.status, outcome.failure_code) == ("Failed", "SimulationApplicationCrash")
    assert "mjWARN_BADQ" in (outcome.failure_reason or "")
    state = FailureState.model_validate_json((plan.output_dir / "failure-state.json").read_bytes())
    assert state.warnings[0].joint == "elbow"
    assert 1.0 <= state.time_s < 1.5
    assert (plan.output_dir / "failure-model.mjb").stat().st_size > 1000
    assert not (plan.output_dir / "result.json").exists()
