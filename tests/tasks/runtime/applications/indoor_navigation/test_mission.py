import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from prefect_robomaker.schemas.runs.requirement_kinds.off import IN_ROOMS
from prefect_robomaker.schemas.worlds.world import Room, contains
from prefect_robomaker.tasks.runtime.applications.indoor_navigation.mission import Mission
from prefect_robomaker.tasks.runtime.applications.indoor_navigation.telemetry import RobotState
from prefect_robomaker.tasks.runtime.episode.run_results import thin_out

L_SHAPE = [(0.0, 0.0), (4.0, 0.0), (4.0, 2.0), (2.0, 2.0), (2.0, 4.0), (0.0, 4.0)]


def room(name: str, polygon: list[tuple[float, float]]) -> Room:
    return Room(
        name=name, type="Living", polygon=polygon, area_m2=1.0, desired_area_m2=1.0, desired_aspect_ratio=1.0,
        goal=polygon[0],
    )  # fmt: skip


def at(time_s: float, x: float, y: float) -> RobotState:
    return RobotState(time_s, x, y, 0.0, 0.0, 0.0, (0.0, 0.0), (0.0, 0.0))


@pytest.mark.parametrize(("x", "y", "inside"), [(1, 1, True), (3, 1, True), (1, 3, True), (3, 3, False), (5, 1, False)])
def test_points_in_an_l_shaped_room(x: float, y: float, inside: bool) -> None:
    assert contains(L_SHAPE, x, y) is inside


def test_a_room_counts_from_the_first_time_the_robot_is_inside() -> None:
    mission = Mission([room("L", L_SHAPE), room("other", [(2, 2), (4, 2), (4, 4), (2, 4)])], 100.0)
    assert mission.update(at(0.0, -1.0, 0.0), 0.0) == 0
    assert mission.update(at(1.0, 1.0, 1.0), 0.0) == 1
    assert mission.update(at(2.0, 3.0, 1.0), 0.0) == 0
    assert not mission.all_visited
    assert mission.update(at(3.0, 3.0, 3.0), 0.0) == 1
    report = mission.report([], 0, 0.0)
    assert [(visit.name, visit.first_visit_s) for visit in report.rooms] == [("L", 1.0), ("other", 3.0)]
    assert report.verdict == "PASS"
    assert report.metrics["distance_m"] == pytest.approx(5**0.5 + 2 + 2, abs=1e-3)


@pytest.mark.parametrize(("tilt", "force", "name"), [(1.0, 0.0, "upright"), (0.0, 20.1, "no_hard_collision")])
def test_each_requirement_can_fail_the_run(tilt: float, force: float, name: str) -> None:
    mission = Mission([room("L", L_SHAPE), room("far", [(8, 8), (9, 8), (9, 9)])], 100.0)
    mission.update(at(9.0, 1.0, 1.0), tilt)
    report = mission.report([], 1, force)
    failed = {item.name: item.detail for item in report.requirements if not item.satisfied}
    assert set(failed) == {"rooms_visited", name}
    assert tuple(item.name for item in report.requirements) == IN_ROOMS, "requests are checked by these names"
    assert failed["rooms_visited"] == "not visited: far"
    assert all(detail in report.summary for detail in failed.values())


def test_time_is_for_visiting_rooms_and_no_requirement_of_its_own() -> None:
    """A job that switches `rooms_visited` off failed all the same, as its rooms were not visited in time."""
    mission = Mission([room("L", L_SHAPE), room("far", [(8, 8), (9, 8), (9, 9)])], 100.0)
    mission.update(at(100.0, 1.0, 1.0), 0.0)
    failed = {each.name: each.detail for each in mission.report([], 1, 0.0).requirements if not each.satisfied}
    assert failed == {"rooms_visited": "not visited: far; the time limit of 100 s was reached"}


@given(st.integers(1, 3000), st.integers(2, 700))
def test_a_thinned_path_keeps_its_ends_and_its_order(count: int, limit: int) -> None:
    path = [(float(index), 0.0, 0.0) for index in range(count)]
    thin = thin_out(path, limit)
    assert len(thin) == min(count, limit)
    assert (thin[0], thin[-1]) == (path[0], path[-1])
    assert all(a[0] < b[0] for a, b in itertools.pairwise(thin))
