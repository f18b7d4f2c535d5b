"""The rig of a model: what axes scale there, against models that were compiled so, and environments that lose it."""

import copy
from types import SimpleNamespace
from typing import Any

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from prefect_robomaker.schemas.runs.axes import AxisSetting
from prefect_robomaker.schemas.runs.axis_kinds.kind import AxisError
from prefect_robomaker.tasks.runtime.axes.variation import Variation

MODEL = """<mujoco><statistic meaninertia="7"/><worldbody>
<geom type="plane" size="5 5 1" friction="{floor} 0.01 0.001"/>
<body name="crate" pos="2 0 0.2"><freejoint/><geom size=".1" mass="1"/></body>
<body name="cart" pos="0 0 .1"><freejoint/><geom type="box" size=".2 .1 .05" mass="{body}" friction="0.3 0.005 0.0001"/>
<camera name="eye" mode="trackcom" pos="0 0 1"/>
<body name="wheel" pos="0 .1 0"><joint name="wheel" axis="0 1 0" actuatorfrcrange="-{limit} {limit}"/>
<geom name="wheel" size=".1" mass="{wheel}"/></body>
<body name="arm" pos="0 0 .1"><joint name="lift" axis="0 1 0"/><geom size=".05" pos=".3 0 0" mass="{wheel}"/></body>
</body></worldbody>
<actuator><velocity name="wheel" joint="wheel" kv="{gain}" forcerange="-{force} {force}"/>
<position name="lift" joint="lift" kp="{gain}" kv="{gain}"/></actuator></mujoco>"""
BUILT = {"floor": 0.9, "body": 2.0, "wheel": 0.5, "limit": 3.0, "gain": 1.5, "force": 2.0}


def model_of(**changes: float) -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(MODEL.format(**{**BUILT, **changes}))


def environment_of(model: mujoco.MjModel) -> Any:
    return SimpleNamespace(physics=SimpleNamespace(model=model, data=mujoco.MjData(model)))


def fields_of(model: mujoco.MjModel) -> dict[str, Any]:
    values = {name: getattr(model, name) for name in dir(model) if not name.startswith("_")}
    return {name: value.copy() for name, value in values.items() if isinstance(value, np.ndarray)}


def applied(kind: str, value: float) -> tuple[Any, Variation]:
    environment = environment_of(model_of())
    variation = Variation({"axis": kind})
    variation.applied(environment, {"axis": AxisSetting(kind=kind, value=value)})
    return environment, variation


@given(st.floats(0.1, 10))
def test_a_heavier_robot_is_the_one_that_would_have_been_compiled(factor: float) -> None:
    found = applied("robot_mass", factor)[0].physics.model
    compiled = fields_of(model_of(body=2.0 * factor, wheel=0.5 * factor))
    for name, value in fields_of(found).items():
        assert value == pytest.approx(compiled[name], rel=1e-9, abs=1e-12, nan_ok=True), name
    assert found.stat.meaninertia == 7


@given(st.floats(0.1, 10))
def test_stronger_motors_are_those_that_would_have_been_compiled(factor: float) -> None:
    found = fields_of(applied("motor_gain", factor)[0].physics.model)
    scaled = {name: BUILT[name] * factor for name in ("limit", "gain", "force")}
    compiled = fields_of(model_of(**scaled))
    for name, value in found.items():
        assert value == pytest.approx(compiled[name], rel=1e-9, nan_ok=True), name


def test_a_weak_first_motor_leaves_the_others_as_they_are() -> None:
    found, built = applied("first_motor_gain", 0.5)[0].physics.model, model_of()
    assert found.actuator_gainprm[0, 0] == 0.5 * built.actuator_gainprm[0, 0]
    assert found.actuator_forcerange[0].tolist() == [-1.0, 1.0]
    assert found.jnt_actfrcrange[found.joint("wheel").id].tolist() == [-1.5, 1.5]
    assert found.actuator_gainprm[1:].tolist() == built.actuator_gainprm[1:].tolist()
    assert found.actuator_biasprm[1:].tolist() == built.actuator_biasprm[1:].tolist()


@pytest.mark.parametrize(("floor", "friction"), [(0.4, 1.0), (1.6, 1.6)])
def test_friction_is_scaled_whether_wheel_or_floor_decides_it(floor: float, friction: float) -> None:
    def of_wheel(model: mujoco.MjModel) -> float:
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        [found] = [float(each.friction[0]) for each in data.contact if set(each.geom) == {0, model.geom("wheel").id}]
        return found

    model = model_of(floor=floor)
    assert of_wheel(model) == friction
    Variation({"axis": "robot_friction"}).applied(
        environment_of(model), {"axis": AxisSetting(kind="robot_friction", value=0.5)}
    )
    assert of_wheel(model) == friction / 2


@given(st.sampled_from(["robot_mass", "robot_friction", "motor_gain"]), st.floats(0.1, 10), st.booleans())
def test_all_is_put_back_to_the_bit(kind: str, factor: float, by_neutral: bool) -> None:
    environment, variation = applied(kind, factor)
    model, built = environment.physics.model, fields_of(model_of())
    assert any(not np.array_equal(value, built[name]) for name, value in fields_of(model).items()) or factor == 1.0
    variation.set({"axis": AxisSetting(kind=kind, value=1.0)} if by_neutral else {})
    for name, value in fields_of(model).items():
        assert np.array_equal(value, built[name], equal_nan=True), name


def _made_anew(environment: Any) -> None:
    environment.physics.model = copy.copy(environment.physics.model)


def _reset(environment: Any) -> None:
    environment.physics.model.body_mass[:] = model_of().body_mass


@pytest.mark.parametrize(
    ("change", "said"),
    [(_made_anew, "has made a new model since"), (_reset, "has changed body_mass of its model since")],
)
def test_values_that_an_environment_loses_are_an_error(change: Any, said: str) -> None:
    environment, variation = applied("robot_mass", 2.0)
    variation.watch(environment, 0.0)
    change(environment)
    with pytest.raises(AxisError, match=f"trials.axes: axis .robot_mass. cannot be applied: .*{said}"):
        variation.last_look(environment)


def test_an_environment_may_have_errors_and_delays_of_its_own() -> None:
    environment = environment_of(model_of())
    environment.lidar_errors = SimpleNamespace(noise_std_m=0.03, bias_m=0.0, dropout=0.0, latency_s=0.0)
    variation = Variation({"noise": "lidar_noise_std_m"})
    variation.applied(environment, {"noise": AxisSetting(kind="lidar_noise_std_m", value=0.2)})
    assert environment.lidar_errors.noise_std_m == 0.2
    variation.set({})
    assert environment.lidar_errors.noise_std_m == 0.03
    environment.lidar_errors = SimpleNamespace(**vars(environment.lidar_errors))
    with pytest.raises(AxisError, match="the environment has changed lidar_errors since"):
        variation.watch(environment, 0.0)


PENDULUM = """<mujoco><worldbody><geom type="plane" size="5 5 1" pos="0 0 -1"/><body><joint name="j" axis="0 1 0"/>
<geom size=".1" pos=".3 0 0"/></body></worldbody><actuator>{}</actuator></mujoco>"""


def held(actuator: str, **changes: str) -> Any:
    """The environment of a pendulum with an actuator."""
    text = PENDULUM.format(actuator)
    for old, new in changes.items():
        text = text.replace(f"<{old} ", f"<{old} {new} ")
    return environment_of(mujoco.MjModel.from_xml_string(text))


@pytest.mark.parametrize(
    ("environment", "kind", "said"),
    [
        (SimpleNamespace(), "robot_mass", "has no MuJoCo physics"),
        (held(""), "robot_mass", "no body .* has actuators"),
        (held('<motor joint="j"/>'), "robot_friction",
         "held where it touches no floor"),
        (held('<motor joint="j"/>', geom='contype="0" conaffinity="0"'), "robot_friction",
         "no part of the robot can touch a floor"),
        (held('<muscle name="m" joint="j" lengthrange="0 1"/>'),
         "motor_gain", "m is neither a motor nor a servo"),
        (environment_of(model_of()), "motor_delay_s", "has no commands of a robot that axes can change"),
        (SimpleNamespace(physics=environment_of(model_of()).physics, robot_body="crate"), "motor_gain",
         "no actuator moves the robot"),
        (SimpleNamespace(physics=environment_of(model_of()).physics, robot_body="crat"), "robot_mass",
         "has no body 'crat'"),
    ],
)  # fmt: skip
def test_what_an_environment_lacks_is_said(environment: Any, kind: str, said: str) -> None:
    with pytest.raises(AxisError, match=f"trials.axes.axis: {kind} cannot be applied: .*{said}"):
        Variation({"axis": kind}).applied(environment, {})
