import itertools
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import dm_env
import mujoco as mujoco_module
import numpy as np
import pytest
from dm_control import mujoco
from dm_control.rl import control
from helpers.stop_flags import StopFlag
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

from prefect_robomaker.tasks.runtime.episode.context import ActionError
from prefect_robomaker.tasks.runtime.episode.progress import Phase
from prefect_robomaker.tasks.runtime.episode.run_results import Episode, make_result
from prefect_robomaker.tasks.runtime.process.attempt import recording_findings
from prefect_robomaker.tasks.runtime.process.run_loop import RunStopped, run_episode
from prefect_robomaker.tasks.runtime.recording.messages import Clock, Time
from prefect_robomaker.tasks.runtime.recording.recording import McapRecorder, Recorder
from prefect_robomaker.tasks.runtime.video.camera_recorder import TOPIC

MODEL = """
<mujoco>
  <worldbody>
    <body>
      <joint name="lift" type="slide" axis="0 0 1"/><geom size=".1"/>
      <body><joint type="hinge" axis="0 1 0" pos=".3 0 0"/><geom size=".1" pos=".3 0 0"/></body>
    </body>
    <body pos="3 0 0"><freejoint/><geom size=".1"/></body>
  </worldbody>
  <actuator><motor joint="lift"/></actuator>
</mujoco>
"""


class Task(control.Task):
    """Pushes; a number that is not finite at a chosen step."""

    def __init__(self, bad_step: int = -1) -> None:
        self.steps = 0
        self.bad_step = bad_step

    def initialize_episode(self, physics: Any) -> None:
        physics.data.qpos[0] = 0.5

    def before_step(self, action: Any, physics: Any) -> None:
        physics.set_control(action)
        self.steps += 1
        if self.steps == self.bad_step:
            physics.data.qvel[0] = 1e20

    def action_spec(self, physics: Any) -> Any:
        return mujoco.action_spec(physics)

    def get_observation(self, physics: Any) -> Any:
        return {"qpos": physics.position()}

    def get_reward(self, physics: Any) -> Any:
        return 0.0


def physical(time_limit: float = 1.0, bad_step: int = -1) -> control.Environment:
    physics = mujoco.Physics.from_xml_string(MODEL)
    return control.Environment(physics, Task(bad_step), time_limit=time_limit, control_timestep=0.01)


def run(
    environment: Callable[[], Any] = physical,
    agent: Callable[[Any], Any] = lambda environment: lambda timestep: np.array([2.0]),
    **options: Any,
) -> Episode:
    defaults = {"mark": lambda phase: None, "stop": StopFlag(), "recorder": Recorder()}
    return run_episode(environment, agent, **(defaults | options))


def test_times_and_steps() -> None:
    episode = run(wall_clock=itertools.count(10.0, 4.0).__next__)
    assert (episode.ended_by, episode.steps, episode.wall_time_s) == ("environment", 100, 4.0)
    assert episode.sim_time_s == pytest.approx(1.0)


def test_phases_in_order() -> None:
    phases: list[Phase] = []
    run(lambda: physical(0.02), mark=lambda phase: phases.append(Phase(phase)))
    step = [Phase.AGENT, Phase.STEP]
    assert phases == [Phase.MAKE_ENVIRONMENT, Phase.MAKE_AGENT, Phase.RESET, *step, *step, Phase.REPORT]


def test_an_agent_that_returns_early() -> None:
    actions = iter([np.zeros(1)] * 7)
    episode = run(agent=lambda environment: lambda timestep: next(actions))
    assert (episode.ended_by, episode.steps) == ("agent", 7)


class Noting:
    """An agent that tells what a person should know of its run."""

    def __init__(self, notes: object) -> None:
        self._notes = notes

    def __call__(self, timestep: Any) -> Any:
        return np.array([2.0])

    def run_notes(self) -> object:
        return self._notes


def test_notes_of_the_agent_are_shown_with_the_verdict() -> None:
    episode = run(agent=lambda environment: Noting(["gave up:\n  no way"]))
    assert make_result(episode, 1).notes == ["gave up: no way"]


@pytest.mark.parametrize("notes", [None, "gave up", [3]])
def test_notes_that_are_no_list_of_text_take_nothing_from_a_run_that_has_ended(notes: object) -> None:
    episode = run(agent=lambda environment: Noting(notes))
    (told,) = make_result(episode, 1).notes
    assert told.startswith(
        f"no notes of the agent: its run_notes raised TypeError: agent.run_notes() returned {notes!r}"
    )


def test_an_attribute_that_is_called_like_the_method_is_left_alone() -> None:
    agent = Noting([])
    agent.run_notes = ["mine"]  # type: ignore[method-assign, assignment]
    assert make_result(run(agent=lambda environment: agent), 1).notes == []


def test_stop_iteration_of_the_environment_is_an_error() -> None:
    class Odd(dm_env.Environment):
        def reset(self) -> Any:
            return dm_env.restart(0)

        def step(self, action: Any) -> Any:
            raise StopIteration

        action_spec = observation_spec = lambda self: None

    with pytest.raises(StopIteration):
        run(Odd)


def test_a_stop_between_steps() -> None:
    stop = StopFlag()

    def make_agent(environment: Any) -> Any:
        def agent(timestep: Any) -> Any:
            stop.reason = "duration limit"
            return np.zeros(1)

        return agent

    episode = run(agent=make_agent, stop=stop)
    assert (episode.ended_by, episode.steps) == ("duration limit", 1)


def test_a_stop_that_interrupts_the_application() -> None:
    stop = StopFlag("canceled")

    def unfinished() -> Any:
        raise RunStopped

    episode = run(unfinished, stop=stop)
    assert (episode.ended_by, episode.steps, episode.sim_time_s) == ("canceled", 0, 0.0)


@pytest.mark.parametrize("action", [np.array([np.nan]), np.array([np.inf]), [float("nan")]])
def test_an_action_that_is_not_finite_is_an_error_of_the_robot_where_the_step_breaks(action: Any) -> None:
    phases: list[Phase] = []
    with pytest.raises(ActionError, match="finite") as caught:
        run(agent=lambda environment: lambda timestep: action, mark=lambda phase: phases.append(Phase(phase)))
    assert isinstance(caught.value.__cause__, control.PhysicsError)
    assert phases[-1] is Phase.AGENT


@pytest.mark.parametrize("action", [None, "forward", {"v": object()}, np.zeros(3)])
def test_what_breaks_with_another_action_is_still_the_environments(action: Any) -> None:
    phases: list[Phase] = []
    with pytest.raises(Exception, match=r".") as caught:
        run(agent=lambda environment: lambda timestep: action, mark=lambda phase: phases.append(Phase(phase)))
    assert not isinstance(caught.value, ActionError)
    assert phases[-1] is Phase.STEP


def test_divergence_is_an_error_of_the_environment() -> None:
    with pytest.raises(control.PhysicsError, match="mjWARN_BADQPOS") as caught:
        run(lambda: physical(bad_step=5))
    assert caught.value.__notes__ == ["in step 5, at 0.040 s simulated"]


class Raw(dm_env.Environment):
    """Calls MuJoCo itself, which begins anew at time 0 when a state is not finite and only warns."""

    def __init__(self) -> None:
        model = mujoco_module.MjModel.from_xml_string(MODEL)
        self.physics = SimpleNamespace(model=model, data=mujoco_module.MjData(model))

    def reset(self) -> Any:
        return dm_env.restart(0)

    def step(self, action: Any) -> Any:
        mujoco_module.mj_step(self.physics.model, self.physics.data, 5)
        if self.physics.data.time > 0.095:
            self.physics.data.qvel[0] = float("nan")
        return dm_env.transition(0.0, 0)

    action_spec = observation_spec = lambda self: None


def test_divergence_is_noticed_although_mujoco_goes_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)  # MuJoCo writes MUJOCO_LOG.TXT
    with pytest.raises(control.PhysicsError, match=r"diverged after 0\.100 s: .*simulation is unstable"):
        run(Raw)


def test_joint_states_by_default(tmp_path: Path) -> None:
    with McapRecorder(tmp_path / "r.mcap") as recorder:
        run(recorder=recorder)
    with (tmp_path / "r.mcap").open("rb") as stream:
        messages = [
            (item.channel.topic, item.message.log_time, item.decoded_message)
            for item in make_reader(stream, decoder_factories=[DecoderFactory()]).iter_decoded_messages()
        ]
    states = [message for topic, _, message in messages if topic == "/joint_states"]
    clocks = [time_ns for topic, time_ns, _ in messages if topic == "/clock"]
    assert clocks == [20_000_000 * i for i in range(51)]
    assert states[0].name == ["lift", "joint_1"]
    assert list(states[0].position) == [0.5, 0.0]
    assert list(states[-1].effort) == [2.0, 0.0]
    assert states[-1].velocity[0] < -0.5


def test_environments_that_record_themselves_are_left_to_it(tmp_path: Path) -> None:
    def make() -> Any:
        environment: Any = physical()
        environment.records_itself = True
        return environment

    with McapRecorder(tmp_path / "r.mcap") as recorder:
        run(make, recorder=recorder)
    with (tmp_path / "r.mcap").open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    assert not summary.channels


@pytest.mark.parametrize(("promises", "writes", "notes"), [
    (True, "", 1), (True, "/wheel", 0), (True, TOPIC, 1), (False, "", 0),
])  # fmt: skip
def test_an_environment_that_says_it_records_and_does_not_is_noted(
    tmp_path: Path, promises: bool, writes: str, notes: int
) -> None:
    recorder = McapRecorder(tmp_path / "r.mcap")

    def make() -> Any:
        environment: Any = physical()
        if promises:
            environment.records_itself = True
        return environment

    episode = run(make, recorder=recorder)
    if writes:
        recorder.write(writes, Clock(Time(1, 0)), 1.0)
    recorder.close()
    found = recording_findings(episode, recorder).notes
    assert found == ["the environment says records_itself, and wrote nothing to the recording"] * notes


def test_where_nothing_is_recorded_no_environment_is_asked_for_it() -> None:
    def make() -> Any:
        environment: Any = physical()
        environment.records_itself = True
        return environment

    assert recording_findings(run(make), Recorder()).notes == []


def test_watchers_look_when_they_want_to() -> None:
    class Watcher:
        next_time_s = 0.0

        def __init__(self) -> None:
            self.times: list[float] = []

        def watch(self, environment: Any, time_s: float) -> None:
            self.times.append(time_s)
            self.next_time_s += 0.25

    watcher = Watcher()
    run(watchers=[watcher])
    assert watcher.times == pytest.approx([0.0, 0.25, 0.5, 0.75, 1.0])


@pytest.mark.parametrize(("code", "raises"), [(None, False), (0, False), (2, True), ("oh", True)])
def test_exit_codes(code: Any, raises: bool) -> None:
    def make_agent(environment: Any) -> Any:
        def agent(timestep: Any) -> Any:
            raise SystemExit(code)

        return agent

    if raises:
        with pytest.raises(SystemExit):
            run(agent=make_agent)
    else:
        assert run(agent=make_agent).ended_by == "agent"
