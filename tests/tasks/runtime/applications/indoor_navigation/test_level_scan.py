from collections.abc import Iterator
from pathlib import Path

import mujoco
import numpy as np
import pytest
from helpers.small_flat import BODY

from prefect_robomaker.schemas.templates.body import WorldTemplateBody
from prefect_robomaker.tasks.runtime.applications.indoor_navigation import lidar
from prefect_robomaker.tasks.runtime.applications.indoor_navigation.world_with_robot import ScenePhysics, assemble
from prefect_robomaker.tasks.runtime.episode.occupancy_map import read_map
from prefect_robomaker.tasks.runtime.robots.scout import LIDAR
from prefect_robomaker.tasks.worldforge.bundle.bundle import write_bundle
from prefect_robomaker.tasks.worldforge.generator import generate_world, seeds_for

SHAPES = """
  <geom name="column" type="cylinder" pos="1.2 0.3 0.5" size="0.05 0.5"/>
  <geom name="turned" type="box" pos="1.5 -0.4 0.3" size="0.2 0.1 0.3" euler="0 0 33"/>
  <geom name="low" type="box" pos="-0.9 0.4 0.07" size="0.1 0.1 0.07"/>
  <geom name="leaning" type="box" pos="3.1 0.5 0.3" size="0.05 0.2 0.5" euler="0 20 0"/>
  <geom name="round" type="ellipsoid" pos="-1.2 -0.4 0.2" size="0.2 0.1 0.2"/>
  <geom name="lying" type="cylinder" pos="2.4 -0.6 0.13" size="0.1 0.2" euler="90 0 20"/>
  <geom name="glass" type="box" pos="0.9 0 0.5" size="0.01 0.5 0.5" rgba="1 1 1 0"/>
"""


def finder_in(physics: ScenePhysics) -> lidar.RangeFinder:
    model, data = physics.model.ptr, physics.data.ptr
    body = model.body("scout/base").id
    return lidar.RangeFinder(
        model, data, body, LIDAR.height_m, LIDAR.angles_rad, LIDAR.range_max_m, physics.unseen_group
    )


def stand(
    physics: ScenePhysics, x: float, y: float, yaw: float, tilt_rad: float = 0.0, towards_rad: float = 0.0
) -> None:
    model, data = physics.model.ptr, physics.data.ptr
    start = model.joint("scout/base").qposadr[0]
    turn, tilt = np.zeros(4), np.zeros(4)
    mujoco.mju_axisAngle2Quat(turn, (0, 0, 1), yaw)
    mujoco.mju_axisAngle2Quat(tilt, (np.cos(towards_rad), np.sin(towards_rad), 0), tilt_rad)
    data.qpos[start : start + 3] = x, y, 0
    mujoco.mju_mulQuat(data.qpos[start + 3 : start + 7], turn, tilt)
    mujoco.mj_kinematics(model, data)


def level_and_cast(finder: lidar.RangeFinder) -> tuple[np.ndarray, np.ndarray]:
    """Both ways to measure; infinite is a number here, so that they can be subtracted."""
    assert finder._level is not None
    level = finder._level.measure()
    assert level is not None
    return np.minimum(level, 9.0), np.minimum(finder.cast(), 9.0)


def free_places(folder: Path, rng: np.random.Generator, count: int) -> Iterator[tuple[float, float]]:
    known = read_map(folder / "map.yaml")
    centers = known.centers(*np.nonzero(known.free))
    for x, y in centers[rng.integers(len(centers), size=count)] + rng.uniform(-0.025, 0.025, (count, 2)):
        yield float(x), float(y)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_agrees_with_mujoco_in_generated_worlds_while_the_robot_rocks(seed: int, tmp_path: Path) -> None:
    folder = tmp_path / "world"
    write_bundle(generate_world(WorldTemplateBody.model_validate(BODY), *seeds_for(seed, 0, 0)), folder)
    physics, rng = assemble(folder / "world.xml"), np.random.default_rng(seed)
    finder = finder_in(physics)
    for x, y in free_places(folder, rng, 60):
        stand(physics, x, y, rng.uniform(-3, 3), rng.uniform(0, 0.0075), rng.uniform(-3, 3))
        level, cast = level_and_cast(finder)
        np.testing.assert_allclose(level, cast, atol=1e-3)


def test_agrees_with_mujoco_about_every_shape_fixed_and_moving(make_context) -> None:
    path = make_context(loose=[("Box_1", 0.6, -0.6, 0.1), ("Box_2", 3.6, 0.2, 0.2)]).world_dir / "world.xml"
    path.write_text(path.read_text().replace("<worldbody>", f"<worldbody>{SHAPES}"))
    physics, rng = assemble(path), np.random.default_rng(1)
    finder = finder_in(physics)
    data, joint = physics.data.ptr, physics.model.ptr.body("Box_1").jntadr[0]
    address = physics.model.ptr.jnt_qposadr[joint]
    met = set()
    for _ in range(60):
        data.qpos[address : address + 3] = rng.uniform(-1.5, 5), rng.uniform(-0.7, 0.7), 0.1
        stand(physics, rng.uniform(-1.5, 5), rng.uniform(-0.7, 0.7), rng.uniform(-3, 3), 0.005, rng.uniform(-3, 3))
        level, cast = level_and_cast(finder)
        if cast.min() < 0.2:  # within something, where no robot can be
            continue
        np.testing.assert_allclose(level, cast, atol=1e-3)
        met |= {physics.model.ptr.geom(geom).name for geom in finder._geom_ids[cast < 9].tolist()}
    assert met >= {"column", "turned", "low", "leaning", "round", "lying", "Box_1/body", "Box_2/body"}
    assert "glass" not in met


def test_leaves_a_tilted_robot_to_mujoco(make_context) -> None:
    physics = assemble(make_context().world_dir / "world.xml")
    finder = finder_in(physics)
    stand(physics, 0.301, 0.202, 0.4, tilt_rad=0.05)
    assert finder._level is not None
    assert finder._level.measure() is None
    np.testing.assert_array_equal(finder.measure(), finder.cast())


def test_leaves_worlds_with_endless_slopes_to_mujoco(make_context) -> None:
    path = make_context().world_dir / "world.xml"
    slope = '<geom name="slope" type="plane" pos="1 0 0" size="0 0 1" zaxis="-1 0 1"/>'
    path.write_text(path.read_text().replace("<worldbody>", f"<worldbody>{slope}"))
    finder = finder_in(assemble(path))
    assert finder._level is None
    assert finder.measure()[180] == pytest.approx(1.13, abs=0.02)
