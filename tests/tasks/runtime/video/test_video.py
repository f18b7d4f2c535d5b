import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import av
import mujoco
import numpy as np
import pytest
from helpers.paths import REPOSITORY
from helpers.required_programs import missing
from PIL import Image

from prefect_robomaker.schemas.runs.plan import RunPlan
from prefect_robomaker.tasks.runtime.rendering.backends import available_video_backends, best_video_backend
from prefect_robomaker.tasks.runtime.rendering.cameras import GlCamera
from prefect_robomaker.tasks.runtime.rendering.ray_camera import RayCamera
from prefect_robomaker.tasks.runtime.rendering.views import CameraNameError, choose_view
from prefect_robomaker.tasks.runtime.supervision.launcher import Launcher
from prefect_robomaker.tasks.runtime.video.video import VideoWatcher
from prefect_robomaker.tasks.runtime.video.video_settings import VideoSettings

MODEL = """
<mujoco>
  <asset>
    <texture name="checks" type="2d" builtin="checker" rgb1="0 .8 0" rgb2="0 .6 0" width="64" height="64"/>
    <material name="checks" texture="checks" texrepeat="4 4"/>
  </asset>
  <visual><headlight ambient=".5 .5 .5" diffuse=".5 .5 .5"/></visual>
  <worldbody>
    <camera name="top" pos="0 0 4"/>
    <camera name="side" pos="0 -4 .3" xyaxes="1 0 0 0 0 1"/>
    <geom type="plane" size="9 9 .1" material="checks"/>
    <geom name="red" type="box" size=".5 .5 .3" pos="-.8 0 .3" rgba="1 0 0 1"/>
    <geom name="collision" type="box" size="9 9 1" pos="0 0 1" rgba="1 1 1 1" group="3"/>
    <body pos=".8 0 .3"><freejoint/><geom type="box" size=".5 .5 .3" rgba="0 0 1 1" gap="1"/></body>
  </worldbody>
</mujoco>
"""
BACKEND_NAMES = ["egl", "osmesa", "rays"]


@pytest.fixture
def physics() -> Any:
    model = mujoco.MjModel.from_xml_string(MODEL)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return SimpleNamespace(model=model, data=data)


def dominant(picture: Any, row: float, column: float) -> str:
    pixel = picture[int(row * picture.shape[0]), int(column * picture.shape[1])].astype(int)
    return ["red", "green", "blue"][int(np.argmax(pixel))]


def looks_right(picture: Any) -> bool:
    return [dominant(picture, 0.5, column) for column in (0.33, 0.5, 0.67)] == ["red", "green", "blue"]


class TestRays:
    def test_sees_what_opengl_sees(self, physics: Any) -> None:
        picture = RayCamera(physics.model, 160, 120).picture(physics.data, choose_view(physics.model, "top"))
        assert picture.shape == (120, 160, 3)
        assert looks_right(picture)

    def test_up_is_up(self, physics: Any) -> None:
        picture = RayCamera(physics.model, 160, 120).picture(physics.data, choose_view(physics.model, "side"))
        assert dominant(picture, 0.1, 0.5) == "blue"  # the sky
        assert dominant(picture, 0.9, 0.5) == "green"

    def test_a_camera_in_its_housing_looks_out_of_it(self) -> None:
        model = mujoco.MjModel.from_xml_string("""
            <mujoco><worldbody>
              <body>
                <freejoint/><geom type="box" size=".1 .1 .1" rgba="0 1 0 1"/><camera name="eye" pos="0 0 .05"/>
              </body>
              <geom type="box" size="3 3 .1" pos="0 0 -2" rgba="1 0 0 1"/>
            </worldbody></mujoco>""")
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        picture = RayCamera(model, 80, 60).picture(data, choose_view(model, "eye"))
        assert dominant(picture, 0.5, 0.5) == "red"

    def test_free_view(self, physics: Any) -> None:
        model = mujoco.MjModel.from_xml_string(
            "<mujoco><worldbody><geom size='1' rgba='1 0 0 1'/></worldbody></mujoco>"
        )
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        picture = RayCamera(model, 80, 60).picture(data, choose_view(model, None))
        assert dominant(picture, 0.5, 0.5) == "red"


def test_a_camera_that_is_not_there(physics: Any) -> None:
    wanted = "video_camera: there is no camera 'chase'; the model's cameras are: top, side"
    with pytest.raises(CameraNameError, match=wanted):
        choose_view(physics.model, "chase")


TAKE_PICTURES = """
import sys, mujoco, numpy as np
from prefect_robomaker.tasks.runtime.rendering.cameras import GlCamera
from prefect_robomaker.tasks.runtime.rendering.ray_camera import RayCamera
from prefect_robomaker.tasks.runtime.rendering.views import choose_view

model = mujoco.MjModel.from_xml_path(sys.argv[1])
data = mujoco.MjData(model)
mujoco.mj_forward(model, data)
before = model.vis.quality.offsamples
for name in ("top", "side"):
    for kind in (GlCamera, RayCamera):
        camera = kind(model, 320, 240)
        np.save(f"{sys.argv[2]}/{kind.__name__}-{name}", camera.picture(data, choose_view(model, name)))
        camera.close()
assert model.vis.quality.offsamples == before
"""


@pytest.mark.deep
@pytest.mark.parametrize("name", ["egl", "osmesa"])
def test_opengl_and_rays_agree(name: str, tmp_path: Path) -> None:
    """In a process of its own, which may choose its OpenGL."""
    [backend] = [item for item in available_video_backends() if item.name == name]
    if not backend.works:
        missing(name, f"{name} does not work on this machine: {backend.problem}")
    (tmp_path / "take.py").write_text(TAKE_PICTURES)
    (tmp_path / "model.xml").write_text(MODEL)
    arguments = [sys.executable, *(str(tmp_path / item) for item in ("take.py", "model.xml", ""))]
    # Rendering in this process leaves its choice in a variable of PyOpenGL's.
    environment = {key: value for key, value in os.environ.items() if key != "PYOPENGL_PLATFORM"}
    subprocess.run(arguments, check=True, env={**environment, "MUJOCO_GL": name})
    # From the side only what is below the horizon: this model's sky is black in OpenGL.
    for view, rows in (("top", slice(None)), ("side", slice(135, None))):
        drawn, cast = (np.load(tmp_path / f"{kind.__name__}-{view}.npy")[rows] for kind in (GlCamera, RayCamera))
        assert (drawn.argmax(axis=2) == cast.argmax(axis=2)).mean() > 0.98


LIT_ROOM = """<mujoco><asset><material name="dull" specular="{specular}"/></asset>
<visual><headlight ambient=".4 .4 .4" diffuse=".3 .3 .3"/></visual><worldbody>
<light pos="0 0 2" dir=".3 .2 -1" type="{light}" diffuse=".6 .6 .6"/>
<geom type="box" size="3 3 .05" rgba=".7 .6 .5 1" material="dull"/>
<geom type="box" size=".05 3 1" pos="3 0 1" rgba=".8 .8 .8 1" material="dull"/>
<geom type="cylinder" size=".3 .4" pos="1 .8 .4" rgba=".2 .6 .3 1"/><geom type="sphere" size=".3" pos="1 -.8 .4"/>
<camera name="eye" pos="-2 0 1.5" xyaxes="0 -1 0 .4 0 1"/></worldbody></mujoco>"""
DRAW_TWICE = """
import contextlib, sys, mujoco, numpy as np
from prefect_robomaker.tasks.runtime.rendering import cameras
from prefect_robomaker.tasks.runtime.rendering.views import choose_view

model = mujoco.MjModel.from_xml_string(sys.argv[1])
data = mujoco.MjData(model)
mujoco.mj_forward(model, data)
fast, quality = cameras._fast_settings, model.vis.quality
before = quality.numslices, quality.numstacks, quality.numquads

@contextlib.contextmanager
def plain(model, width, height):
    size, model.vis.quality.offsamples = model.vis.global_, 0
    size.offwidth, size.offheight = width, height
    yield

for size in ((320, 240), (640, 480)):
    pictures = []
    for cameras._fast_settings in (fast, plain):
        camera = cameras.GlCamera(model, *size)
        pictures.append(camera.picture(data, choose_view(model, "eye")).astype(int))
        camera.close()
        assert (quality.numslices, quality.numstacks, quality.numquads) == before
    assert pictures[0].std() > 10
    np.save(f"{sys.argv[2]}/{size[0]}", np.abs(pictures[0] - pictures[1]))
"""


@pytest.mark.deep
@pytest.mark.usefixtures("egl")
@pytest.mark.parametrize(
    ("light", "specular"),
    [
        ("spot", 0.0),
        pytest.param("directional", 0.0, marks=pytest.mark.deep),
        pytest.param("directional", 0.5, marks=pytest.mark.deep),
    ],
)
def test_fast_settings_are_not_seen(light: str, specular: float, tmp_path: Path) -> None:
    (tmp_path / "draw.py").write_text(DRAW_TWICE)
    arguments = [
        sys.executable,
        str(tmp_path / "draw.py"),
        LIT_ROOM.format(light=light, specular=specular),
        str(tmp_path),
    ]
    subprocess.run(arguments, check=True, env={**os.environ, "MUJOCO_GL": "egl"})
    small, large = (np.load(tmp_path / f"{width}.npy") for width in (320, 640))
    assert large.max() <= 1
    # Edges of rounds move by less than a pixel.
    assert (small.max(axis=2) > 8).mean() < 0.005


class TestVideoWatcher:
    def film(self, physics: Any, folder: Path, until_s: float, step_s: float = 0.02) -> dict[str, Any]:
        watcher = VideoWatcher(folder, "rays")
        environment = SimpleNamespace(physics=physics, video_camera="top")
        for i in range(round(until_s / step_s) + 1):
            if i * step_s >= watcher.next_time_s - 5e-7:
                watcher.watch(environment, i * step_s)
        return watcher.close("environment").extra

    @pytest.mark.parametrize("step_s", [pytest.param(0.02, marks=pytest.mark.deep), 0.5])
    def test_length_and_content(self, physics: Any, tmp_path: Path, step_s: float) -> None:
        assert self.film(physics, tmp_path, 2.0, step_s) == {"video_backend": "rays"}
        with av.open(str(tmp_path / "video.mp4")) as container:
            [stream] = container.streams.video
            assert (stream.codec_context.name, stream.codec_context.pix_fmt) == ("h264", "yuv420p")
            assert stream.average_rate == 15
            frames = [frame.to_ndarray(format="rgb24") for frame in container.decode(stream)]
        assert len(frames) == 31
        assert looks_right(frames[-1])
        assert looks_right(np.asarray(Image.open(tmp_path / "poster.png")))
        assert sorted(item.name for item in tmp_path.iterdir()) == ["poster.png", "video.mp4"]

    def test_a_film_that_cannot_be_written_says_so(
        self, physics: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        remarks = self.film(physics, tmp_path / "gone", 0.5)
        assert "No such file or directory" in remarks["video_error"]
        assert "No video: it could not be made with rays." in capsys.readouterr().err

    def test_a_camera_that_is_not_there_is_told_in_one_line(
        self, physics: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        watcher = VideoWatcher(tmp_path, "rays", VideoSettings(camera="chase"))
        watcher.watch(SimpleNamespace(physics=physics), 0.0)
        remarks = watcher.close("environment").extra
        assert remarks["video_error"].startswith("ROBOMAKER_VIDEO_CAMERA: there is no camera 'chase'")
        assert capsys.readouterr().err == f"No video: {remarks['video_error']}.\n"
        assert list(tmp_path.iterdir()) == []

    def test_nothing_to_film(self, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
        remarks = VideoWatcher(tmp_path, "rays").close("environment").extra
        assert remarks == {"video_error": "the environment has no `physics` to record"}
        assert "No video" in capsys.readouterr().err

    def test_an_environment_that_was_never_made_is_not_said_to_have_no_physics(
        self, launcher: Launcher, make_plan: Callable[..., RunPlan]
    ) -> None:
        plan = make_plan("unable", video="always")
        outcome = launcher.run(plan, lambda: None)
        log = (plan.output_dir / "logs/stderr.log").read_text()
        assert "no such map" in log
        assert "No video" not in log + (outcome.failure_reason or "")

    def test_a_new_model_gets_a_new_camera(self, physics: Any, tmp_path: Path) -> None:
        watcher = VideoWatcher(tmp_path, "rays")
        watcher.watch(SimpleNamespace(physics=physics), 0.0)
        model = mujoco.MjModel.from_xml_string(MODEL.replace("1 0 0 1", "0 0 1 1"))
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        watcher.watch(SimpleNamespace(physics=SimpleNamespace(model=model, data=data)), 1 / 15)
        watcher.close("environment")
        assert dominant(np.asarray(Image.open(tmp_path / "poster.png")), 0.5, 0.33) == "blue"


def test_backends_of_this_machine() -> None:
    backends = available_video_backends()
    assert [item.name for item in backends] == BACKEND_NAMES
    for item in backends:
        assert item.works == (item.problem == "")
        assert item.packages or item.name == "rays"
    assert best_video_backend() == next(item.name for item in backends if item.works)


def test_a_run_with_video(launcher: Launcher, make_plan: Any) -> None:
    bundle = REPOSITORY / "deployments/specs/examples/cartpole_bundle"
    plan = make_plan(path=bundle, video="always", variables={"TIME_LIMIT_S": "0.4"})
    plan = plan.model_copy(
        update={
            "simulation_application": plan.simulation_application.model_copy(
                update={"attribute": "my_cartpole.arena.make_environment"}
            ),
            "robot_application": plan.robot_application.model_copy(
                update={"attribute": "my_cartpole.agent.make_agent"}
            ),
        }
    )
    assert launcher.run(plan, lambda: None).status == "Completed"
    result = json.loads((plan.output_dir / "result.json").read_text())
    assert result["extra"] == {"video_backend": best_video_backend()}
    with av.open(str(plan.output_dir / "video.mp4")) as container:
        assert len(list(container.decode(video=0))) == 7
    size = (320, 240) if best_video_backend() == "rays" else (640, 480)
    with Image.open(plan.output_dir / "poster.png") as poster:
        assert poster.size == size


def test_a_run_without_physics_says_why_there_is_no_video(launcher: Launcher, make_plan: Any) -> None:
    plan = make_plan(video="always")
    assert launcher.run(plan, lambda: None).status == "Completed"
    result = json.loads((plan.output_dir / "result.json").read_text())
    assert result["extra"] == {"video_error": "the environment has no `physics` to record"}
    assert "No video" in (plan.output_dir / "logs/stderr.log").read_text()


@pytest.mark.deep
def test_applications_may_render_themselves(launcher: Launcher, make_plan: Any) -> None:
    if best_video_backend() == "rays":
        pytest.skip("no OpenGL on this machine")
    plan = make_plan("rendering", variables={"MUJOCO_GL": best_video_backend()})
    outcome = launcher.run(plan, lambda: None)
    assert outcome.status == "Completed", outcome.failure_reason
    assert (plan.output_dir / "logs/stdout.log").read_text() == "[True, True]\n"


def test_rendering_without_opengl_is_the_applications_failure(launcher: Launcher, make_plan: Any) -> None:
    outcome = launcher.run(make_plan("rendering"), lambda: None)
    assert (outcome.status, outcome.failure_code) == ("Failed", "SimulationApplicationCrash")
