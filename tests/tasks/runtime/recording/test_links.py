"""Frames of moving parts against MuJoCo's own kinematics."""

import mujoco
import numpy as np
import pytest
from helpers.examples import examples
from hypothesis import given
from hypothesis import strategies as st

from prefect_robomaker.tasks.runtime.recording.links import Links

MODEL = mujoco.MjModel.from_xml_string("""
<mujoco><compiler angle="radian"/><worldbody>
  <body name="other"><joint type="slide"/><geom size=".1"/></body>
  <body name="bot" pos="1 2 .5" euler=".1 .2 .3"><freejoint name="root"/><geom size=".1"/>
    <body name="plate" pos=".1 0 .2" euler="0 .4 0"><geom size=".1"/>
      <body name="mark" pos="0 .1 -.3" euler=".2 0 0"/>
      <body name="hip" pos=".2 .1 0" euler="0 0 .7">
        <joint name="swing" axis="1 2 3" pos=".05 -.02 .1" ref=".3"/><geom size=".1"/>
        <body pos=".3 0 0" euler=".3 0 0"><geom size=".05"/>
          <body name="foot" pos="0 0 -.2">
            <joint name="reach" type="slide" axis="0 1 1"/><joint name="twist" axis="0 0 1" pos="0 .1 0"/>
            <geom size=".05"/>
          </body>
        </body>
      </body>
    </body>
    <body name="wheel" pos="0 .3 0"><joint name="wheel" axis="0 1 0"/><geom size=".1"/>
      <body name="hub"><joint name="hub"/><geom size=".02"/></body></body>
    <body name="head" pos="0 0 .4"><joint name="ball" type="ball"/><geom size=".05"/>
      <body name="jaw"><joint name="jaw"/><geom size=".02"/></body></body>
  </body>
</worldbody></mujoco>""")
angles = st.floats(-7, 7)


def pose_of(row: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return row[:3], row[[6, 3, 4, 5]]


def after(outer: tuple[np.ndarray, np.ndarray], inner: tuple[np.ndarray, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    place, turn = np.zeros(3), np.zeros(4)
    mujoco.mju_mulPose(place, turn, *outer, *inner)
    return place, turn


@examples(60)
@given(st.sampled_from(["bot", "mark"]), st.lists(st.tuples(angles, angles, angles), min_size=1, max_size=3))
def test_links_are_where_mujoco_has_them(base: str, states: list[tuple[float, ...]]) -> None:
    links = Links(MODEL, MODEL.body(base).id, "base_link", [MODEL.body("wheel").id])
    assert links.frames == [("base_link", "hip"), ("hip", "foot")]
    assert [MODEL.joint(joint).name for joint in links.joints] == ["swing", "reach", "twist"]

    hips, feet = links.poses(np.array(states))

    for state, hip, foot in zip(states, hips, feet, strict=True):
        data = mujoco.MjData(MODEL)
        for joint, value in zip(links.joints, state, strict=True):
            data.qpos[MODEL.jnt_qposadr[joint]] = value
        data.joint("root").qpos[:3] = 4, 5, 6
        mujoco.mj_kinematics(MODEL, data)
        where = (data.body(base).xpos, data.body(base).xquat)
        for name, row in (("hip", hip), ("foot", foot)):
            where = after(where, pose_of(row))
            assert where[0] == pytest.approx(data.body(name).xpos, abs=1e-9)
            assert abs(where[1] @ data.body(name).xquat) == pytest.approx(1.0)


def test_a_robot_without_joints_has_no_links() -> None:
    model = mujoco.MjModel.from_xml_string("<mujoco><worldbody><body><geom size='.1'/></body></worldbody></mujoco>")
    links = Links(model, 1, "base_link")
    assert (links.links, links.joints, links.poses(np.zeros((3, 0)))) == ([], [], [])
