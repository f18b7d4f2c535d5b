import mujoco
import numpy as np
from helpers.examples import examples
from hypothesis import assume, given
from hypothesis import strategies as st

from prefect_robomaker.tasks.runtime.applications.indoor_navigation import lidar
from prefect_robomaker.tasks.runtime.applications.indoor_navigation.world_with_robot import ScenePhysics, assemble
from prefect_robomaker.tasks.runtime.robots.scout import LIDAR

LOOSE = [("Ball_1", 1.5, -0.4, 0.1), ("Box_1", 2.6, 0.4, 0.2)]
GROUND = '<geom name="drawn" type="box" pos="1 0 0.13" size=".1 .1 .1" contype="0" conaffinity="0" group="2"/>'


def single_rays(physics: ScenePhysics, angles: np.ndarray) -> np.ndarray:
    """What `mj_ray` says, one ray after the other, trying every solid geom of the world."""
    model, data = physics.model.ptr, physics.data.ptr
    body = model.body("scout/base").id
    origin = data.xpos[body] + (0, 0, LIDAR.height_m)
    yaw = np.arctan2(data.xmat[body][3], data.xmat[body][0])
    geom = np.zeros(1, np.int32)
    distances = []
    for angle in angles:
        ray = np.array((np.cos(angle + yaw), np.sin(angle + yaw), 0.0))
        distances.append(mujoco.mj_ray(model, data, origin, ray, None, True, body, geom))
    found = np.array(distances)
    return np.where((found >= 0) & (found <= LIDAR.range_max_m), found, np.inf)


def test_agrees_with_single_rays_everywhere(make_context) -> None:
    world_dir = make_context(loose=LOOSE, clutter=60).world_dir
    physics = assemble(world_dir / "world.xml")
    model, data = physics.model.ptr, physics.data.ptr
    body = model.body("scout/base").id
    finder = lidar.RangeFinder(
        model, data, body, LIDAR.height_m, LIDAR.angles_rad, LIDAR.range_max_m, physics.unseen_group
    )
    start = model.joint("scout/base").qposadr[0]

    @given(st.floats(-1.5, 5.5), st.sampled_from([-0.5, 0.0, 0.6, 1.7, 2.5, 3.8]), st.floats(-3.1, 3.1))
    @examples(12)
    def agrees(x: float, y: float, yaw: float) -> None:
        # Off the grid that furniture stands on: a ray along an edge may hit or miss, and both are right.
        x, y, yaw = x + 0.00137, y + 0.00071, yaw + 0.00113
        data.qpos[start : start + 7] = (x, y, 0, np.cos(yaw / 2), 0, 0, np.sin(yaw / 2))
        mujoco.mj_forward(model, data)
        expected = single_rays(physics, LIDAR.angles_rad)
        assume(expected.min() > 0.15)  # its own radius: no robot stands inside a thing, where rays begin differently
        np.testing.assert_allclose(finder.measure(), expected, atol=1e-9)

    agrees()


def test_sees_what_moves_and_not_what_is_only_drawn(make_context) -> None:
    path = make_context(loose=[("Box_1", -1.0, 0.0, 0.2)]).world_dir / "world.xml"
    path.write_text(path.read_text().replace("<worldbody>", f"<worldbody>{GROUND}"))
    physics = assemble(path)
    model, data = physics.model.ptr, physics.data.ptr
    finder = lidar.RangeFinder(
        model, data, model.body("scout/base").id, LIDAR.height_m, np.array([0.0, np.pi]), 8.0, physics.unseen_group
    )
    ahead, behind = finder.measure()
    assert ahead > 5.0
    assert abs(behind - 0.8) < 1e-3


def test_pictures_stay_the_same_because_only_visible_groups_are_used(make_context) -> None:
    path = make_context(clutter=60).world_dir / "world.xml"
    physics = assemble(path)
    groups = physics.model.ptr.geom_group
    assert physics.unseen_group in (1, 2)
    assert set(groups.tolist()) <= {0, 1, 2}
    assert (groups == physics.unseen_group).sum() > 40
