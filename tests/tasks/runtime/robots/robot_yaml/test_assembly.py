import json
import logging
import math
import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, ClassVar

import mujoco
import numpy as np
import pytest
from helpers.robot_stands import CART_MAPPING, Stand, write_robot
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

from prefect_robomaker.schemas.wire.errors import ConfigurationError, LaunchError
from prefect_robomaker.tasks.runtime.applications.indoor_navigation import lidar
from prefect_robomaker.tasks.runtime.applications.indoor_navigation.environment import IndoorNavigation
from prefect_robomaker.tasks.runtime.applications.indoor_navigation.navigation_task import NavigationTask
from prefect_robomaker.tasks.runtime.applications.indoor_navigation.world_with_robot import assemble
from prefect_robomaker.tasks.runtime.episode.context import ActionError
from prefect_robomaker.tasks.runtime.process.attempt import log_failure
from prefect_robomaker.tasks.runtime.recording.recording import McapRecorder
from prefect_robomaker.tasks.runtime.robots.robot import Lidar, Robot
from prefect_robomaker.tasks.runtime.robots.robot_lookup import find_robot
from prefect_robomaker.tasks.runtime.robots.robot_yaml.assembly import _sensor
from prefect_robomaker.tasks.runtime.robots.robot_yaml.shape import SENSOR_KINDS, check_kinds
from prefect_robomaker.tasks.runtime.robots.sensors.kind import SensorKind

MakeCart = Callable[..., Robot]
DRIVE = CART_MAPPING["drive"]

PLANAR = """<mujoco><worldbody><body name="chassis" pos="1 0 0.4">
<joint name="x" type="slide" axis="1 0 0"/><joint name="y" type="slide" axis="0 1 0"/>
<geom type="cylinder" size="0.15 0.05" mass="5"/>
<body name="top" pos="0 0 0.1"><joint name="turn" axis="0 0 1"/>
<geom type="box" size="0.1 0.1 0.05" mass="3"/></body></body></worldbody>
<actuator><velocity joint="x" kv="200"/><velocity name="across" joint="y" kv="200"/><velocity joint="turn" kv="50"/>
</actuator><keyframe><key name="away" qpos="3 2 1"/></keyframe></mujoco>"""
PLANAR_DRIVE = {
    "kind": "velocity", "frame": "world", "x": "x", "y": "across", "yaw": "turn", "max_linear_mps": 0.8,
    "max_angular_radps": 1.5,
}  # fmt: skip


def test_a_differential_robot_goes_where_it_is_told_whatever_way_its_wheels_turn(make_cart: MakeCart) -> None:
    stand = Stand(make_cart())
    stand.drive((0.4, 0.0), 2.0)
    state = stand.base.read()
    assert state.linear == pytest.approx(0.4, rel=0.05)
    assert state.x == pytest.approx(0.4 * (2.0 - 0.4 / 1.2 / 2), rel=0.08)
    assert abs(state.yaw) < 0.1  # the geared wheel follows its ramp more closely
    stand.drive((0.0, 1.0), 2.0)
    assert stand.base.read().angular == pytest.approx(1.0, rel=0.08)
    stand.drive((0.0, 0.0), 1.0)
    assert abs(stand.base.read().linear) < 0.01


def test_it_starts_as_the_keyframe_and_the_mapping_say_and_servos_hold_it_there(make_cart: MakeCart) -> None:
    robot = make_cart()
    assert robot.home == {"left": 0.0, "right": 0.0, "lift": 0.5}
    other = make_cart(spawn={"height_m": 0.05, "keyframe": "up", "joints": {"lift": -0.3}})
    stand = Stand(other)
    stand.drive((0.0, 0.0), 0.5)
    assert stand.data.joint("my_cart/lift").qpos[0] == pytest.approx(-0.3, abs=0.05)


def test_observations_have_the_robots_own_joints_and_sensors(make_cart: MakeCart, make_context: Any) -> None:
    robot = make_cart()
    assert robot.joints == ("left", "right", "lift")
    assert robot.lidar is not None
    assert robot.lidar == Lidar(height_m=robot.lidar.height_m)
    assert robot.lidar.height_m == pytest.approx(0.15)
    assert robot.name == "my_cart"
    assert [list(each.names) for each in robot.sensors] == [["gyro", "acc"]]
    assert make_cart(joints=["lift"]).joints == ("lift",)
    assert make_cart(sensors={}).lidar is None


def test_range_sensors_do_not_see_the_robot_itself(make_cart: MakeCart, make_context: Any) -> None:
    robot = make_cart()
    physics = assemble(make_context().world_dir / "world.xml", robot)
    model, data = physics.model.ptr, physics.data.ptr
    body = robot.footprint_id(model)
    # In the plane of the deck, where everything of the robot would be in the way.
    finder = lidar.RangeFinder(model, data, body, 0.05, Lidar(0.05).angles_rad, 3.5, physics.unseen_group)
    assert finder.cast().min() > 0.5
    np.testing.assert_allclose(np.minimum(finder.measure(), 9.0), np.minimum(finder.cast(), 9.0), atol=1e-3)


def test_the_worlds_physics_options_count_and_the_log_says_so(
    make_cart: MakeCart, make_context: Any, caplog: pytest.LogCaptureFixture
) -> None:
    from helpers.robot_stands import CART

    text = CART.replace("<worldbody>", '<option impratio="100" gravity="0 0 -1.6"/><worldbody>', 1)
    with caplog.at_level(logging.WARNING):
        physics = assemble(make_context().world_dir / "world.xml", make_cart({"cart_xml": text}))
    assert physics.model.ptr.opt.gravity[2] == pytest.approx(-9.81)
    said = " ".join(record.getMessage() for record in caplog.records)
    assert "my_cart: physics options are those of the world" in said
    assert "impratio=100 (" in said
    assert "gravity=0 0 -1.6 (0 0 -9.81)" in said


def test_a_footprint_that_is_too_small_and_measures_that_are_off_are_told(
    make_cart: MakeCart, caplog: pytest.LogCaptureFixture
) -> None:
    with caplog.at_level(logging.WARNING):
        cart = make_cart(footprint={"radius_m": 0.1}, drive=DRIVE | {"wheel_radius_m": 0.1, "track_width_m": 0.4})
    told = [
        "robot.yaml: footprint.radius_m: the radius is 0.1 m; parts reach up to 0.15 m from the base's origin",
        "robot.yaml: drive.track_width_m is 0.4 m; in the model the wheels are 0.200 m apart",
        "robot.yaml: drive.wheel_radius_m is 0.1 m; in the model the wheels' axes are 0.050 m above the floor",
    ]
    assert [record.getMessage() for record in caplog.records] == told
    assert list(cart.warnings) == told, "for notes beside the verdict"


def test_a_mistake_in_robot_yaml_is_told_in_the_log_without_a_traceback(
    make_cart: MakeCart, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(LaunchError) as refused:
        make_cart(sensors={"lidar": {"at": "ey"}})
    log_failure(refused.value)
    said = "robot.yaml:13:15: sensors.lidar.at: there is no site or body 'ey'; did you mean 'eye'?"
    assert capsys.readouterr().err == f"{said}\n"


def test_a_round_robot_is_as_wide_as_its_circle(make_cart: MakeCart, caplog: pytest.LogCaptureFixture) -> None:
    from helpers.robot_stands import CART

    round_cart = CART.replace('type="box" size="0.12 0.08 0.02"', 'type="cylinder" size="0.16 0.02"')
    with caplog.at_level(logging.WARNING):
        make_cart({"cart_xml": round_cart}, footprint={"radius_m": 0.18})
    assert "footprint" not in caplog.text


def test_a_base_on_slides_and_a_hinge_moves_in_the_worlds_frame(make_cart: MakeCart) -> None:
    robot = make_cart(
        {"cart_xml": PLANAR},
        drive=PLANAR_DRIVE,
        spawn={"height_m": 0.1, "keyframe": "away"},  # it is the world that says where it starts
        sensors={"lidar": {"height_m": 0.3}},
        footprint={"radius_m": 0.16},
    )
    stand = Stand(robot)
    assert stand.data.body("my_cart/base_footprint_mark").xpos == pytest.approx((0, 0, 0), abs=1e-9)
    stand.drive((0.0, math.pi / 4), 2.0)
    stand.drive((0.5, 0.0), 2.0)
    state = stand.base.read()
    assert state.yaw == pytest.approx(math.pi / 2, abs=0.15)
    assert (state.linear, state.angular) == pytest.approx((0.5, 0.0), abs=0.03)
    assert state.y > 0.7
    assert abs(state.x) < 0.2


def test_actions_of_a_robot_without_a_drive_are_its_actuators_controls(make_cart: MakeCart) -> None:
    robot = make_cart(drive={"kind": "actuators"})
    stand = Stand(robot)
    spec = robot.drive.action_spec(stand.model, robot.prefix)
    assert spec.name == "left, right, lift"
    assert spec.shape == (3,)
    assert (spec.minimum[2], spec.maximum[2]) == (-1.0, 1.0)
    stand.drive((4.0, -8.0, 9.0), 1.0)
    assert stand.data.ctrl.tolist() == [4.0, -8.0, 1.0]
    assert stand.base.read().linear > 0.1
    assert stand.controller.command((0.0, 0.0, 0.0)) is False
    assert stand.controller.command((0.0, 0.0, 0.0)) is True
    wrongs: tuple[Any, ...] = ((1.0, 2.0), (1.0, 2.0, math.nan), "abc", None)
    for wrong in wrongs:
        with pytest.raises(ActionError, match="left, right, lift"):
            stand.controller.command(wrong)


@pytest.mark.parametrize(
    ("members", "message"),
    [
        ({"base": "chasis"}, "base: cart.xml has no 'chasis' among its bodies; did you mean 'chassis'?"),
        ({"base": "arm"}, "base: 'arm' hangs on other bodies; name the outermost, 'chassis'"),
        ({"drive": DRIVE | {"left": ["leftt"]}}, r"drive.left\[0\]: there is no joint or actuator 'leftt'; did you"),
        ({"drive": DRIVE | {"left": ["right"], "right": ["left"]}}, r"drive.left\[0\]: 'right' is on the other side"),
        ({"drive": DRIVE | {"left": ["lift"]}}, r"drive.left\[0\]: 'lift' is no velocity actuator"),
        ({"joints": ["left", "elbow"]}, r"joints\[1\]: there is no hinge or slide 'elbow'; it has joints left, right"),
        ({"spawn": {"height_m": 0.05, "keyframe": "down"}}, "spawn.keyframe: cart.xml has no 'down'"),
        ({"spawn": {"height_m": 0.05, "joints": {"lif": 1.0}}}, "spawn.joints: there is no hinge or slide 'lif'; did"),
        ({"sensors": {"lidar": {"at": "eyes"}}}, "sensors.lidar.at: there is no site or body 'eyes'; did you mean"),
        ({"sensors": {"lidar": {}}}, "sensors.lidar: give either at"),
        ({"sensors": {"imu": {"gyro": "acc", "accelerometer": "acc"}}}, "sensors.imu.gyro: there is no gyro 'acc'"),
        ({"sensors": {"imu": {"gyro": "gyro"}}}, "sensors.imu: give at"),
        ({"video_camera": "behind"}, "video_camera: there is no camera 'behind'"),
        ({"sliding": ["wheel"]}, r"sliding\[0\]: cart.xml has no 'wheel' among its bodies"),
        ({"actuators": [{"joint": "lift", "kind": "motor"}]}, r"actuators\[0\]: there is an actuator 'lift' already"),
        ({"actuators": [{"joint": "hip", "kind": "motor"}]}, r"actuators\[0\].joint: cart.xml has no 'hip'"),
        ({"drive": PLANAR_DRIVE | {"x": "left"}}, "drive.x: 'left' has to move a slide along the x axis"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_named_with_what_would_be_right(make_cart: MakeCart, members: Any, message: str) -> None:
    with pytest.raises(LaunchError, match=message) as error:
        make_cart(**members)
    assert re.match(r"robot\.yaml:\d+:\d+: ", str(error.value))
    assert error.value.failure_code == "InvalidBundleRobotApplication"


@pytest.mark.parametrize("sliding", [["knob_front", "knob_rear"], ["chassis"]])
def test_geoms_and_bodies_slide_whatever_the_floor_is_of(make_cart: MakeCart, sliding: list[str]) -> None:
    from helpers.robot_stands import CART

    # Without a priority MuJoCo takes the larger friction of the two, the floor's.
    sticky = CART.replace(' friction="0.01" priority="1"', ' friction="0.01"')

    def grip(robot: Robot) -> set[float]:
        stand = Stand(robot)
        stand.drive((0.0, 0.0), 0.2)
        knobs = {stand.model.geom(f"my_cart/knob_{each}").id for each in ("front", "rear")}
        touching = [each for each in stand.data.contact if knobs & set(each.geom.tolist())]
        return {round(float(each.friction[0]), 3) for each in touching}

    assert grip(make_cart({"cart_xml": sticky})) == {0.7}
    assert grip(make_cart({"cart_xml": sticky}, sliding=sliding)) == {0.01}


def test_a_wrong_name_is_told_with_its_line(tmp_path: Path) -> None:
    lines = [f"{name}: {json.dumps(value)}" for name, value in CART_MAPPING.items() if name != "drive"]
    text = "\n".join([*lines, "drive:", *(f"  {name}: {json.dumps(value)}" for name, value in DRIVE.items())])
    application = write_robot(tmp_path, text.replace('["right"]', '["right", "rigth"]'))
    line = next(number for number, each in enumerate(text.splitlines(), start=1) if "right" in each)
    wanted = rf"^robot.yaml:{line}:20: drive.right\[1\]: there is no joint .* 'rigth'; did you mean 'right'"
    with pytest.raises(LaunchError, match=wanted):
        find_robot(application, {})


def test_a_joint_without_an_actuator_says_how_to_add_one(make_cart: MakeCart) -> None:
    from helpers.robot_stands import CART

    text = CART.replace('<velocity name="left" joint="left" kv="1"/>', "")
    with pytest.raises(LaunchError, match=r"'left' has no actuator; add it: actuators: \[\{joint: left, kind: vel"):
        make_cart({"cart_xml": text})
    added = [{"joint": "left", "kind": "velocity", "gain": 1.0, "force_limit": 2.0, "armature": 0.001}]
    stand = Stand(make_cart({"cart_xml": text}, actuators=added))
    stand.drive((0.3, 0.0), 1.5)
    assert stand.base.read().linear == pytest.approx(0.3, rel=0.05)
    assert abs(stand.base.read().yaw) < 0.05


LIDAR = {
    "height_m": 0.15, "rate_hz": 10, "rays": 541, "field_of_view_deg": 270, "range_max_m": 8.0, "noise_std_m": 0.0,
}  # fmt: skip


def test_a_lidar_is_as_the_mapping_says(make_cart: MakeCart, make_context: Any, tmp_path: Path) -> None:
    robot = make_cart(sensors={"lidar": LIDAR})
    assert robot.lidar is not None
    with McapRecorder(tmp_path / "recording.mcap") as recorder:
        context = make_context(recorder=recorder)
        assert context.world is not None
        physics = assemble(context.world_dir / "world.xml", robot)
        task = NavigationTask(context.world, robot, context.rng, recorder, 60.0)
        environment = IndoorNavigation(physics, task, robot)
        environment.reset()
        observed = [environment.step((0.0, 0.5)).observation for _ in range(20)]
    assert environment.observation_spec()["scan"].shape == (541,)
    assert len({float(each["scan_time"]) for each in observed}) == 11
    expected = lidar.RangeFinder(
        physics.model.ptr, physics.data.ptr, robot.footprint_id(physics.model.ptr), 0.15,
        np.radians(-135 + 0.5 * np.arange(541)), 8.0, physics.unseen_group,
    ).cast()  # fmt: skip
    np.testing.assert_allclose(observed[-1]["scan"], expected, rtol=1e-6)
    assert 3.5 < np.max(expected, where=np.isfinite(expected), initial=0.0) <= 8.0

    with (tmp_path / "recording.mcap").open("rb") as stream:
        decoded = make_reader(stream, decoder_factories=[DecoderFactory()]).iter_decoded_messages(topics=["/scan"])
        scans = [each.decoded_message for each in decoded]
    assert len(scans) == 11
    assert (scans[0].angle_min, scans[0].angle_max) == pytest.approx((-0.75 * math.pi, 0.75 * math.pi))
    assert scans[0].angle_increment == pytest.approx(math.radians(0.5))
    assert (scans[0].scan_time, scans[0].range_max) == pytest.approx((0.1, 8.0))
    assert len(scans[0].ranges) == 541


@pytest.mark.parametrize(
    ("mounted", "reason"),
    [
        ({"height_m": 0.2, "rate_hz": 7}, r"sensors\.lidar\.rate_hz.*7"),
        ({"height_m": 0.2, "range_min_m": 4.0}, r"sensors\.lidar\.range_min_m: 4 is not below range_max_m, 3\.5"),
        ({"height_m": 0.2, "rays": 1}, r"sensors\.lidar\.rays.*1"),
    ],
)
def test_a_lidar_that_cannot_be_is_refused(make_cart: MakeCart, mounted: dict[str, float], reason: str) -> None:
    with pytest.raises(LaunchError, match=reason):
        make_cart(sensors={"lidar": mounted})


def test_sensors_of_a_model_have_to_be_on_sites() -> None:
    """Recordings take their place from there; a joint's number would be taken for a site's."""

    class Turn(SensorKind):
        name = "turn"
        parts: ClassVar[Mapping[str, str]] = {"framequat": "FRAMEQUAT"}
        framequat: str | None = None

    model = mujoco.MjModel.from_xml_string(
        '<mujoco><worldbody><body name="arm"><geom size="1"/></body></worldbody>'
        '<sensor><framequat name="q" objtype="body" objname="arm"/></sensor></mujoco>'
    )
    with pytest.raises(LaunchError, match=r"sensors\.turn\.framequat: framequat 'q' is not on a site"):
        _sensor(Turn(framequat="q"), model, "robot.yaml")


@pytest.mark.parametrize(
    ("name", "topic", "words"),
    [
        ("velocity", "", "cannot be called 'velocity': observations have it already"),
        ("scan_time", "", "cannot be called 'scan_time': observations have it already"),
        ("cameras", "", "cannot be called 'cameras': robot.yaml has it below sensors already"),
        ("of_kinds", "", "cannot be called 'of_kinds': robot.yaml has it below sensors already"),
        ("base", "", "cannot be called 'base': a frame of the robot is called so"),
        ("my sensor", "", "cannot be called 'my sensor': it has to be a name in Python"),
        ("heat", "/scan", "cannot have the topic /scan: the simulation publishes on it"),
        ("heat", "/imu", r"cannot have the topic /imu: .*\.Imu publishes on it"),
    ],
)
def test_a_kind_of_sensor_takes_nothing_from_others(name: str, topic: str, words: str) -> None:
    other = type("Other", (SensorKind,), {"name": name, "topic": topic, "__module__": "example"})

    with pytest.raises(ConfigurationError, match=rf"example\.Other {words}"):
        check_kinds([*SENSOR_KINDS.values(), other])
