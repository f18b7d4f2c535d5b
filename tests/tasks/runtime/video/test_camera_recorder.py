import io
import json
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import mujoco
import numpy as np
import pytest
from helpers.paths import REPOSITORY
from PIL import Image
from rosbags.highlevel import AnyReader

from prefect_robomaker.schemas.runs.plan import ApplicationPlan, RunPlan
from prefect_robomaker.schemas.wire.errors import LaunchError
from prefect_robomaker.tasks.runtime.recording.recording import McapRecorder
from prefect_robomaker.tasks.runtime.supervision.launcher import Launcher
from prefect_robomaker.tasks.runtime.video.camera_recorder import INFO_TOPIC, TOPIC, CameraRecorder
from prefect_robomaker.tasks.runtime.video.video_settings import CameraRecording, camera_recording

CARTPOLE = REPOSITORY / "deployments" / "specs" / "examples" / "cartpole_bundle"
MODEL = """
<mujoco>
  <worldbody>
    <light pos="0 0 3"/>
    <camera name="aloft" pos="0 0 5"/>
    <geom size="1 1 .1" type="box" pos="0 3 0" rgba="1 0 0 1"/>
    <body><freejoint/><geom size=".1"/><camera name="bot/front" xyaxes="1 0 0 0 0 1"/></body>
  </worldbody>
</mujoco>
"""


@pytest.fixture
def environment() -> Any:
    model = mujoco.MjModel.from_xml_string(MODEL)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return SimpleNamespace(physics=SimpleNamespace(model=model, data=data))


def run(environment: Any, folder: Path, settings: CameraRecording) -> tuple[list[Any], Any]:
    with McapRecorder(folder / "recording.mcap") as recorder:
        watcher = CameraRecorder(recorder, settings, None)
        for step in range(21):
            if step * 0.05 >= watcher.next_time_s - 5e-7:
                watcher.watch(environment, step * 0.05)
        findings = watcher.close("agent")
    return read(folder, TOPIC), findings


def read(folder: Path, topic: str) -> list[Any]:
    with AnyReader([folder]) as reader:
        return [
            reader.deserialize(raw, connection.msgtype)
            for connection, _, raw in reader.messages()
            if connection.topic == topic
        ]


def test_pictures_are_jpeg_at_the_rate_asked_for(environment: Any, tmp_path: Path) -> None:
    messages, findings = run(environment, tmp_path, CameraRecording(5.0))
    assert findings.extra == {}
    stamps = [message.header.stamp.sec + message.header.stamp.nanosec / 1e9 for message in messages]
    assert stamps == pytest.approx([0.0, 0.2, 0.4, 0.6, 0.8, 1.0])
    assert {(message.header.frame_id, message.format) for message in messages} == {("camera_optical_frame", "jpeg")}
    # Each reading makes classes of its own.
    assert [str(info.header) for info in read(tmp_path, INFO_TOPIC)] == [str(message.header) for message in messages]
    picture = np.asarray(Image.open(io.BytesIO(messages[0].data.tobytes())))
    assert picture.shape == (240, 320, 3)
    assert picture[125, 160, 0] > 2 * picture[125, 160, 1]  # the red box ahead
    # A camera without a robot around it: its frames are no scene.
    layout = json.loads((tmp_path / "foxglove-layout.json").read_text())
    assert {name.split("!")[0] for name in layout["configById"]} == {"Image", "RawMessages"}
    assert layout["configById"]["Image!camera0"]["imageMode"] == {"imageTopic": TOPIC, "calibrationTopic": INFO_TOPIC}


def test_another_camera(environment: Any, tmp_path: Path) -> None:
    messages, _ = run(environment, tmp_path, CameraRecording(1.0, "aloft"))
    assert len(messages) == 2
    [message] = read(tmp_path, "/tf_static")
    assert message.transforms[0].header.frame_id == "world"
    assert message.transforms[0].transform.translation.z == 5


def test_a_robots_camera_needs_no_robots_name(environment: Any, tmp_path: Path) -> None:
    messages, findings = run(environment, tmp_path, CameraRecording(1.0, "front"))
    assert (len(messages), findings.extra) == (2, {})
    picture = np.asarray(Image.open(io.BytesIO(messages[0].data.tobytes())))
    assert picture[125, 160, 0] > 2 * picture[125, 160, 1]  # the red box ahead of bot/front


def test_a_camera_that_is_not_there_is_a_remark(
    environment: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    messages, findings = run(environment, tmp_path, CameraRecording(1.0, "elsewhere"))
    assert messages == read(tmp_path, "/tf_static") == []
    why = (
        "ROBOMAKER_RECORD_CAMERA: there is no camera 'elsewhere'; the model's cameras are: aloft, bot/front; follow "
        "and top are always there"
    )
    assert findings.extra == {"camera_error": why}
    assert capsys.readouterr().err == f"No camera in the recording: {why}.\n"


@pytest.mark.parametrize(
    ("frames", "remark"),
    [
        (["base_link"], "tf_frames is a list; it has to name frames by bodies"),
        ({"world": 7}, "tf_frames names 7 for 'world'; a frame has to be printable text"),
        ({"world": ""}, "tf_frames names '' for 'world'; a frame has to be printable text"),
        ({"world": "map\ud800"}, "tf_frames names 'map\\ud800' for 'world'; a frame has to be printable text"),
        ({"": "base_link"}, "tf_frames has a frame for ''; bodies have to be given by name or number"),
        ({None: "base_link"}, "tf_frames has a frame for None; bodies have to be given by name or number"),
    ],
)
def test_frames_that_are_none_are_a_remark(environment: Any, tmp_path: Path, frames: Any, remark: str) -> None:
    environment.tf_frames = frames
    messages, findings = run(environment, tmp_path, CameraRecording(1.0))
    assert messages == []
    assert remark in findings.extra["camera_error"]


def planned(make_plan: Callable[..., RunPlan], **variables: str) -> RunPlan:
    return make_plan(variables={f"ROBOMAKER_RECORD_{name}": value for name, value in variables.items()})


def test_settings_come_from_variables(make_plan: Callable[..., RunPlan]) -> None:
    assert camera_recording(planned(make_plan)) is None
    assert camera_recording(planned(make_plan, CAMERA="aloft")) is None
    plan = planned(make_plan, CAMERA_HZ="2.5", CAMERA="aloft")
    assert camera_recording(plan) == CameraRecording(2.5, "aloft", seed=plan.seed)
    assert camera_recording(plan.model_copy(update={"record": False})) is None
    robot = ApplicationPlan(
        role="robot", name="r", attribute="a.b", environment_variables={"ROBOMAKER_RECORD_CAMERA_HZ": "1"}
    )
    assert camera_recording(make_plan(robot_application=robot)) == CameraRecording(1.0, seed=plan.seed)


@pytest.mark.parametrize("text", ["", "0", "-1", "61", "nan", "often"])
def test_a_wrong_rate_is_named(make_plan: Callable[..., RunPlan], text: str) -> None:
    with pytest.raises(LaunchError, match=f"ROBOMAKER_RECORD_CAMERA_HZ is '{text}'; it has to be") as caught:
        camera_recording(planned(make_plan, CAMERA_HZ=text))
    assert caught.value.failure_code == "InvalidInput"


def test_a_picture_of_two_views_is_refused(make_plan: Callable[..., RunPlan]) -> None:
    with pytest.raises(LaunchError, match=r"ROBOMAKER_RECORD_CAMERA is 'both'.* has to be follow, top, or") as caught:
        camera_recording(planned(make_plan, CAMERA_HZ="2", CAMERA="both"))
    assert caught.value.failure_code == "InvalidInput"


def test_a_job_records_its_camera_when_asked_to(launcher: Launcher, make_plan: Callable[..., RunPlan]) -> None:
    bundle = {"path": CARTPOLE, "environment_variables": {"ROBOMAKER_RECORD_CAMERA_HZ": "4", "TIME_LIMIT_S": "1"}}
    plan = make_plan(
        simulation_application=ApplicationPlan(
            role="simulation", name="arena", attribute="my_cartpole.arena.make_environment", **bundle
        ),
        robot_application=ApplicationPlan(
            role="robot", name="agent", attribute="my_cartpole.agent.make_agent", **bundle
        ),
    )
    assert launcher.run(plan, lambda: None).status == "Completed"
    pictures = read(plan.output_dir, TOPIC)
    assert len(pictures) > 2
    assert Image.open(io.BytesIO(pictures[0].data.tobytes())).size == (320, 240)
