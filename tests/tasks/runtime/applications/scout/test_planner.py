import numpy as np
import pytest
from helpers.examples import examples
from hypothesis import given
from hypothesis import strategies as st

from prefect_robomaker.tasks.runtime.applications.scout.planner import GridPlanner
from prefect_robomaker.tasks.runtime.episode.occupancy_map import OccupancyMap

RADIUS_M = 0.17


def two_rooms(door_m: float) -> OccupancyMap:
    """4 m x 2 m with a wall at x = 2 and a door in its middle."""
    free = np.zeros((44, 84), np.bool_)
    free[2:42, 2:82] = True
    free[:, 41:43] = False
    half = round(door_m / 0.05 / 2)
    free[22 - half : 22 + half, 41:43] = True
    return OccupancyMap(free, 0.05, (-0.1, -0.1))


def test_a_way_leads_through_the_middle_of_a_door() -> None:
    way = GridPlanner(two_rooms(0.9), RADIUS_M).plan((0.5, 0.4), (3.5, 0.4))
    assert way is not None
    assert way.kind == "free"
    in_door = way.path[np.abs(way.path[:, 0] - 2.0) < 0.06]
    assert np.abs(in_door[:, 1] - 1.0).max() < 0.12
    assert way.path[0].tolist() == [0.5, 0.4]
    assert np.hypot(*(way.path[-1] - (3.5, 0.4))) < 0.06


def test_a_door_that_just_fits_is_a_tight_way_and_a_narrower_one_none() -> None:
    tight = GridPlanner(two_rooms(0.4), RADIUS_M).plan((0.5, 0.4), (3.5, 0.4))
    assert tight is not None
    assert tight.kind == "tight"
    assert GridPlanner(two_rooms(0.3), RADIUS_M).plan((0.5, 0.4), (3.5, 0.4)) is None


def test_obstacles_are_driven_around_then_through_then_forgotten() -> None:
    planner = GridPlanner(two_rooms(0.9), RADIUS_M)
    planner.set_obstacles(np.array([[1.2, 1.0], [1.2, 1.05]]))
    around = planner.plan((0.5, 1.0), (1.7, 1.0))
    assert around is not None
    assert around.kind == "free"
    assert np.hypot(*(around.path - (1.2, 1.0)).T).min() >= RADIUS_M

    planner.set_obstacles(np.array([[2.0, 0.8], [2.0, 1.0], [2.0, 1.2]]))
    through = planner.plan((0.5, 1.0), (3.5, 1.0))
    assert through is not None
    assert through.kind == "pushing"

    planner.set_obstacles(np.zeros((0, 2)))
    free = planner.plan((0.5, 1.0), (3.5, 1.0))
    assert free is not None
    assert free.kind == "free"


def test_distances_are_symmetric_and_infinite_without_a_way() -> None:
    places = [(0.5, 0.4), (1.5, 1.5), (3.5, 0.4)]
    open_door = GridPlanner(two_rooms(0.9), RADIUS_M).distances(places)
    assert open_door == pytest.approx(open_door.T)
    assert np.isfinite(open_door).all()
    closed = GridPlanner(two_rooms(0.0), RADIUS_M).distances(places)
    assert np.isfinite(closed[0, 1])
    assert np.isinf(closed[0, 2])


inside = st.tuples(st.floats(0.25, 3.75), st.floats(0.25, 1.75)).filter(lambda spot: abs(spot[0] - 2.0) > 0.3)


@given(start=inside, goal=inside)
@examples(40)
def test_every_way_keeps_its_distance_and_has_no_gaps(start: tuple[float, float], goal: tuple[float, float]) -> None:
    planner = GridPlanner(two_rooms(0.9), RADIUS_M)
    way = planner.plan(start, goal)
    assert way is not None
    # Where the robot stands it stands; half a cell of grid is in both measures.
    assert planner.clearance_at(way.path[1:-1]).min(initial=np.inf) >= RADIUS_M - 0.05
    assert np.hypot(*np.diff(way.path, axis=0).T).max() < 0.11
