from dataclasses import replace
from typing import Any

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray

from prefect_robomaker.schemas.runs.plan import ApplicationPlan
from prefect_robomaker.tasks.runtime.applications.indoor_navigation.environment import (
    IndoorNavigation,
    make_environment,
)
from prefect_robomaker.tasks.runtime.applications.indoor_navigation.scene_markers import (
    occupancy_grid,
    robot_markers,
    world_markers,
)
from prefect_robomaker.tasks.runtime.episode.occupancy_map import read_map
from prefect_robomaker.tasks.runtime.recording import messages as ros
from prefect_robomaker.tasks.runtime.recording.messages import Marker, MarkerType

NOW = ros.Time(1, 0)
MODEL = """
<mujoco>
  <asset><mesh name="brick" vertex="0 0 0 .4 0 0 0 .2 0 .4 .2 0 0 0 .6 .4 0 .6 0 .2 .6 .4 .2 .6"/>
    <material name="oak" rgba=".6 .4 .2 1"/></asset>
  <worldbody>
    <geom name="floor_1" type="box" size="2 2 .1" pos="0 0 -.1"/>
    <geom name="endless" type="plane" size="0 0 1"/>
    <geom name="wall_1" type="box" size="2 .1 1" pos="0 2 1"/>
    <geom name="Beds_1.mattress" type="ellipsoid" size=".3 .2 .1" pos="1 1 .5" euler="10 20 30" material="oak"/>
    <geom name="Lamps_2.pole" type="capsule" size=".05 .4" pos="-1 1 .5"/>
    <geom name="Vases_1" type="mesh" mesh="brick" pos="-1 -1 0"/>
    <geom name="hint" type="sphere" size=".1" group="4"/>
    <geom name="ghost" type="sphere" size=".1" rgba="1 0 0 0"/>
    <body name="bot" pos=".5 -.5 .2" euler="0 10 70"><freejoint/>
      <geom name="bot/hull" type="cylinder" size=".2 .05" pos=".01 .02 .03"/>
      <body name="mast" pos="0 0 .1" euler="0 5 0"><geom name="bot/mast" type="box" size=".01 .02 .1"/></body>
      <body name="wheel" pos="0 .2 0"><joint name="wheel" axis="0 1 0"/><geom name="bot/tyre" size=".05"/></body>
      <body name="arm" pos="0 0 .1"><joint name="arm" axis="0 0 1"/><geom name="bot/arm" size=".04"/></body>
    </body>
  </worldbody>
</mujoco>
"""


@pytest.fixture
def scene() -> tuple[Any, Any]:
    model = mujoco.MjModel.from_xml_string(MODEL)
    data = mujoco.MjData(model)
    data.joint("wheel").qpos = 1.0
    mujoco.mj_forward(model, data)
    return model, data


def corners(marker: Marker) -> NDArray[np.float64]:
    """The corners of the box that a marker fills, in its frame."""
    x, y, z, w = marker.pose.orientation
    axes = np.zeros(9)
    mujoco.mju_quat2Mat(axes, np.array((w, x, y, z)))
    signs = np.stack(np.meshgrid((-1, 1), (-1, 1), (-1, 1)), axis=-1).reshape(-1, 3)
    return np.array(marker.pose.position) + signs * np.array(marker.scale) / 2 @ axes.reshape(3, 3).T


def test_what_is_fixed_is_drawn_where_it_is(scene: tuple[Any, Any]) -> None:
    model, data = scene

    found = {marker.ns: marker for marker in world_markers(model, data, "map", NOW).markers}

    assert set(found) == {"floor", "wall", "Beds", "Lamps", "Vases"}
    assert {marker.header for marker in found.values()} == {ros.Header(NOW, "map")}
    assert found["Beds"].type is MarkerType.SPHERE
    assert found["Beds"].scale == pytest.approx((0.6, 0.4, 0.2))
    assert found["Beds"].color == pytest.approx((0.6, 0.4, 0.2, 1.0))
    assert found["Lamps"].type is MarkerType.CYLINDER
    assert found["Lamps"].scale == pytest.approx((0.1, 0.1, 0.9))
    assert found["wall"].type is MarkerType.CUBE
    assert corners(found["wall"]).max(axis=0) == pytest.approx((2, 2.1, 2))
    assert found["wall"].color.a < 1
    mesh = corners(found["Vases"])
    assert mesh.min(axis=0) == pytest.approx((-1, -1, 0), abs=0.01)
    assert mesh.max(axis=0) == pytest.approx((-0.6, -0.8, 0.6), abs=0.01)
    # What lies on the floor is seen.
    assert -0.05 < corners(found["floor"])[:, 2].max() < 0


def test_the_robot_is_drawn_in_its_own_frame(scene: tuple[Any, Any]) -> None:
    model, data = scene
    body = model.body("bot").id

    arm = model.body("arm").id

    markers = robot_markers(model, data, {body: "base_link", arm: "arm"}, [model.body("wheel").id], NOW).markers

    assert {(marker.header.frame_id, model.geom(marker.id).name) for marker in markers} == {
        *(("base_link", f"bot/{name}") for name in ("hull", "mast", "tyre")),
        ("arm", "bot/arm"),
    }
    for marker in markers:
        assert marker.frame_locked
        frame = arm if marker.header.frame_id == "arm" else body
        place = data.xpos[frame] + data.xmat[frame].reshape(3, 3) @ marker.pose.position
        assert place == pytest.approx(data.geom_xpos[marker.id])


def visible(environment: IndoorNavigation) -> set[str]:
    environment.reset()
    robot, model = environment.robot, environment.physics.model.ptr
    body = environment.physics.model.ptr.body(f"{robot.prefix}{robot.base}").id
    shown = robot_markers(model, environment.physics.data.ptr, {body: "base_link"}, [], NOW).markers
    return {model.geom(marker.id).name for marker in shown}


def test_robots_hidden_from_their_own_lidar_are_drawn(make_context: Any) -> None:
    context = make_context()
    walker = ApplicationPlan(
        role="robot", name="walker", attribute="prefect_robomaker.tasks.runtime.applications.walker.make_agent"
    )
    assert len(visible(make_environment(context))) > 3
    assert visible(
        make_environment(replace(context, plan=context.plan.model_copy(update={"robot_application": walker})))
    )


def test_the_map_is_that_of_the_map_server(make_context: Any) -> None:
    known = read_map(make_context().world_dir / "map.yaml")

    grid = occupancy_grid(known, ros.Header(NOW, "map"))

    cells = np.frombuffer(grid.data, np.int8).reshape(grid.height, grid.width)
    assert (grid.resolution, grid.origin.position[:2]) == (0.05, (-2.5, -1.5))

    def at(x: float, y: float) -> int:
        return int(cells[int((y - grid.origin.position.y) / 0.05), int((x - grid.origin.position.x) / 0.05)])

    assert at(1.0, 0.0) == 0  # the hall
    assert at(2.0, 1.0) == 100  # a wall
    assert at(-2.3, 0.0) == -1  # outside
