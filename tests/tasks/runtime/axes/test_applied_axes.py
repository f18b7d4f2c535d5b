"""Axes in the built-in environment: each value changes what robots do or see, the neutral one changes nothing."""

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from helpers.robot_stands import CART_MAPPING, PLANAR, PLANAR_MAPPING, write_robot

from prefect_robomaker.schemas.runs.axes import AXIS_KINDS, AxisSetting, subject_of
from prefect_robomaker.schemas.runs.axis_kinds.kind import AxisError, why_not_applicable
from prefect_robomaker.tasks.runtime.applications.indoor_navigation.environment import make_environment
from prefect_robomaker.tasks.runtime.axes.imperfections import OdometryDrift, OdometryErrors
from prefect_robomaker.tasks.runtime.axes.variation import Variation
from prefect_robomaker.tasks.runtime.episode.context import ActionError
from prefect_robomaker.tasks.runtime.states.digest import digest_of_model

NEUTRAL_AND_OTHER = {
    "robot_mass": (1.0, 1.3),
    "robot_friction": (1.0, 0.05),
    "motor_gain": (1.0, 0.5),
    "first_motor_gain": (1.0, 0.5),
    "motor_delay_s": (0.0, 0.004),
    "command_gain": (1.0, 0.9),
    "turn_gain": (1.0, -1.0),
    "wheel_slip": (0.0, 0.1),
    "odometry_drift_std_m": (0.0, 0.02),
    "lidar_noise_std_m": (0.005, 0.006),
    "lidar_noise_factor": (1.0, 10.0),
    "lidar_bias_m": (0.0, 0.001),
    "lidar_dropout": (0.0, 0.1),
    "lidar_latency_s": (0.0, 0.01),
}
OF_THE_MODEL = ("robot_mass", "robot_friction", "motor_gain", "first_motor_gain")
NO_EFFECT = {("planar", "robot_friction"), ("planar", "wheel_slip"), ("walker", "wheel_slip")}
"""The base of the planar one hovers; neither has wheels."""

MakeRobot = Callable[[str], Any]


@pytest.fixture
def make_robot(make_context: Any, tmp_path: Path) -> MakeRobot:
    """Makes the environment of a robot, and returns the environment with its context."""

    def make(name: str) -> Any:
        context = make_context(environment={} if name == "cart" or name == "planar" else {"ROBOMAKER_ROBOT": name})
        if name == "cart":
            robot = write_robot(tmp_path / "cart", CART_MAPPING)
            context = replace(context, plan=context.plan.model_copy(update={"robot_application": robot}))
        if name == "planar":
            robot = write_robot(tmp_path / "planar", PLANAR_MAPPING, cart_xml=PLANAR)
            context = replace(context, plan=context.plan.model_copy(update={"robot_application": robot}))
        return make_environment(context), context

    return make


def trace(environment: Any, context: Any, variation: Variation | None = None, steps: int = 24) -> bytes:
    """All states and observations of an episode in which the robot is driven around."""
    environment.renew(replace(context, rng=np.random.default_rng(4)))
    seen = [environment.reset()]
    if variation is not None:
        variation.watch(environment, 0.0)
    model, data = environment.physics.model.ptr, environment.physics.data.ptr
    state = np.zeros(mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_INTEGRATION))
    found = []
    for step in range(steps):
        seen.append(environment.step(np.array((0.4, 1.5) if step < 12 else (0.0, -1.5))))
        mujoco.mj_getState(model, data, state, mujoco.mjtState.mjSTATE_INTEGRATION)
        found.append(state.tobytes())
        found += [np.asarray(value).tobytes() for value in seen[-1].observation.values()]
    if variation is not None:
        variation.last_look(environment)
    return b"".join(found)


def test_every_kind_of_number_is_tried_here() -> None:
    assert set(NEUTRAL_AND_OTHER) == {name for name, kind in AXIS_KINDS.items() if kind.is_number}


@pytest.mark.parametrize("robot", ["scout", "walker", "cart", "planar"])
def test_values_change_episodes_and_neutral_ones_do_not(make_robot: MakeRobot, robot: str) -> None:
    environment, context = make_robot(robot)
    plain, model = trace(environment, context), digest_of_model(environment.physics.model.ptr)
    for kind, (neutral, other) in NEUTRAL_AND_OTHER.items():
        if (robot, kind) in NO_EFFECT:
            continue
        variation = Variation({"axis": kind})
        variation.applied(environment, {"axis": AxisSetting(kind=kind, value=neutral)})
        assert trace(environment, context, variation) == plain, kind
        assert digest_of_model(environment.physics.model.ptr) == model, kind

        variation.set({"axis": AxisSetting(kind=kind, value=other)})
        changed = trace(environment, context, variation)
        assert changed != plain, kind
        assert (digest_of_model(environment.physics.model.ptr) != model) == (kind in OF_THE_MODEL), kind
        assert trace(environment, context, variation) == changed, kind

        variation.set({})  # a cell that does not name it
        assert trace(environment, context, variation) == plain, kind
        assert digest_of_model(environment.physics.model.ptr) == model, kind


def test_an_episode_after_another_value_is_that_of_a_fresh_environment(make_robot: MakeRobot) -> None:
    subjects = {subject_of(kind): kind for kind in NEUTRAL_AND_OTHER}  # of which a job has one axis each
    kinds = {kind: kind for kind in subjects.values()}
    wanted = {kind: AxisSetting(kind=kind, value=NEUTRAL_AND_OTHER[kind][1]) for kind in kinds}
    environment, context = make_robot("scout")
    fresh = trace(Variation(kinds).applied(environment, wanted), context)

    environment, context = make_robot("scout")
    variation = Variation(kinds)
    variation.applied(environment, {"robot_mass": AxisSetting(kind="robot_mass", value=0.3)})
    trace(environment, context)
    variation.set(
        {
            kind: AxisSetting(kind=kind, value=1.0)
            for kind in (subjects["force of motors"], "lidar_latency_s", "turn_gain")
        }
    )
    trace(environment, context)
    variation.set(wanted)

    assert trace(environment, context) == fresh


@pytest.mark.parametrize(
    ("robot", "kind", "said"),
    [
        (
            "planar",
            "robot_friction",
            "axis: robot_friction cannot be applied: the robot cannot fall, and is held where",
        ),
        ("walker", "wheel_slip", "axis: wheel_slip cannot be applied: the robot has no wheels on two sides"),
    ],
)
def test_what_cannot_have_an_effect_is_refused(make_robot: MakeRobot, robot: str, kind: str, said: str) -> None:
    environment, _ = make_robot(robot)
    with pytest.raises(AxisError, match=said):
        Variation({"axis": kind}).applied(environment, {})


def test_a_robot_without_a_lidar_has_no_axes_of_one(make_context: Any, tmp_path: Path) -> None:
    blind = {**CART_MAPPING, "sensors": {}}
    context = make_context()
    plan = context.plan.model_copy(update={"robot_application": write_robot(tmp_path / "blind", blind)})
    environment = make_environment(replace(context, plan=plan))
    for kind in (name for name in NEUTRAL_AND_OTHER if name.startswith("lidar")):
        with pytest.raises(AxisError) as raised:
            Variation({"eye": kind}).applied(environment, {})
        assert str(raised.value) == f"trials.axes.eye: {kind} cannot be applied: the robot has no lidar"
        assert why_not_applicable(str(raised.value)) == "the robot has no lidar"
    assert why_not_applicable("trials.axes: eye (lidar_dropout) cannot be applied: its model is another one") == ""


def test_errors_of_the_lidar_are_as_large_as_they_say(make_robot: MakeRobot) -> None:
    environment, context = make_robot("scout")

    def scan(**errors: float) -> Any:
        variation = Variation({name: name for name in errors})
        variation.applied(environment, {name: AxisSetting(kind=name, value=value) for name, value in errors.items()})
        environment.renew(replace(context, rng=np.random.default_rng(4)))
        environment.reset()
        steps = [environment.step((0.0, 0.0)) for _ in range(4)]  # until the second scan
        variation.set({})
        return steps[-1].observation["scan"].astype(np.float64)

    true = scan(lidar_noise_std_m=0)
    seen = np.isfinite(true)
    assert seen.sum() > 200
    assert (scan(lidar_noise_std_m=0.02)[seen] - true[seen]).std() == pytest.approx(0.02, rel=0.15)
    assert scan(lidar_noise_std_m=0, lidar_bias_m=0.1)[seen] - true[seen] == pytest.approx(0.1, abs=1e-5)
    few = scan(lidar_noise_std_m=0, lidar_dropout=0.25)
    assert np.isfinite(few)[seen].mean() == pytest.approx(0.75, abs=0.07)
    # The rays that are left have the noise that they have without dropout, so that trials can be compared in pairs.
    left = np.isfinite(few) & seen
    assert np.array_equal(scan(lidar_noise_std_m=0.02, lidar_dropout=0.25)[left], scan(lidar_noise_std_m=0.02)[left])
    assert not np.isfinite(scan(lidar_dropout=1)).any()


@pytest.mark.parametrize(("latency_s", "late_s"), [(0.0, 0.0), (0.01, 0.05), (0.05, 0.05), (0.3, 0.3)])
def test_scans_come_late_and_say_when_they_were_measured(
    make_robot: MakeRobot, latency_s: float, late_s: float
) -> None:
    environment, context = make_robot("scout")
    axis = {"late": AxisSetting(kind="lidar_latency_s", value=latency_s)}
    Variation({"late": "lidar_latency_s"}).applied(environment, axis)
    environment.renew(context)
    steps = [environment.reset()] + [environment.step((0.2, 0.1)) for _ in range(30)]

    times = [(float(each.observation["time"]), float(each.observation["scan_time"])) for each in steps]
    first_seen = {measured: time for time, measured in reversed(times)}
    assert first_seen.pop(0.0) == 0.0  # it has stood there before
    assert len(first_seen) > 4
    for measured, time in first_seen.items():
        assert time - measured == pytest.approx(late_s, abs=1e-6)


@pytest.mark.parametrize(("delay_s", "waits_s"), [(0.0, 0.0), (0.01, 0.01), (0.011, 0.02), (0.12, 0.12)])
def test_commands_wait(make_robot: MakeRobot, delay_s: float, waits_s: float) -> None:
    environment, context = make_robot("scout")
    Variation({"slow": "motor_delay_s"}).applied(
        environment, {"slow": AxisSetting(kind="motor_delay_s", value=delay_s)}
    )
    environment.renew(context)
    environment.reset()
    physics = environment.physics
    moved: list[float] = []
    look = physics.between_substeps

    def look_and_note() -> None:
        look()
        if np.abs(physics.data.ptr.ctrl).max() > 0:
            moved.append(physics.data.ptr.time)

    physics.between_substeps = look_and_note
    for _ in range(6):
        action = np.array((0.3, 0.0))
        environment.step(action)
        action[:] = 0.0  # the array is the agent's own
    assert moved[0] == pytest.approx(max(waits_s, 0.01), abs=1e-9)


def test_a_swapped_robot_turns_the_other_way_and_an_idle_one_stays(make_robot: MakeRobot) -> None:
    environment, context = make_robot("scout")

    def moved(**values: float) -> Any:
        variation = Variation({name: name for name in values})
        variation.applied(environment, {name: AxisSetting(kind=name, value=value) for name, value in values.items()})
        environment.renew(replace(context, rng=np.random.default_rng(4)))
        step = environment.reset()
        start = step.observation["pose"]
        for _ in range(12):
            step = environment.step((0.3, 1.0))
        variation.set({})
        x, y, yaw = step.observation["pose"] - start
        return np.array((x, y, math.remainder(yaw, math.tau)))

    plain, swapped, idle = moved(), moved(turn_gain=-1), moved(command_gain=0)
    assert plain[2] > 0.2
    assert swapped[2] == pytest.approx(-plain[2], rel=0.01)
    assert np.hypot(*swapped[:2]) == pytest.approx(np.hypot(*plain[:2]), rel=0.01)
    assert idle == pytest.approx([0, 0, 0], abs=1e-3)
    environment.reset()
    for wrong in ("left", (1.0, 2.0, 3.0), (np.nan, 0.0)):
        environment.command_gains.whole = 0.5
        environment.reset()
        with pytest.raises(ActionError):
            environment.step(wrong)


def test_a_robot_without_a_turning_rate_has_none_to_swap(make_context: Any, tmp_path: Path) -> None:
    mapping = {**CART_MAPPING, "drive": {"kind": "actuators"}}
    context = make_context()
    plan = context.plan.model_copy(update={"robot_application": write_robot(tmp_path / "raw", mapping)})
    environment = make_environment(replace(context, plan=plan))
    with pytest.raises(AxisError, match="swap: turn_gain cannot be applied: the robot is commanded no turning rate"):
        Variation({"swap": "turn_gain"}).applied(environment, {})
    Variation({"idle": "command_gain"}).applied(environment, {})


def driven(environment: Any, context: Any, kind: str, value: float, seed: int = 4, steps: int = 80) -> Any:
    """The last observation of a robot that drove straight on, and its true place."""
    variation = Variation({"axis": kind})
    variation.applied(environment, {"axis": AxisSetting(kind=kind, value=value)})
    environment.renew(replace(context, rng=np.random.default_rng(seed)))
    step = environment.reset()
    for _ in range(steps):
        step = environment.step(np.array((0.2, 0.0)))
    x, y, *_ = environment.physics.data.ptr.qpos[:2].tolist()
    return step.observation, np.array((x, y))


def test_wheels_that_slip_turn_farther_than_the_robot_drives(make_robot: MakeRobot) -> None:
    environment, context = make_robot("scout")
    plain, place = driven(environment, context, "wheel_slip", 0.0)
    slipping, short = driven(environment, context, "wheel_slip", 0.4)

    assert np.hypot(*short) == pytest.approx(0.6 * np.hypot(*place), rel=0.05)
    assert slipping["wheel_velocity"] == pytest.approx(plain["wheel_velocity"], rel=0.05)
    assert slipping["velocity"][0] == pytest.approx(0.6 * plain["velocity"][0], rel=0.05)


def test_wheels_slip_at_full_speed_too(make_robot: MakeRobot) -> None:
    """A factor on commands would be lost where the robot limits them."""
    environment, context = make_robot("scout")
    environment.renew(replace(context, rng=np.random.default_rng(4)))
    speeds = []
    for slip in (0.0, 0.3):
        Variation({"axis": "wheel_slip"}).applied(environment, {"axis": AxisSetting(kind="wheel_slip", value=slip)})
        environment.reset()
        speeds.append(max(environment.step(np.array((9.0, 0.0))).observation["velocity"][0] for _ in range(20)))

    assert speeds[1] < 0.8 * speeds[0]


def test_a_pose_that_drifts_wanders_off_with_the_way_and_not_with_the_time(make_robot: MakeRobot) -> None:
    environment, context = make_robot("scout")

    def error(seed: int, steps: int, drift: float = 0.1) -> float:
        observation, place = driven(environment, context, "odometry_drift_std_m", drift, seed, steps)
        return float(np.hypot(*(observation["pose"][:2] - place)))

    assert error(1, 40, drift=0.0) == 0.0
    assert error(1, 40) == error(1, 40)  # the same seed drifts the same way
    assert abs(error(1, 40) - error(2, 40)) > 0.05 * error(1, 40)  # and another seed another one
    near, far = ([error(seed, steps) for seed in range(12)] for steps in (10, 90))
    assert np.mean(far) > 1.5 * np.mean(near)
    _, place = driven(environment, context, "odometry_drift_std_m", 0.1, 1, 60)
    _, plain = driven(environment, context, "odometry_drift_std_m", 0.0, 1, 60)
    assert place.tolist() == plain.tolist()  # what the robot is told changes nothing of how it drives by itself


def test_a_robot_that_stands_does_not_drift() -> None:
    drift = OdometryDrift(OdometryErrors(drift_std_m=0.3), np.random.default_rng(1))
    first = drift.told(0.0, 0.0, 0.0)
    moved = drift.told(1.0, 0.0, 0.0)

    assert first == (0.0, 0.0, 0.0)
    assert moved != (1.0, 0.0, 0.0)
    assert drift.told(1.0, 0.0, 0.0) == moved
    kept = drift.state()
    ahead = drift.told(2.0, 0.0, 0.5)
    drift.restore(kept)
    assert drift.told(2.0, 0.0, 0.5) == ahead


def test_drift_is_as_large_as_it_says_after_a_metre() -> None:
    ends = []
    for seed in range(400):
        drift = OdometryDrift(OdometryErrors(drift_std_m=0.2), np.random.default_rng(seed))
        told = [drift.told(float(place), 0.0, 0.0) for place in np.linspace(0, 1, 21)]  # in however many steps
        x, y, yaw = told[-1]
        ends.append((x - 1.0, y, yaw))

    assert np.std(ends, axis=0) == pytest.approx([0.2, 0.2, 0.2], rel=0.15)
