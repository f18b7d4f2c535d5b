"""Requirements in real physics: small models, whole runs of the loop."""

import itertools
import pickle
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from dm_control import mujoco
from dm_control.rl import control
from helpers.stop_flags import StopFlag

from prefect_robomaker.schemas.runs.plan import ApplicationPlan, Requirement, RunPlan, RunResult
from prefect_robomaker.schemas.runs.requirement_kinds.goal import GoalRequirement
from prefect_robomaker.schemas.runs.requirements import parse_requirements
from prefect_robomaker.schemas.wire.errors import LaunchError
from prefect_robomaker.tasks.runtime.applications.indoor_navigation.environment import (
    make_environment as indoor_navigation,
)
from prefect_robomaker.tasks.runtime.episode.physics import robot_body
from prefect_robomaker.tasks.runtime.episode.run_results import make_result
from prefect_robomaker.tasks.runtime.process.run_loop import run_episode
from prefect_robomaker.tasks.runtime.recording.recording import Recorder
from prefect_robomaker.tasks.runtime.requirements.observer import RequirementsObserver

MODEL = """
<mujoco>
  <option timestep="0.002" integrator="implicitfast"/>
  <worldbody>
    <geom name="ground" type="plane" size="9 9 .1"/>
    <geom name="rug" type="box" size=".3 .3 .004" pos=".8 0 .004"/>
    <geom name="wall.north" type="box" size=".1 2 .5" pos="2 0 .5"/>
    <body name="ball" pos="0 -4 .3"><freejoint/><geom size=".3"/></body>
    <body name="car" pos="0 0 .2">
      <joint name="x" type="slide" axis="1 0 0" damping="1"/><joint name="y" type="slide" axis="0 1 0" damping="1"/>
      <geom name="hull" type="sphere" size=".15" mass="1"/>
      <body name="mast" pos="0 0 .5"><geom name="mast" type="capsule" size=".02 .1" contype="0" conaffinity="0"/></body>
    </body>
  </worldbody>
  <actuator><motor joint="x"/><motor joint="y"/></actuator>
</mujoco>
"""  # fmt: skip
FLYING = """
<mujoco>
  <option gravity="0 0 0"/>
  <worldbody>
    <body name="rock" pos="0 1 0"><freejoint/><geom size=".1"/></body>
    <body name="drone" pos="0 0 0"><freejoint/><geom size=".1" mass="1"/><site name="push"/></body>
  </worldbody>
  <actuator><motor site="push" gear="1 0 0 0 0 0"/></actuator>
</mujoco>
"""


class Task(control.Task):
    """Applies the action as it is."""

    def initialize_episode(self, physics: Any) -> None: ...

    def before_step(self, action: Any, physics: Any) -> None:
        physics.set_control(action)

    def action_spec(self, physics: Any) -> Any:
        return mujoco.action_spec(physics)

    def get_observation(self, physics: Any) -> Any:
        return {}

    def get_reward(self, physics: Any) -> Any:
        return 0.0


def environment(model: str = MODEL, time_limit: float = 2.0, **options: Any) -> control.Environment:
    physics = mujoco.Physics.from_xml_string(model)
    return control.Environment(physics, Task(), time_limit=time_limit, control_timestep=0.02, **options)


@pytest.fixture
def judge(tmp_path: Path) -> Callable[..., RunResult]:
    def run(
        *requirements: dict[str, Any],
        make: Callable[[], Any] = environment,
        action: Any = (5.0, 0.0),
        **members: Any,
    ) -> RunResult:
        plan = RunPlan(
            job_id="sim-1", job_arn="arn:aws:robomaker:us-east-1:111122223333:simulation-job/sim-1", run_id="run-1",
            seed=1, max_duration_s=60.0, work_dir=tmp_path, output_dir=tmp_path,
            **{"requirements": [{"name": f"it-{i}", **each} for i, each in enumerate(requirements)], **members},
        )  # fmt: skip
        observer = RequirementsObserver(plan)
        agent = (lambda timestep: np.array(action)) if not callable(action) else action
        episode = run_episode(
            make, lambda environment: agent, mark=lambda phase: None, stop=StopFlag(),
            recorder=Recorder(), watchers=[observer], wall_clock=itertools.count(0.0, 1.0).__next__,
        )  # fmt: skip
        return make_result(episode, 1, [observer.close(episode.ended_by)])

    return run


def only(result: RunResult) -> Requirement:
    (requirement,) = result.requirements
    return requirement


@pytest.mark.parametrize("legacy_step", [True, False])
def test_the_force_of_a_push_is_the_motors(judge: Callable[..., RunResult], legacy_step: bool) -> None:
    """Pressed against the wall with 5 N, after a bump that is harder."""
    result = judge(
        {"kind": "no_collision", "max_force_N": 1000},
        action=(5.0, 0.0),
        make=lambda: environment(time_limit=4.0, legacy_step=legacy_step),
    )
    bump = only(result)
    assert result.verdict == "PASS"
    assert bump.value is not None
    assert bump.value > 20
    assert bump.detail.startswith(f"hardest touch {bump.value:.1f} N (wall)")
    slow = judge(
        {"kind": "no_collision", "max_force_N": 5.5},
        make=lambda: _leaning(legacy_step),
    )
    assert only(slow).value == pytest.approx(5.0, abs=0.3)


def _leaning(legacy_step: bool) -> control.Environment:
    """The car already leans on the wall."""
    return environment(MODEL.replace('body name="car" pos="0 0 .2"', 'body name="car" pos="1.75 0 .2"'), 0.3,
                       legacy_step=legacy_step)  # fmt: skip


def test_a_collision_stops_the_run_and_fails_it(judge: Callable[..., RunResult]) -> None:
    result = judge({"kind": "no_collision", "max_force_N": 2, "stop": True})
    hit = only(result)
    assert (result.verdict, result.ended_by) == ("FAIL", "requirements")
    assert hit.first_violation_s == pytest.approx(result.sim_time_s)
    assert (hit.other, hit.room) == ("wall", None)  # there is no world
    assert hit.margin is not None
    assert hit.margin < 0
    assert "Not met: it-0: hardest touch" in result.summary


def test_the_floor_and_what_is_ignored_may_be_touched(judge: Callable[..., RunResult]) -> None:
    assert judge({"kind": "no_collision", "max_force_N": 0, "ignore": ["wall"]}).verdict == "PASS"
    assert judge({"kind": "no_collision", "max_force_N": 0, "others": ["ball"]}).verdict == "PASS"


def test_clearance_is_from_surface_to_surface(judge: Callable[..., RunResult]) -> None:
    """From hull (radius 0.15 m at x=0) to the wall's face at 1.9 m: 1.75 m; the mast is only to be seen."""
    standing = only(judge({"kind": "clearance", "min_m": 1.0}, action=(0.0, 0.0)))
    assert standing.value == pytest.approx(1.75, abs=1e-3)
    assert standing.margin == pytest.approx(0.75, abs=1e-3)
    assert standing.unit == "m"
    driving = judge({"kind": "clearance", "min_m": 0.5, "period_s": 0.02, "stop": True})
    near = only(driving)
    assert (driving.verdict, driving.ended_by) == ("FAIL", "requirements")
    assert near.value == pytest.approx(0.5, abs=0.08)
    assert near.first_violation_s == pytest.approx(driving.sim_time_s)
    assert (near.other, standing.other) == ("wall", None)
    assert driving.metrics["min_clearance_m"] == near.value
    assert "from wall" in near.detail


def test_what_is_missed_before_the_robot_moves_is_not_told_as_its_fault(judge: Callable[..., RunResult]) -> None:
    far = only(judge({"kind": "clearance", "min_m": 20}))
    assert far.first_violation_s == 0
    assert far.detail.endswith("it was missed before the robot moved, so nothing that it does could have met it here")
    assert "before the robot moved" not in only(judge({"kind": "clearance", "min_m": 0.5})).detail


def test_clearance_of_chosen_things(judge: Callable[..., RunResult]) -> None:
    ball = only(judge({"kind": "clearance", "min_m": 1.0, "others": ["ball"]}, action=(0.0, 0.0)))
    assert ball.value == pytest.approx(np.hypot(4.0, 0.1) - 0.45, abs=1e-2)


def test_a_goal_ends_the_run_with_success(judge: Callable[..., RunResult]) -> None:
    result = judge({"kind": "goal", "x": 1.0, "y": 0.0, "within_m": 0.2, "period_s": 0.02, "by_s": 3, "stop": True})
    goal = only(result)
    assert (result.verdict, result.ended_by) == ("PASS", "requirements")
    assert 0.3 < result.sim_time_s < 1.0
    assert goal.value == pytest.approx(result.sim_time_s)
    assert goal.margin == pytest.approx(3 - result.sim_time_s)
    assert result.summary == f"Ended at {result.sim_time_s:.1f} s with all goals reached."


def test_what_the_environment_asks_beyond_the_goal_does_not_count(judge: Callable[..., RunResult]) -> None:
    def make() -> Any:
        made: Any = environment()
        made.run_result = lambda: {
            "verdict": "FAIL", "requirements": [{"name": "all", "satisfied": False, "detail": "not all"}]
        }  # fmt: skip
        return made

    goal = {"kind": "goal", "x": 1.0, "y": 0.0}
    reached = judge({**goal, "stop": True}, make=make)
    assert reached.verdict == "PASS"
    assert [(item.name, item.counts) for item in reached.requirements] == [("all", False), ("it-0", True)]
    assert judge(goal, make=make).verdict == "FAIL"


def test_a_goal_that_is_reached_between_the_last_check_and_the_end(judge: Callable[..., RunResult]) -> None:
    result = judge({"kind": "goal", "x": 1.0, "y": 0.0, "within_m": 0.2, "period_s": 100.0}, make=lambda: environment(
        time_limit=0.7))  # fmt: skip
    assert only(result).value == pytest.approx(0.7)


def test_environment_and_goal_see_the_robot_in_the_same_room_at_the_last_step(make_context: Any) -> None:
    """The border lies between the positions of the last step and of the physics step before it."""
    context = make_context()
    assert context.world is not None
    arena, forth = indoor_navigation(context), np.array([1.0, 0.0])
    arena.reset()
    for _ in range(12):
        arena.step(forth)
    data = arena.physics.data.ptr
    before, after = data.body(robot_body(arena.physics.model.ptr)).xpos[:2].copy(), data.qpos[:2].copy()
    ahead, middle = after - before, (before + after) / 2
    assert np.linalg.norm(ahead) > 1e-4
    along = ahead / np.linalg.norm(ahead) * 99
    aside = np.array([-along[1], along[0]])

    def half_plane(way: float) -> list[tuple[float, ...]]:
        corners = (middle + aside, middle - aside, middle - aside + way * along, middle + aside + way * along)
        return [tuple(corner.tolist()) for corner in corners]

    rooms = [
        room.model_copy(update={"polygon": half_plane(way)})
        for room, way in zip(context.world.floorplan.rooms, (-1, 1), strict=False)
    ]
    floorplan = context.world.floorplan.model_copy(update={"rooms": rooms})
    world = context.world.model_copy(update={"floorplan": floorplan})

    def act(timestep: Any) -> Any:
        if timestep.observation["visited"].all():
            raise StopIteration
        return forth

    goal = {"kind": "goal", "name": "there", "room": rooms[1].name, "by_s": 40}
    plan = context.plan.model_copy(update={"requirements": parse_requirements([goal], "requirements")})
    observer = RequirementsObserver(plan, world)
    episode = run_episode(
        lambda: indoor_navigation(replace(make_context(), world=world)), lambda environment: act,
        mark=lambda phase: None, stop=StopFlag(), recorder=Recorder(), watchers=[observer],
    )  # fmt: skip
    result = make_result(episode, 1, [observer.close(episode.ended_by)])
    assert episode.steps == 12
    assert [item.detail for item in result.requirements if item.name == "there"] == [
        f"{rooms[1].name} reached at 0.60 s, 40 s asked for"
    ]


@pytest.mark.parametrize("model", [MODEL, FLYING])
@pytest.mark.parametrize("legacy_step", [True, False])
def test_a_goal_sees_the_position_of_the_last_step(
    judge: Callable[..., RunResult], model: str, legacy_step: bool
) -> None:
    def make() -> control.Environment:
        return environment(model, time_limit=0.7, legacy_step=legacy_step)

    arena = make()
    timestep = arena.reset()
    action = np.eye(arena.action_spec().shape[0])[0] * 5
    while not timestep.last():
        timestep = arena.step(action)
    x = float(arena.physics.data.ptr.qpos[7])  # behind the free joint of ball or rock
    assert x > 0.1
    goal = {"kind": "goal", "x": x + 0.05, "y": 0.0, "within_m": 0.05 + 1e-9}
    assert only(judge(goal, make=make, action=action)).value == pytest.approx(0.7)


def test_a_time_limit(judge: Callable[..., RunResult]) -> None:
    stopped = judge({"kind": "time_limit", "limit_s": 0.5, "stop": True})
    assert (stopped.verdict, stopped.ended_by) == ("FAIL", "requirements")
    assert stopped.sim_time_s == pytest.approx(0.52)
    assert judge({"kind": "time_limit", "limit_s": 2.0}).verdict == "PASS"
    assert only(judge({"kind": "time_limit", "limit_s": 1.9})).margin == pytest.approx(-0.1)


RULES = """
import numpy as np
def slow(environment, time_s):
    speed = environment.physics.data.qvel[6]
    return np.bool_(speed < 2), f"{speed:.1f} m/s"
def yes(environment, time_s):
    return True
def broken(environment, time_s):
    return 1 / 0
def odd(environment, time_s):
    return "yes"
"""


@pytest.fixture
def bundle(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    name = f"rules_{tmp_path.name.replace('-', '_')}"
    (tmp_path / "bundle").mkdir()
    (tmp_path / "bundle" / f"{name}.py").write_text(RULES)
    monkeypatch.syspath_prepend(str(tmp_path / "bundle"))
    plan = ApplicationPlan(role="robot", name="driver", attribute=f"{name}.yes", path=tmp_path / "bundle")
    return {"name": name, "robot_application": plan}


def test_a_predicate_of_the_application(judge: Callable[..., RunResult], bundle: dict[str, Any]) -> None:
    name = bundle.pop("name")
    failed = only(judge({"kind": "predicate", "attribute": f"{name}.slow", "period_s": 0.1}, **bundle))
    assert not failed.satisfied
    assert failed.error is None
    assert failed.first_violation_s is not None
    assert failed.detail.startswith(f"{name}.slow did not hold at {failed.first_violation_s:.2f} s: 2.")
    assert judge({"kind": "predicate", "attribute": f"{name}.yes"}, **bundle).verdict == "PASS"


@pytest.mark.parametrize(
    ("function", "why"), [("broken", "raised ZeroDivisionError: division by zero"), ("odd", "returned yes; a bool")]
)
def test_a_broken_predicate_is_an_error_and_no_failure(
    judge: Callable[..., RunResult], bundle: dict[str, Any], function: str, why: str
) -> None:
    name = bundle.pop("name")
    result = judge(
        {"kind": "predicate", "attribute": f"{name}.{function}"}, {"kind": "time_limit", "limit_s": 0.1}, **bundle
    )
    assert result.verdict == "ERROR"
    assert result.ended_by == "environment"
    broken, late = result.requirements
    assert why in (broken.error or "")
    assert (late.satisfied, late.error) == (False, None)


def test_the_environments_own_requirements(judge: Callable[..., RunResult]) -> None:
    def make() -> Any:
        made: Any = environment()
        made.requirements = lambda: [
            GoalRequirement(kind="goal", name="home", x=0, y=0),
            {"kind": "time_limit", "name": "it-0", "limit_s": 0.1},
        ]
        return made

    result = judge({"kind": "time_limit", "limit_s": 100}, make=make)
    assert [(item.name, item.satisfied) for item in result.requirements] == [("home", True), ("it-0", True)]
    assert result.verdict == "PASS"


@pytest.mark.parametrize(("name", "verdict"), [("late", "PASS"), ("lat", "ERROR")])
def test_one_of_the_environments_own_requirements_is_switched_off_by_its_name(
    judge: Callable[..., RunResult], name: str, verdict: str
) -> None:
    def make() -> Any:
        made: Any = environment()
        made.requirements = lambda: [{"kind": "time_limit", "name": "late", "limit_s": 0.05}]
        return made

    assert judge({"kind": "time_limit", "name": "quick", "limit_s": 100}, make=make).verdict == "FAIL"
    result = judge({"kind": "off", "name": name}, {"kind": "time_limit", "name": "quick", "limit_s": 100}, make=make)
    assert result.verdict == verdict
    [off] = [item for item in result.requirements if item.kind == "off"]
    assert off.counts == (name == "lat")


def test_the_robot_is_what_acts_what_is_named_or_what_the_environment_says(judge: Callable[..., RunResult]) -> None:
    away = {"kind": "goal", "x": 0.0, "y": 1.0, "within_m": 0.3}

    def drone(**members: Any) -> bool:
        def make() -> Any:
            made = environment(FLYING, 0.1)
            for name, value in members.items():
                setattr(made, name, value)
            return made

        return only(judge(away, make=make, action=(0.0,))).satisfied

    assert not drone()
    assert drone(robot_body="rock")
    made = {**away, "body": "rock"}
    assert only(judge(made, make=lambda: environment(FLYING, 0.1), action=(0.0,))).satisfied


@pytest.mark.parametrize(
    ("requirement", "words"),
    [
        ({"kind": "goal", "x": 0.0, "y": 0.0, "body": "cart"}, "the model has no body 'cart'; did you mean 'car'"),
        ({"kind": "goal", "room": "Hall"}, "it asks for the room 'Hall', but there is no world"),
        ({"kind": "predicate", "attribute": "no_such_package_9.f"}, "there is no installed package no_such_package_9"),
    ],
)
def test_what_cannot_be_judged_fails_the_job_at_once(
    judge: Callable[..., RunResult], requirement: dict[str, Any], words: str
) -> None:
    with pytest.raises(LaunchError, match=words) as caught:
        judge(requirement)
    assert caught.value.failure_code == "InvalidInput"


def test_an_environment_that_asks_for_nonsense(judge: Callable[..., RunResult]) -> None:
    def make() -> Any:
        made: Any = environment()
        made.requirements = lambda: [{"kind": "time_limit", "name": "x", "limit": 3}]
        return made

    with pytest.raises(LaunchError, match=r"environment.requirements\(\)\[0\].limit: is not known"):
        judge(make=make)


def test_an_environment_without_physics_cannot_be_judged(judge: Callable[..., RunResult]) -> None:
    def make() -> Any:
        inner = environment(time_limit=0.1)
        return SimpleNamespace(reset=inner.reset, step=inner.step, close=lambda: None)

    result = judge({"kind": "time_limit", "limit_s": 5}, make=make)
    assert result.verdict == "ERROR"
    assert only(result).error == "the environment has no `physics` to judge it by"


def test_judging_does_not_change_the_run(judge: Callable[..., RunResult]) -> None:
    def end(*requirements: dict[str, Any]) -> bytes:
        made = environment(time_limit=1.0)
        judge(*requirements, make=lambda: made)
        return made.physics.get_state().tobytes()

    everything = [
        {"kind": "no_collision", "max_force_N": 1},
        {"kind": "clearance", "min_m": 0.1, "period_s": 0.02},
        {"kind": "goal", "x": 3.0, "y": 0.0},
        {"kind": "time_limit", "limit_s": 5},
    ]
    assert end() == end(*everything)


def test_nothing_is_asked_for(judge: Callable[..., RunResult]) -> None:
    result = judge()
    assert (result.verdict, result.requirements) == ("NONE", [])


def test_actuators_tell_who_acts() -> None:
    assert robot_body(mujoco.Physics.from_xml_string(MODEL).model.ptr) == 2
    assert robot_body(mujoco.Physics.from_xml_string(FLYING).model.ptr) == 2


def test_a_run_that_is_continued_is_judged_as_a_whole(tmp_path: Path) -> None:
    """Half of the run is seen by one observer, half by another in another process."""
    requirements: Any = [
        {"kind": "goal", "name": "start", "x": 0.0, "y": 0.0, "within_m": 0.1},
        {"kind": "goal", "name": "later", "x": 1.0, "y": 0.0, "within_m": 0.3, "after": "start"},
        {"kind": "no_collision", "name": "soft", "max_force_N": 1000.0},
    ]
    plan = RunPlan(
        job_id="sim-1", job_arn="arn:aws:robomaker:us-east-1:111122223333:simulation-job/sim-1", run_id="run-1",
        seed=1, max_duration_s=60.0, work_dir=tmp_path, output_dir=tmp_path, requirements=requirements,
    )  # fmt: skip
    made = environment()
    made.reset()
    first = RequirementsObserver(plan)
    observer = first
    for step in range(50):
        made.step(np.array((5.0, 0.0)))
        time_s = made.physics.time()
        if time_s >= observer.next_time_s - 1e-6:
            observer.watch(made, time_s)
        if step == 15:
            kept = pickle.dumps(observer.state())
            observer = RequirementsObserver(plan)
            observer.restore(pickle.loads(kept), made)
    judged = observer.close("agent").requirements
    assert [item.satisfied for item in judged] == [True, True, True]
    assert [item.satisfied for item in first.close("agent").requirements] != [True, True, True]


def test_without_requirements_nothing_is_asked_again(tmp_path: Path) -> None:
    plan = RunPlan(
        job_id="sim-1", job_arn="arn:aws:robomaker:us-east-1:111122223333:simulation-job/sim-1", run_id="run-1",
        seed=1, max_duration_s=60.0, work_dir=tmp_path, output_dir=tmp_path,
    )  # fmt: skip
    observer = RequirementsObserver(plan)
    observer.watch(environment(), 0.0)
    assert observer.next_time_s == float("inf")
