import numpy as np
import pytest

from prefect_robomaker.tasks.runtime.applications.indoor_navigation import lidar
from prefect_robomaker.tasks.runtime.applications.scout.obstacles import (
    ObstacleMemory,
    free_ahead,
    near_hits,
    nearest_to_path,
    ray_directions,
)
from prefect_robomaker.tasks.runtime.applications.scout.planner import GridPlanner
from prefect_robomaker.tasks.runtime.episode.occupancy_map import OccupancyMap
from prefect_robomaker.tasks.runtime.robots.scout import LIDAR

RAYS = ray_directions(LIDAR.angles_rad)
NOTHING = np.full(lidar.PROXIMITY_ANGLES_RAD.shape, np.inf, np.float32)


@pytest.fixture
def memory() -> ObstacleMemory:
    free = np.zeros((80, 80), np.bool_)
    free[10:70, 10:70] = True
    return ObstacleMemory(GridPlanner(OccupancyMap(free, 0.05, (-2.0, -2.0)), 0.17))


def scan(**ranges: float) -> np.ndarray:
    """A scan with ranges ahead, left, behind."""
    rays = {"ahead": 180, "left": 270, "behind": 0}
    values = np.full(LIDAR.rays, np.inf, np.float32)
    for where, distance in ranges.items():
        values[rays[where]] = distance
    return values


def test_unknown_things_are_placed_in_the_map_and_walls_are_left_out(memory: ObstacleMemory) -> None:
    # Looking north from (0.5, 0): the wall at x = -1.5 is on the left, 2 m away; something stands 0.8 m ahead.
    seen = memory.see((0.5, 0.0, np.pi / 2), near_hits(RAYS, scan(ahead=0.8, left=1.55, behind=1.7), NOTHING), 1.0)
    assert seen == pytest.approx(np.array([[0.5, 0.8], [-1.05, 0.0]]), abs=1e-6)
    wall = memory.see((0.0, 0.0, np.pi / 2), near_hits(RAYS, scan(left=1.5), NOTHING), 1.0)
    assert len(wall) == 0


def test_the_bumpers_sensors_count_as_well(memory: ObstacleMemory) -> None:
    proximity = NOTHING.copy()
    proximity[7] = 0.4
    seen = memory.see((0.0, 0.0, 0.0), near_hits(RAYS, scan(), proximity), 1.0)
    assert seen == pytest.approx(np.array([[0.4, 0.0]]), abs=1e-6)


def test_things_are_forgotten_after_a_while(memory: ObstacleMemory) -> None:
    memory.see((0.0, 0.0, 0.0), near_hits(RAYS, scan(ahead=0.8), NOTHING), 1.0)
    assert len(memory.points(20.0)) == 1
    assert len(memory.points(40.0)) == 0


def test_free_way_ahead_is_measured_from_the_rim() -> None:
    assert free_ahead(near_hits(RAYS, scan(ahead=0.5), NOTHING), 0.17) == pytest.approx(0.33)
    assert free_ahead(near_hits(RAYS, scan(left=0.5, behind=0.3), NOTHING), 0.17) == np.inf


def test_distance_to_a_path() -> None:
    path = [(0.0, 0.0), (1.0, 0.0)]
    assert nearest_to_path(np.array([[1.0, 0.5], [3.0, 0.0]]), path) == pytest.approx(0.5)
    assert nearest_to_path(np.zeros((0, 2)), path) == np.inf
