"""What is seen at a pixel is where transforms and camera info say that it is."""

import io
from collections.abc import Mapping
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image
from rosbags.highlevel import AnyReader

from prefect_robomaker.tasks.runtime.recording.camera_frames import find_mount, frames_of
from prefect_robomaker.tasks.runtime.recording.links import Links
from prefect_robomaker.tasks.runtime.recording.recording import McapRecorder
from prefect_robomaker.tasks.runtime.video.camera_recorder import CameraRecorder
from prefect_robomaker.tasks.runtime.video.video_settings import CameraRecording

MODEL = """
<mujoco>
  <visual><headlight ambient="1 1 1" diffuse="0 0 0" specular="0 0 0"/></visual>
  <worldbody>
    <geom name="ball" pos="1.6 2.35 0.55" size=".05" rgba="1 0 0 1"/>
    <camera name="wall" pos="3 4 2" xyaxes="-.7 .7 0 -.3 -.3 .8"/>
    <body pos="0 0 1"><camera name="shelf" pos="-.5 2 .1" quat=".5 .5 -.5 -.5" fovy="70"/></body>
    <camera name="chasing" pos="-1 1 1.5" mode="targetbody" target="bot"/>
    <body name="bot" pos=".3 2 .2" euler="4 -7 25">
      <freejoint/><geom size=".1" rgba="0 0 1 1"/>
      <body name="head" pos=".1 0 .2" euler="0 10 0"><camera name="bot/front" pos=".05 .02 0" xyaxes="0 -1 0 .1 0 1"/>
      </body>
      <body name="arm" pos="0 0 .3"><joint name="arm" axis="0 0 1"/><geom size=".02" rgba="0 0 1 1"/>
        <camera name="hand" pos=".1 0 0" xyaxes="0 -1 0 0 0 1"/>
        <camera name="odd" pos=".1 0 0" xyaxes="0 -1 0 0 0 1" resolution="320 240" sensorsize=".008 .006"
          focal=".006 .007" principal=".0008 -.0005"/>
      </body>
    </body>
  </worldbody>
</mujoco>
"""
BALL = (1.6, 2.35, 0.55)


def recorded(folder: Path, camera: str, backend: str | None = None) -> tuple[dict[str, list[Any]], mujoco.MjData]:  # pyright: ignore[reportAttributeAccessIssue]
    """The messages by topic of two looks, between which everything moves."""
    model = mujoco.MjModel.from_xml_string(MODEL)
    data = mujoco.MjData(model)
    physics = SimpleNamespace(model=model, data=data)
    environment = SimpleNamespace(physics=physics, tf_frames={"world": "map", "bot": "base_link"})
    with McapRecorder(folder / "recording.mcap") as recorder:
        watcher = CameraRecorder(recorder, CameraRecording(5.0, camera), backend)
        for time_s, place, turn in ((0.0, 0.0, 0.0), (0.2, 0.08, -0.1)):
            data.qpos[0], data.qpos[-1] = 0.3 + place, turn
            mujoco.mj_forward(model, data)
            watcher.watch(environment, time_s)
        assert watcher.close("agent").extra == {}
    messages: dict[str, list[Any]] = {}
    with AnyReader([folder]) as reader:
        for connection, _, raw in reader.messages():
            messages.setdefault(connection.topic, []).append(reader.deserialize(raw, connection.msgtype))
    return messages, data


def matrix(transform: Any) -> NDArray[np.float64]:
    """A transform's message as a matrix from child to parent."""
    turn, place = transform.rotation, transform.translation
    whole = np.eye(4)
    flat = np.zeros(9)
    mujoco.mju_quat2Mat(flat, np.array((turn.w, turn.x, turn.y, turn.z)))
    whole[:3, :3], whole[:3, 3] = flat.reshape(3, 3), (place.x, place.y, place.z)
    return whole


def to_map(frame: str, transforms: Mapping[str, Any], base: NDArray[np.float64]) -> NDArray[np.float64]:
    """From a frame to the map, up the tree."""
    whole = np.eye(4)
    while frame != "map":
        if frame == "base_link":
            return base @ whole
        whole = matrix(transforms[frame].transform) @ whole
        frame = transforms[frame].header.frame_id
    return whole


def projected(info: Any, point: NDArray[np.float64]) -> tuple[float, float]:
    u, v, depth = info.p.reshape(3, 4) @ point
    assert depth > 0
    return float(u / depth), float(v / depth)


def middle_of_red(picture: Any) -> tuple[float, float]:
    pixels = np.asarray(Image.open(io.BytesIO(picture.data.tobytes())), dtype=float)
    rows, columns = np.nonzero(pixels[..., 0] > 1.6 * pixels[..., 1] + 40)
    assert len(rows) > 20
    return float(columns.mean()), float(rows.mean())


@pytest.mark.parametrize("backend", [None, "egl"])
@pytest.mark.parametrize(
    ("camera", "parent", "is_static"),
    [
        ("bot/front", "base_link", True),
        ("wall", "map", True),
        ("shelf", "map", True),
        ("hand", "map", False),
        ("chasing", "map", False),
        ("top", "map", False),
        ("odd", "map", False),
    ],
)
def test_a_ball_is_where_the_messages_say(
    tmp_path: Path, camera: str, parent: str, is_static: bool, backend: str | None
) -> None:
    messages, data = recorded(tmp_path, camera, backend)

    base = np.eye(4)
    base[:3, :3], base[:3, 3] = data.body("bot").xmat.reshape(3, 3), data.body("bot").xpos
    assert len(messages["/tf_static"]) == 1
    assert len(messages.get("/tf", [])) == (0 if is_static else 2)
    transforms = {
        item.child_frame_id: item
        for topic in ("/tf_static", "/tf")
        for message in messages.get(topic, [])
        for item in message.transforms
    }
    assert transforms["camera_link"].header.frame_id == parent
    picture, info = messages["/camera/image_raw/compressed"][-1], messages["/camera/camera_info"][-1]
    assert picture.header == info.header
    assert (info.header.frame_id, info.width, info.height) == ("camera_optical_frame", 320, 240)
    seen_from = np.linalg.inv(to_map(info.header.frame_id, transforms, base))
    assert projected(info, seen_from @ (*BALL, 1.0)) == pytest.approx(middle_of_red(picture), abs=0.35)


def test_a_camera_looks_along_its_own_x(tmp_path: Path) -> None:
    messages, _ = recorded(tmp_path, "shelf")

    camera, optical = (item.transform for item in messages["/tf_static"][0].transforms)

    assert matrix(camera)[:3, 3] == pytest.approx((-0.5, 2.0, 1.1))
    assert matrix(camera)[:3, :3] == pytest.approx(np.eye(3), abs=1e-9)
    # Ahead, left and up as the optical frame has them: z, -x, -y (REP 103).
    assert np.linalg.inv(matrix(optical))[:3, :3] == pytest.approx(np.array([[0, -1, 0], [0, 0, -1], [1, 0, 0]]))


def test_bodies_without_names_are_told_apart() -> None:
    model = mujoco.MjModel.from_xml_string("""<mujoco><worldbody>
      <body><freejoint/><geom size=".1"/>
        <body pos="1 0 0"><joint axis="0 0 1"/><geom size=".1"/><camera/></body>
        <body pos="0 1 0"><joint axis="0 0 1"/><geom size=".1"/></body></body>
      <body pos="5 5 1"><freejoint/><geom size=".1"/><camera/></body>
    </worldbody></mujoco>""")
    environment = SimpleNamespace(
        tf_frames={1: "base_link", **Links(model, 1, "base_link").frame_of, "gone": "x", 9: "y"}
    )
    frames = frames_of(environment, model)
    data, scene, view = mujoco.MjData(model), mujoco.MjvScene(model, maxgeom=1), mujoco.MjvCamera()
    mujoco.mj_forward(model, data)

    mounts = []
    for view.fixedcamid in (0, 1):
        view.type = mujoco.mjtCamera.mjCAMERA_FIXED
        mujoco.mjv_updateCamera(model, data, view, scene)
        mounts.append(find_mount(model, view, scene, frames))

    assert frames == {0: "world", 1: "base_link", 2: "link_2", 3: "link_3"}
    assert [(mount.parent, mount.is_fixed) for mount in mounts] == [("link_2", True), ("world", False)]
