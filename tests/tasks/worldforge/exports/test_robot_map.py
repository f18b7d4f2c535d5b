"""Maps of what robots of some height meet agree with the compiled world, cell by cell."""

from pathlib import Path

import mujoco
import numpy as np
import pytest
from helpers.written_maps import read_grid

from prefect_robomaker.tasks.worldforge.bundle.robot_map import robot_map, write_robot_map
from prefect_robomaker.tasks.worldforge.exports.export_scene import read_scene
from prefect_robomaker.tasks.worldforge.geometry.occupancy import ROBOT_LOW_M, OccupancyGrid

HEIGHTS = (0.1, 0.4, 1.2)
TOUCHING_M = 1e-4


def met(path: Path, like: OccupancyGrid, height_m: float) -> np.ndarray:
    """Cells in which something solid is: MuJoCo measures a box as large as the cell against every geom near it."""
    spec = mujoco.MjSpec.from_file(str(path))
    half = (like.resolution_m / 2, like.resolution_m / 2, (height_m - ROBOT_LOW_M) / 2)
    probe = spec.worldbody.add_body(name="probe", mocap=True)
    probe.add_geom(name="probe", type=mujoco.mjtGeom.mjGEOM_BOX, size=half, contype=0, conaffinity=0)
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    box, middle_m = model.geom("probe").id, (height_m + ROBOT_LOW_M) / 2
    found = np.zeros_like(like.occupied)
    for geom in np.flatnonzero(model.geom_contype | model.geom_conaffinity):
        if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_PLANE:
            continue
        x, y, _ = data.geom_xpos[geom]
        reach = float(model.geom_rbound[geom]) + like.resolution_m
        (south, west), (north, east) = like.cell((x - reach, y - reach)), like.cell((x + reach, y + reach))
        for row in range(max(south, 0), min(north + 1, found.shape[0])):
            for column in range(max(west, 0), min(east + 1, found.shape[1])):
                data.geom_xpos[box] = *(like.origin + (np.array([column, row]) + 0.5) * like.resolution_m), middle_m
                if mujoco.mj_geomDistance(model, data, box, int(geom), 0.01, None) < -TOUCHING_M:
                    found[row, column] = True
    return found


@pytest.fixture(scope="module")
def bundle(bundles: dict[str, Path]) -> Path:
    return next(iter(bundles.values()))


@pytest.mark.parametrize(
    "height_m", [pytest.param(height, marks=pytest.mark.deep if height != 0.4 else []) for height in HEIGHTS]
)
def test_at_most_a_twentieth_of_the_occupied_cells_disagrees_with_mujoco(bundle: Path, height_m: float) -> None:
    grid = robot_map(read_scene(bundle), height_m)
    expected = met(bundle / "world.xml", grid, height_m) & grid.known
    wrong = (grid.occupied != expected).sum()
    assert expected.sum() > 500
    assert wrong <= 0.05 * expected.sum(), f"{wrong} of {expected.sum()} cells"


def test_a_low_robot_drives_under_what_a_high_one_meets(bundle: Path) -> None:
    scene = read_scene(bundle)
    low, usual, high = (robot_map(scene, height) for height in HEIGHTS)
    assert (usual.occupied | ~low.occupied).all()
    assert (high.occupied | ~usual.occupied).all()
    table = next(item for item in scene.world.furniture if item.model_type == "CoffeeTables")
    under = low.cell((table.x, table.y))
    coarse = read_grid(bundle)
    assert coarse.occupied[under]
    assert low.free.sum() > usual.free.sum() > high.free.sum()
    assert usual.free.sum() > coarse.free.sum(), "legs are legs"


def test_the_file_says_how_high_the_robot_is(bundle: Path, tmp_path: Path) -> None:
    scene = read_scene(bundle)
    write_robot_map(scene, tmp_path, 0.25)
    assert (
        (tmp_path / "map.yaml").read_text().startswith("# what a robot 0.25 m high meets, from 0.02 m above the floor")
    )
    assert (read_grid(tmp_path).occupied == robot_map(scene, 0.25).occupied).all()
    with pytest.raises(ValueError, match=r"a robot 2\.5 m high: 0\.05 to 2 m would be right"):
        robot_map(scene, 2.5)
