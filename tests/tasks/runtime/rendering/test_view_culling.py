import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from prefect_robomaker.tasks.runtime.rendering.views import MODEL_BORROWED, outside, without_unseen

ASPECT = 4 / 3
MODEL = mujoco.MjModel.from_xml_string(
    '<mujoco><worldbody><geom type="plane" size="0 0 1"/><geom name="ahead" size=".2" pos="2 0 .2"/>'
    '<geom name="behind" size=".2" pos="-2 0 .2"/></worldbody></mujoco>'
)


def scene_from(lookat: tuple[float, ...], azimuth_deg: float, elevation_deg: float, distance_m: float) -> Any:
    data, view = mujoco.MjData(MODEL), mujoco.MjvCamera()
    mujoco.mj_forward(MODEL, data)
    view.lookat[:], view.azimuth, view.elevation, view.distance = lookat, azimuth_deg, elevation_deg, distance_m
    scene = mujoco.MjvScene(MODEL, maxgeom=20)
    mujoco.mjv_updateCamera(MODEL, data, view, scene)
    return data, scene


def seen_at(scene: Any, point: np.ndarray) -> tuple[float, float, float]:
    """Where a point is in the picture, from -1 to 1 across and up, and how far ahead, by the textbook."""
    left, right = scene.camera
    forward, up = np.array(left.forward, float), np.array(left.up, float)
    away = point - (np.array(left.pos, float) + right.pos) / 2
    depth = float(away @ forward)
    half_height = (left.frustum_top - left.frustum_bottom) / 2 / left.frustum_near * depth
    across, upwards = float(away @ np.cross(forward, up)), float(away @ up)
    return across / (half_height * ASPECT), upwards / half_height, depth


@given(
    azimuth_deg=st.floats(-180, 180), elevation_deg=st.floats(-89, 89), distance_m=st.floats(0.1, 20),
    point=st.tuples(*[st.floats(-10, 10)] * 3), radius_m=st.floats(0.01, 3), push=st.tuples(*[st.floats(-1, 1)] * 3),
)  # fmt: skip
def test_nothing_of_which_a_point_is_in_the_picture_is_left_out(
    azimuth_deg: float, elevation_deg: float, distance_m: float, point: Any, radius_m: float, push: Any
) -> None:
    _, scene = scene_from((0.5, 0.2, 0.1), azimuth_deg, elevation_deg, distance_m)
    surface = np.array(point) + radius_m * np.array(push) / max(1.0, float(np.linalg.norm(push)))
    across, upwards, depth = seen_at(scene, surface)
    left_out = outside(np.array([point]), np.array([radius_m]), scene, ASPECT)
    if depth > 0 and abs(across) <= 1 and abs(upwards) <= 1:
        assert not len(left_out)


def test_what_is_behind_or_beside_is_left_out_and_what_has_no_end_is_not() -> None:
    data, scene = scene_from((2.0, 0.0, 0.2), 0.0, -10.0, 2.0)  # from the origin towards x
    names = {MODEL.geom(number).name for number in outside(data.geom_xpos, MODEL.geom_rbound, scene, ASPECT)}
    assert names == {"behind"}
    points = np.array([(2.0, 5.0, 0.0), (2.0, -5.0, 0.0), (2.0, 0.0, 5.0), (2.0, 0.0, -5.0), (2.0, 0.0, 0.2)])
    assert outside(points, np.full(5, 0.5), scene, ASPECT).tolist() == [0, 1, 2, 3]
    assert outside(points, np.full(5, 6.0), scene, ASPECT).tolist() == []


def test_the_model_is_as_before_also_after_a_failure() -> None:
    data, scene = scene_from((2.0, 0.0, 0.2), 0.0, -10.0, 2.0)

    def draw() -> None:
        with without_unseen(MODEL, data, scene, ASPECT):
            assert MODEL.geom_group.tolist() == [0, 0, 5]
            assert MODEL_BORROWED.locked()
            raise RuntimeError("no more")

    with pytest.raises(RuntimeError, match="no more"):
        draw()
    assert MODEL.geom_group.tolist() == [0, 0, 0]
    assert not MODEL_BORROWED.locked()


DRAW = """
import contextlib, sys, mujoco, numpy as np
from prefect_robomaker.tasks.runtime.rendering import cameras
from prefect_robomaker.tasks.runtime.rendering.views import choose_view

rng = np.random.default_rng(5)
spec = mujoco.MjSpec()
spec.worldbody.add_light(type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL, dir=(0.2, 0.3, -1))
spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=(5, 5, 1))
for kind in ("SPHERE", "CAPSULE", "ELLIPSOID", "CYLINDER", "BOX") * 24:
    spec.worldbody.add_geom(
        type=getattr(mujoco.mjtGeom, f"mjGEOM_{kind}"), size=rng.uniform(0.05, 0.4, 3), pos=rng.uniform(-4, 4, 3),
        quat=rng.normal(size=4), rgba=(*rng.uniform(0, 1, 3), rng.choice((1.0, 0.5))),
    )
model = spec.compile()
data = mujoco.MjData(model)
mujoco.mj_forward(model, data)
camera, view = cameras.GlCamera(model, 160, 120), mujoco.MjvCamera()
culled, drawn = cameras.without_unseen, []
for _ in range(40):
    view.lookat[:], view.distance = rng.uniform(-2, 2, 3), rng.uniform(0.5, 5)
    view.azimuth, view.elevation = rng.uniform(-180, 180), rng.uniform(-80, 80)
    pictures = []
    for cameras.without_unseen in (culled, lambda *_: contextlib.nullcontext()):
        pictures.append(camera.picture(data, lambda _: view))
        drawn.append(camera._scene.ngeom)
    assert np.array_equal(*pictures)
camera.close()
print(sum(drawn[::2]) / sum(drawn[1::2]))
"""


@pytest.mark.usefixtures("egl")
def test_pictures_are_the_same(tmp_path: Path) -> None:
    (tmp_path / "draw.py").write_text(DRAW)
    done = subprocess.run(
        [sys.executable, str(tmp_path / "draw.py")],
        check=True, capture_output=True, text=True, env={**os.environ, "MUJOCO_GL": "egl"},
    )  # fmt: skip
    assert 0.05 < float(done.stdout) < 0.6
