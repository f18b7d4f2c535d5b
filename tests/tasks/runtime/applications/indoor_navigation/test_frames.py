"""Frames of the built-in environment fit together: what the lidar sees is where the walls are."""

import re
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from helpers.robot_stands import CART, CART_MAPPING, PLANAR, PLANAR_MAPPING, write_robot
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from numpy.typing import NDArray

from prefect_robomaker.schemas.runs.plan import ApplicationPlan
from prefect_robomaker.tasks.runtime.applications.indoor_navigation.environment import make_environment
from prefect_robomaker.tasks.runtime.recording.recording import McapRecorder
from prefect_robomaker.tasks.runtime.video.camera_recorder import CameraRecorder
from prefect_robomaker.tasks.runtime.video.video_settings import CameraRecording


def matrix(transform: Any) -> NDArray[np.float64]:
    turn, place = transform.rotation, transform.translation
    flat, whole = np.zeros(9), np.eye(4)
    mujoco.mju_quat2Mat(flat, np.array((turn.w, turn.x, turn.y, turn.z)))
    whole[:3, :3], whole[:3, 3] = flat.reshape(3, 3), (place.x, place.y, place.z)
    return whole


def away_from_walls(points: NDArray[np.float64], environment: Any) -> NDArray[np.float64]:
    """Distances in m of points from the outside of the nearest fixed box."""
    model = environment.physics.model
    fixed = [geom for geom in range(model.ngeom) if model.geom_bodyid[geom] == 0]
    middle, half = model.geom_pos[fixed], model.geom_size[fixed]
    beyond = np.abs(points[:, None] - middle) - half
    outside = np.linalg.norm(np.maximum(beyond, 0), axis=2)
    return np.abs(outside + np.minimum(beyond.max(axis=2), 0)).min(axis=1)


@pytest.mark.parametrize("kind", ["scout", "planar", "walker"])
def test_scans_are_seen_where_the_walls_are(make_context: Any, tmp_path: Path, kind: str) -> None:
    if kind == "planar":
        robot = write_robot(tmp_path / "bundle", PLANAR_MAPPING, cart_xml=PLANAR)
    else:
        attribute = f"prefect_robomaker.tasks.runtime.applications.{kind}.make_agent"
        robot = ApplicationPlan(role="robot", name=kind, attribute=attribute)
    with McapRecorder(tmp_path / "r.mcap") as recorder:
        context = make_context(recorder=recorder, seed=3)
        context = replace(context, plan=context.plan.model_copy(update={"robot_application": robot}))
        environment = make_environment(context)
        environment.reset()
        for _ in range(20):
            environment.step((0.15, 0.5))

    scan, frames = None, {}
    known: dict[str, tuple[str, NDArray[np.float64]]] = {}
    with (tmp_path / "r.mcap").open("rb") as stream:
        for item in make_reader(stream, decoder_factories=[DecoderFactory()]).iter_decoded_messages(
            topics=["/tf", "/tf_static", "/scan"]
        ):
            message = item.decoded_message
            for each in getattr(message, "transforms", ()):
                known[each.child_frame_id] = (each.header.frame_id, matrix(each.transform))
            if item.channel.topic == "/scan":
                scan, frames = message, dict(known)  # of the same time, since transforms come first
    assert scan is not None
    ranges = np.array(scan.ranges)
    hits = ranges < scan.range_max
    angles = (scan.angle_min + scan.angle_increment * np.arange(len(ranges)))[hits]
    points = np.stack((np.cos(angles), np.sin(angles), np.zeros(len(angles)), np.ones(len(angles))))
    points[:2] *= ranges[hits]
    frame = scan.header.frame_id
    while frame != "map":
        frame, to_parent = frames[frame]
        points = to_parent @ points

    assert hits.sum() > 100
    assert np.percentile(away_from_walls(points[:3].T, environment), 95) < 0.03


def test_limbs_have_frames_that_cameras_can_be_fixed_to(make_context: Any, tmp_path: Path) -> None:
    walker = ApplicationPlan(
        role="robot", name="walker", attribute="prefect_robomaker.tasks.runtime.applications.walker.make_agent"
    )
    with McapRecorder(tmp_path / "r.mcap") as recorder:
        context = make_context(recorder=recorder)
        environment = make_environment(
            replace(context, plan=context.plan.model_copy(update={"robot_application": walker}))
        )
        environment.reset()
        for _ in range(4):  # until a time at which states are recorded
            environment.step((0.3, 0.2))
    model, data = environment.physics.model.ptr, environment.physics.data.ptr

    with (tmp_path / "r.mcap").open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        last = [item.decoded_message for item in reader.iter_decoded_messages(topics=["/tf"])][-1].transforms
    places = {"odom": np.eye(4)}
    for each in last:
        places[each.child_frame_id] = places[each.header.frame_id] @ matrix(each.transform)

    assert len(last) > 8
    assert set(environment.tf_frames.values()) == {"map", *(each.child_frame_id for each in last)}
    mujoco.mj_kinematics(model, data)
    for body, frame in environment.tf_frames.items():
        if body != 0:
            assert places[frame][:3, 3] == pytest.approx(data.body(body).xpos, abs=1e-9)
            assert places[frame][:3, :3] == pytest.approx(data.body(body).xmat.reshape(3, 3), abs=1e-9)


def test_a_camera_on_a_limb_without_a_name_is_fixed_to_that_limb(make_context: Any, tmp_path: Path) -> None:
    limb = '<body><joint name="lift" axis="0 -1 0" range="-1 1"/><camera name="wrist" pos="0.05 0 0"/>'
    other = '<body pos="-0.1 0 0.05"><joint name="nod" axis="0 1 0"/><geom size="0.01" mass="0.01"/></body>'
    model = CART.replace('<body name="arm" pos="0 0 0.03"><joint name="lift" axis="0 -1 0" range="-1 1"/>', limb)
    model = model.replace("</body></worldbody>", f"{other}</body></worldbody>").replace('0 0 0 0.5"', '0 0 0 0.5 0"')
    robot = write_robot(tmp_path / "bundle", CART_MAPPING, cart_xml=model)
    with McapRecorder(tmp_path / "recording.mcap") as recorder:
        context = make_context(recorder=recorder)
        plan = context.plan.model_copy(update={"robot_application": robot})
        environment = make_environment(replace(context, plan=plan))
        environment.reset()
        camera = CameraRecorder(recorder, CameraRecording(1.0, f"{environment.robot.prefix}wrist"), None)
        camera.watch(environment, 0.0)
        assert camera.close("agent").extra == {}

    with (tmp_path / "recording.mcap").open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        transforms = [
            each
            for item in reader.iter_decoded_messages(topics=["/tf_static"])
            for each in item.decoded_message.transforms
            if each.child_frame_id == "camera_link"
        ]

    limb_body = int(environment.physics.model.joint(f"{environment.robot.prefix}lift").bodyid[0])
    assert [each.header.frame_id for each in transforms] == [f"link_{limb_body}"]
    assert transforms[0].transform.translation.x == pytest.approx(0.05)


def test_an_imu_on_a_limb_turns_with_the_limb(make_context: Any, tmp_path: Path) -> None:
    """Its attitude, and its place in the tree of frames and in the URDF, are those of the limb that falls."""
    loose = re.sub("<position.*/>", "", CART)
    mapping = CART_MAPPING | {"sensors": {"lidar": {"at": "eye"}, "imu": {"at": "arm"}}}
    robot = write_robot(tmp_path / "bundle", mapping, cart_xml=loose)
    with McapRecorder(tmp_path / "r.mcap") as recorder:
        context = make_context(recorder=recorder)
        plan = context.plan.model_copy(update={"robot_application": robot})
        environment = make_environment(replace(context, plan=plan))
        environment.reset()
        started = float(environment.physics.data.joint(f"{environment.robot.prefix}lift").qpos[0])
        for _ in range(4):  # until a time at which states are recorded
            environment.step((0.0, 0.0))
    model, data = environment.physics.model.ptr, environment.physics.data.ptr
    mujoco.mj_kinematics(model, data)
    site = data.site(f"{environment.robot.prefix}arm_imu_site")
    places, urdf, attitude = {"map": np.eye(4)}, "", None
    with (tmp_path / "r.mcap").open("rb") as stream:
        known: dict[str, tuple[str, Any]] = {}
        for item in make_reader(stream, decoder_factories=[DecoderFactory()]).iter_decoded_messages():
            match item.channel.topic:
                case "/tf" | "/tf_static":
                    known |= {
                        each.child_frame_id: (each.header.frame_id, each.transform)
                        for each in item.decoded_message.transforms
                    }
                case "/robot_description":
                    urdf = item.decoded_message.data
                case "/imu":
                    turn = item.decoded_message.orientation
                    attitude = np.array((turn.w, turn.x, turn.y, turn.z))

    def placed(frame: str) -> NDArray[np.float64]:
        if frame not in places:
            places[frame] = placed(known[frame][0]) @ matrix(known[frame][1])
        return places[frame]

    assert abs(data.joint(f"{environment.robot.prefix}lift").qpos[0] - started) > 0.1, "it falls"
    assert placed("imu_link")[:3, 3] == pytest.approx(site.xpos, abs=1e-6)
    assert placed("imu_link")[:3, :3] == pytest.approx(site.xmat.reshape(3, 3), abs=1e-6)
    flat = np.zeros(9)
    assert attitude is not None
    mujoco.mju_quat2Mat(flat, attitude)
    assert flat == pytest.approx(site.xmat, abs=0.05), "readings are of the step before"
    (mount,) = [each for each in ET.fromstring(urdf).iter("joint") if each.find("child[@link='imu_link']") is not None]
    parent = mount.find("parent")
    assert parent is not None
    assert parent.get("link") == known["imu_link"][0]


def test_a_sensor_on_a_ball_joint_has_no_fixed_place(make_context: Any, tmp_path: Path) -> None:
    """The links of balls have no frames, so that a place that is told once would be wrong from then on."""
    mapping = CART_MAPPING | {"sensors": {"lidar": {"at": "eye"}, "imu": {"at": "head"}}}
    head = '<body name="head" pos="-0.05 0 0.1"><joint type="ball"/><geom size="0.01" mass="0.01"/></body>'
    model = CART.replace("</body></worldbody>", f"{head}</body></worldbody>").replace('0 0.5"', '0 0.5 1 0 0 0"')
    robot = write_robot(tmp_path / "bundle", mapping, cart_xml=model)
    with McapRecorder(tmp_path / "r.mcap") as recorder:
        context = make_context(recorder=recorder)
        make_environment(replace(context, plan=context.plan.model_copy(update={"robot_application": robot}))).reset()
    with (tmp_path / "r.mcap").open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        (fixed,) = [each.decoded_message.transforms for each in reader.iter_decoded_messages(topics=["/tf_static"])]

    assert {each.child_frame_id for each in fixed} == {"odom", "base_footprint", "base_scan"}
