import math

import mujoco
import numpy as np
import pytest

from prefect_robomaker.tasks.runtime.episode.physics import radius_of, robot_body
from prefect_robomaker.tasks.runtime.rendering.views import CameraNameError, choose_view, choose_views, fixed_extent
from prefect_robomaker.tasks.runtime.video.video import RAYS, ViewRenderer
from prefect_robomaker.tasks.runtime.video.video_settings import VideoSettings

ROVER = """
<body name="rover" pos="{place}" euler="0 0 {heading}">
  <freejoint/>
  <geom type="box" size=".2 .15 .1" rgba="1 0 0 1"/>
  <geom type="box" pos=".2 0 0" size=".05 .05 .05" rgba="1 .9 0 1"/>
  <body name="arm" pos="0 0 .1"><joint name="arm" axis="0 1 0"/><geom size=".05"/></body>
</body>
"""
ROOM = """
<mujoco>
  <compiler angle="degree"/>
  <worldbody>
    <body name="crate" pos="1.5 .5 .2"><freejoint/><geom type="box" size=".2 .2 .2" rgba="0 0 1 1"/></body>
    <geom type="plane" size="0 0 1" rgba=".4 .6 .4 1"/>
    {walls}
    {rover}
  </worldbody>
  <actuator><motor joint="arm"/></actuator>
</mujoco>
"""
WALLS = """
<geom name="west" type="box" size=".1 2 .5" pos="-3 0 .5" rgba="1 1 1 1"/>
<geom name="east" type="box" size=".1 2 .5" pos="3 0 .5" rgba="1 1 1 1"/>
<geom type="box" size="9 9 .1" pos="0 0 3" group="4"/>
"""


def room(walls: str = WALLS, place: str = "0 0 .1", heading: float = 0.0) -> tuple[mujoco.MjModel, mujoco.MjData]:
    model = mujoco.MjModel.from_xml_string(ROOM.format(walls=walls, rover=ROVER.format(place=place, heading=heading)))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data


def camera_place(view: mujoco.MjvCamera) -> np.ndarray:
    azimuth, elevation = math.radians(view.azimuth), math.radians(view.elevation)
    forward = np.array(
        [math.cos(elevation) * math.cos(azimuth), math.cos(elevation) * math.sin(azimuth), math.sin(elevation)]
    )
    return view.lookat - view.distance * forward


def test_the_robot_is_what_the_actuators_move() -> None:
    model, _ = room()
    body = robot_body(model)
    assert body is not None
    assert model.body(body).name == "rover"
    assert 0.25 < radius_of(model, body) < 0.4


def test_without_actuators_it_is_what_can_move_and_without_joints_nothing() -> None:
    falling = mujoco.MjModel.from_xml_string(
        "<mujoco><worldbody><geom size='1'/><body name='b'><freejoint/><geom size='1'/></body></worldbody></mujoco>"
    )
    assert falling.body(robot_body(falling)).name == "b"
    assert (
        robot_body(mujoco.MjModel.from_xml_string("<mujoco><worldbody><geom size='1'/></worldbody></mujoco>")) is None
    )


@pytest.mark.parametrize("heading", [0.0, 90.0, -135.0])
def test_follow_stands_behind_the_robot_and_above(heading: float) -> None:
    model, data = room(walls="", heading=heading)
    view = choose_view(model, "follow")(data)
    away = camera_place(view) - data.body("rover").xpos
    ahead = np.array([math.cos(math.radians(heading)), math.sin(math.radians(heading))])
    assert away[:2] @ ahead < -0.5
    assert away[2] > 0.3
    assert np.allclose(view.lookat, data.body("rover").subtree_com)


def test_follow_looks_over_what_is_low_and_comes_closer_to_what_is_high() -> None:
    open_model, open_data = room()
    far = choose_view(open_model, "follow")(open_data)
    flat, full_m = far.elevation, far.distance
    model, data = room(place="-2.3 0 .1")
    over = choose_view(model, "follow")(data)
    assert over.elevation < flat - 10
    assert over.distance == pytest.approx(full_m)
    assert camera_place(over)[2] > 1
    model, data = room(walls=WALLS.replace(".1 2 .5", ".1 2 5"), place="-2.55 0 .1")
    close = choose_view(model, "follow")(data)
    assert camera_place(close)[0] > -2.9
    assert close.distance < full_m


def test_follow_keeps_the_horizon_and_its_side_when_the_robot_tips_over() -> None:
    own = '<camera name="follow" pos="-1 0 1" xyaxes="0 -1 0 .7 0 .7"/></body>'
    xml = ROOM.format(walls="", rover=ROVER.format(place="0 0 .1", heading=0)).replace("</body>\n\n", f"{own}\n\n")
    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    follow = choose_view(model, None)
    view = before = follow(data)
    azimuth, elevation, distance = before.azimuth, before.elevation, before.distance
    assert before.type == mujoco.mjtCamera.mjCAMERA_FREE
    assert elevation == pytest.approx(-45, abs=4)
    assert azimuth == pytest.approx(0, abs=1)
    start = model.joint(model.body("rover").jntadr[0]).qposadr[0]
    for step in range(60):  # it falls on its back, over its tail, and slides away
        angle = min(math.pi, step / 10)
        data.time = step / 15
        data.qpos[start : start + 7] = [0.02 * step, 0, 0.1, math.cos(angle / 2), 0, math.sin(angle / 2), 0]
        mujoco.mj_forward(model, data)
        view = follow(data)
        assert (view.azimuth, view.elevation) == pytest.approx((azimuth, elevation), abs=1)
        assert np.linalg.norm(view.lookat - data.body("rover").subtree_com) < 0.3
    assert view.distance == pytest.approx(distance)


def test_a_robots_own_camera_is_there_by_its_full_name() -> None:
    own = '<camera name="r/follow" pos="-1 0 1" xyaxes="0 -1 0 .7 0 .7"/></body>'
    xml = ROOM.format(walls="", rover=ROVER.format(place="0 0 .1", heading=0)).replace("</body>\n\n", f"{own}\n\n")
    model = mujoco.MjModel.from_xml_string(xml)
    assert choose_view(model, "follow")(mujoco.MjData(model)).type == mujoco.mjtCamera.mjCAMERA_FREE
    assert choose_view(model, "r/follow")(mujoco.MjData(model)).fixedcamid == model.camera("r/follow").id


def test_follow_glides_after_a_robot_that_nods() -> None:
    model, data = room(walls="")
    follow = choose_view(model, "follow")
    azimuths = []
    for number in range(30):
        yaw = 0.3 * (-1) ** number
        data.time = number / 15
        data.qpos[model.joint("arm").qposadr[0] - 7 :][3:7] = [math.cos(yaw / 2), 0, 0, math.sin(yaw / 2)]
        mujoco.mj_forward(model, data)
        azimuths.append(follow(data).azimuth)
    assert np.abs(np.diff(azimuths[1:])).max() < 0.25 * math.degrees(0.6)


def test_top_shows_all_that_is_fixed_and_shown_with_north_up() -> None:
    model, data = room()
    extent = fixed_extent(model, data)
    assert extent is not None
    low, high = extent
    assert np.allclose(low, [-3.1, -2, 0])
    assert np.allclose(high, [3.1, 2, 1])
    filming = ViewRenderer(model, VideoSettings("top", (320, 240)), RAYS)
    picture = filming.picture(data).astype(int)
    is_wall = (picture.min(axis=2) > 140) & (picture.max(axis=2) - picture.min(axis=2) < 10)
    _, columns = np.nonzero(is_wall)
    assert columns.min() > 0
    assert columns.max() < 319
    assert columns.min() < 60
    assert columns.max() > 260
    blue = np.argwhere((picture[..., 2] > 80) & (picture[..., 0] < 60)).mean(axis=0)
    red = np.argwhere((picture[..., 0] > 80) & (picture[..., 1] < 60)).mean(axis=0)
    assert blue[0] < red[0], "the crate lies north of the robot, so above it"
    assert blue[1] > red[1], "and east of it, so to its right"


def test_top_goes_with_the_robot_where_nothing_is_fixed() -> None:
    model, data = room(walls="", place="7 -4 .1")
    view = choose_view(model, "top")(data)
    assert np.allclose(view.lookat[:2], [7, -4], atol=0.1)
    assert view.elevation == -90


def test_a_models_own_cameras_go_first() -> None:
    model, data = room(walls='<camera name="top" pos="0 0 9"/><camera name="rig/follow" pos="0 -3 1"/>')
    assert choose_view(model, "top")(data).fixedcamid == model.camera("top").id
    assert choose_view(model, "follow")(data).fixedcamid == model.camera("rig/follow").id
    assert choose_view(model, None)(data).fixedcamid == model.camera("rig/follow").id


def test_without_a_name_and_a_follow_camera_it_is_the_first() -> None:
    model, data = room(walls='<camera name="side" pos="0 0 9"/><camera name="back" pos="0 -3 1"/>')
    assert choose_view(model, None)(data).fixedcamid == model.camera("side").id
    model, data = room()
    assert choose_view(model, None)(data).type == mujoco.mjtCamera.mjCAMERA_FREE


def test_both_is_the_view_from_above_in_a_corner_of_the_other() -> None:
    model, data = room()
    main, small = choose_views(model, "both")
    assert small is not None
    assert main(data).elevation > -60
    assert small(data).elevation == -90
    pictures = []
    for name in ("follow", "both"):
        filming = ViewRenderer(model, VideoSettings(name, (320, 240)), RAYS)
        pictures.append(filming.picture(data))
        filming.close()
    differs = (pictures[0] != pictures[1]).any(axis=2)
    rows, columns = np.nonzero(differs)
    assert rows.max() < 110
    assert columns.min() > 180
    assert (pictures[1][5, 200:310] == 245).all(), "with a frame around it"


def test_the_picture_in_the_corner_follows_too() -> None:
    model, data = room()
    filming = ViewRenderer(model, VideoSettings("both", (320, 240)), RAYS)
    before = filming.picture(data)[6:90, 206:310].copy()
    data.qpos[model.joint("arm").qposadr[0] - 7] = 1.0
    data.time = 1.0
    mujoco.mj_forward(model, data)
    assert (filming.picture(data)[6:90, 206:310] != before).any()


def test_a_wish_for_a_camera_that_is_not_there_names_the_variable() -> None:
    model, _ = room()
    with pytest.raises(
        CameraNameError,
        match="ROBOMAKER_VIDEO_CAMERA: there is no camera 'chase'; the model's cameras are: none; follow",
    ):
        ViewRenderer(model, VideoSettings("chase"), RAYS)
