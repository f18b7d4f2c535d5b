import math
import xml.etree.ElementTree as ET
from typing import Any

import mujoco
import numpy as np
import pytest

from prefect_robomaker.tasks.runtime.recording import messages as ros
from prefect_robomaker.tasks.runtime.recording.robot_description import robot_description
from prefect_robomaker.tasks.runtime.robots.scout import SCOUT
from prefect_robomaker.tasks.runtime.robots.walker import WALKER

ARM = """<mujoco><worldbody><body name="base" pos="1 2 0.3" euler="0 0 40"><freejoint/>
  <geom type="box" size=".2 .1 .05" mass="1" rgba=".1 .2 .3 1"/>
  <body name="mast" pos="0 0 .1" euler="10 20 30"><geom type="capsule" size=".02 .1" mass=".1"/>
    <body name="lift" pos=".05 0 .2" euler="0 30 0">
      <joint name="up" type="slide" axis="0 0 1" range="0 .3" limited="true"/>
      <geom type="sphere" size=".03" mass=".1"/>
      <body name="hand" pos=".1 0 0" euler="90 0 0"><joint name="turn" axis="0 1 0" ref="0.2"/>
        <geom type="cylinder" size=".02 .04" mass=".1"/></body>
      <body name="odd" pos="0 .1 0"><joint name="off" axis="0 1 0" pos=".1 0 0"/><geom size=".01" mass=".1"/></body>
    </body></body></body></worldbody></mujoco>"""


def turned(rpy: np.ndarray) -> np.ndarray:
    """The rotation of roll, pitch and yaw about fixed axes, as URDF says it."""
    (cr, sr), (cp, sp), (cy, sy) = ((math.cos(angle), math.sin(angle)) for angle in rpy)
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def numbers(element: ET.Element | None, name: str) -> np.ndarray:
    assert element is not None
    return np.array([float(number) for number in element.attrib[name].split()])


def linked(joint: ET.Element, end: str) -> str:
    """The link at one end of a joint."""
    element = joint.find(end)
    assert element is not None
    return element.attrib["link"]


def poses(urdf: ET.Element, base: str, positions: dict[str, float]) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Place and axes of each link, seen from the base, by the rules of URDF alone."""
    found = {base: (np.zeros(3), np.eye(3))}
    for joint in urdf.iter("joint"):  # parents come first
        place, axes = found[linked(joint, "parent")]
        origin = joint.find("origin")
        place, axes = place + axes @ numbers(origin, "xyz"), axes @ turned(numbers(origin, "rpy"))
        if joint.attrib["type"] != "fixed":
            axis, value = numbers(joint.find("axis"), "xyz"), positions[joint.attrib["name"]]
            if joint.attrib["type"] == "prismatic":
                place = place + axes @ axis * value
            else:
                turn, quaternion = np.zeros(9), np.zeros(4)
                mujoco.mju_axisAngle2Quat(quaternion, axis, value)
                mujoco.mju_quat2Mat(turn, quaternion)
                axes = axes @ turn.reshape(3, 3)
        found[linked(joint, "child")] = place, axes
    return found


def seen_from(data: Any, base: int, body: int) -> tuple[np.ndarray, np.ndarray]:
    turn = data.xmat[base].reshape(3, 3).T
    return turn @ (data.xpos[body] - data.xpos[base]), turn @ data.xmat[body].reshape(3, 3)


def check(model: Any, data: Any, base: int, urdf: ET.Element, bodies: dict[str, int], free: float = 1e-5) -> None:
    """Links are where MuJoCo has the bodies, for joints as `/joint_states` would tell them."""
    positions = {
        model.joint(number).name.rpartition("/")[2]: float(data.qpos[model.jnt_qposadr[number]])
        for number in range(model.njnt)
        if int(model.jnt_type[number]) in (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))
    }
    found = poses(urdf, "base_link", positions)
    for link, body in bodies.items():
        place, axes = seen_from(data, base, body)
        assert found[link][0] == pytest.approx(place, abs=free), link
        assert found[link][1] == pytest.approx(axes, abs=free), link


def test_links_are_where_the_simulation_has_them() -> None:
    model = mujoco.MjModel.from_xml_string(ARM)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    mount = ros.TransformStamped(
        ros.Header(ros.Time(0, 0), "base_link"), "base_scan", ros.Transform(ros.Vector3(0.1, 0.0, 0.2))
    )
    base = model.body("base").id
    text = robot_description("arm", model, data, base, {base: "base_link"}, {}, [mount])
    urdf = ET.fromstring(text)
    kinds = {joint.attrib["name"]: joint.attrib["type"] for joint in urdf.iter("joint")}
    assert kinds == {"up": "prismatic", "turn": "continuous", "odd_joint": "fixed", "base_scan_joint": "fixed"}
    shapes = [shape.tag for link in urdf.iter("link") for shape in link.iterfind("visual/geometry/*")]
    assert sorted(shapes) == ["box", "cylinder", "cylinder", "sphere", "sphere"]
    generator = np.random.default_rng(4)
    for _ in range(5):
        up, turn = generator.uniform(0, 0.3), generator.uniform(-3, 3)
        data.joint("up").qpos[0], data.joint("turn").qpos[0] = up, turn
        mujoco.mj_forward(model, data)
        check(model, data, base, urdf, {"lift": model.body("lift").id, "hand": model.body("hand").id})


@pytest.mark.parametrize("robot", [SCOUT, WALKER], ids=lambda robot: robot.name)
def test_the_built_in_robots_can_be_shown_by_their_joint_states(robot: Any) -> None:
    model = robot.build().compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    base = model.body(robot.base).id
    urdf = ET.fromstring(robot_description(robot.name, model, data, base, {base: "base_link"}, {}, []))
    moving = {joint.attrib["name"]: linked(joint, "child") for joint in urdf.iter("joint")}
    assert {joint.attrib["name"] for joint in urdf.iter("joint") if joint.attrib["type"] != "fixed"} >= set(
        robot.joints
    )
    generator = np.random.default_rng(5)
    for name in robot.joints:
        data.joint(name).qpos[0] = generator.uniform(-0.4, 0.4)
    mujoco.mj_forward(model, data)
    check(model, data, base, urdf, {link: model.body(link).id for name, link in moving.items() if name in robot.joints})
