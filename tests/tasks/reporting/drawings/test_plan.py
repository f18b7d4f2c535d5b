import math
import re
from typing import Any
from xml.etree import ElementTree

import pytest
from hypothesis import given
from hypothesis import strategies as st

from prefect_robomaker.schemas.runs.plan import Collision
from prefect_robomaker.schemas.worlds.world import MODEL_TYPES, Furniture, World
from prefect_robomaker.tasks.reporting.drawings import plan
from prefect_robomaker.tasks.reporting.drawings.lettering import Box, draw_label, largest_box
from prefect_robomaker.tasks.reporting.drawings.plan import draw_furniture
from prefect_robomaker.tasks.reporting.drawings.svg_writing import EXTENT, Frame
from prefect_robomaker.tasks.reporting.drawings.trajectory import SHADES, cluster, shaded_runs

_COORDINATE = st.floats(-50, 50).map(lambda value: round(value, 3))


@pytest.fixture
def world(make_world: Any) -> World:
    return World.model_validate_json(make_world().world_json.read_bytes())


def _parse(drawing: str) -> ElementTree.Element:
    return ElementTree.fromstring(drawing)


def _with_class(root: ElementTree.Element, name: str) -> list[ElementTree.Element]:
    return [node for node in root.iter() if name in node.get("class", "").split()]


def _collision(x: float, y: float, force: float, time_s: float = 1.0) -> Collision:
    return Collision(time_s=time_s, duration_s=0.1, x=x, y=y, other="wall", max_force_N=force)


@given(st.lists(st.tuples(_COORDINATE, _COORDINATE), min_size=1, max_size=20))
def test_a_frame_shows_every_point_with_north_up(points: list[tuple[float, float]]) -> None:
    frame = Frame.around(points)
    for x, y in map(frame.at, points):
        assert 0 < x < frame.width <= EXTENT + 1e-6
        assert 0 < y < frame.height
    north, south = frame.at((0, 1)), frame.at((0, 0))
    assert north[1] < south[1]


def test_walls_are_drawn_as_they_are_and_leave_doorways_open(world: World) -> None:
    frame = Frame.of_world(world)
    root = _parse(plan.draw_fixtures(world, frame, "w"))
    lines = [
        tuple(float(line.get(name, "")) for name in ("x1", "y1", "x2", "y2")) for line in _with_class(root, "walls")[0]
    ]
    assert len(lines) == len(world.floorplan.walls)
    door = world.floorplan.passages[0]
    x, y = frame.at(((door.start[0] + door.end[0]) / 2, door.start[1]))
    half = abs(door.end[0] - door.start[0]) / 2 * frame.scale
    for x1, y1, x2, y2 in lines:
        if abs(y1 - y) < 0.2 and abs(y2 - y) < 0.2:
            assert max(x1, x2) <= x - half + 0.2 or min(x1, x2) >= x + half - 0.2
    first = world.floorplan.walls[0]
    assert lines[0] == pytest.approx((*frame.at(first.start), *frame.at(first.end)), abs=0.06)


def test_the_areas_of_a_plan_are_those_inside_the_walls(world: World) -> None:
    rooms = [room.model_copy(update={"floor_area_m2": 1.5}) for room in world.floorplan.rooms]
    measured = world.model_copy(update={"floorplan": world.floorplan.model_copy(update={"rooms": rooms})})
    drawing = plan.draw_world_plan(measured, Frame.of_world(world), "w", "t")
    assert drawing.count("1.5 m²") == len(rooms)


def test_lintels_are_not_drawn(world: World) -> None:
    lintel = world.floorplan.walls[0].model_copy(update={"lintel": True, "bottom_m": 2.0})
    floorplan = world.floorplan.model_copy(update={"walls": [lintel, *world.floorplan.walls[1:]]})
    root = _parse(plan.draw_fixtures(world.model_copy(update={"floorplan": floorplan}), Frame.of_world(world), "w"))
    assert len(_with_class(root, "walls")[0]) == len(world.floorplan.walls) - 1


def test_a_job_plan_shows_where_the_robot_was(world: World, make_result: Any) -> None:
    result = make_result("FAIL", 12, hits=3)
    root = _parse(plan.draw_job_plan(world, Frame.of_world(world), "w", result, "Plan <1>"))
    visited = sum(room.visited for room in result.rooms)
    assert 0 < visited < len(result.rooms)
    assert len(_with_class(root, "visited")) == visited
    assert len(_with_class(root, "unvisited")) == len(result.rooms) - visited
    assert len(_with_class(root, "start")) == len(_with_class(root, "end")) == 1
    assert {f"shade-{i}" for i in range(SHADES)} <= {node.get("class") for node in root.iter("polyline")}
    forces = [node.findtext("text") for node in _with_class(root, "collision")]
    assert forces[0] == "105 N"
    assert root.get("aria-label") == "Plan <1>"


def test_rooms_are_called_what_their_users_called_them(world: World, make_result: Any) -> None:
    first, *others = world.floorplan.rooms
    rooms = [first.model_copy(update={"original_name": "Küche"}), *others]
    world = world.model_copy(update={"floorplan": world.floorplan.model_copy(update={"rooms": rooms})})
    frame = Frame.of_world(world)
    assert "Küche" in plan.draw_job_plan(world, frame, "w", make_result("PASS", 3), "t")
    assert "Küche" in plan.draw_open_plan(world, frame, "w", "t", "drive")
    assert "Küche" in plan.draw_world_plan(world, frame, "w", "t")


def test_the_start_mark_lies_where_the_robot_started(world: World, make_result: Any) -> None:
    result = make_result("PASS", 12)
    frame = Frame.of_world(world)
    root = _parse(plan.draw_job_plan(world, frame, "w", result, "t"))
    written = re.findall(r"-?[\d.]+", _with_class(root, "start")[0].get("transform", ""))
    assert [float(number) for number in written] == pytest.approx(frame.at(result.path[0][1:]), abs=0.06)


def test_a_diverged_path_is_drawn_as_far_as_it_goes(world: World, make_result: Any) -> None:
    result = make_result("FAIL", 3)
    broken = result.model_copy(
        update={
            "path": [*result.path, (9.0, math.nan, 0.0), (10.0, math.inf, 1.0), (10.5, 1e300, 0.0), (11.0, 9e3, 0.0)],
            "collisions": [_collision(math.nan, 0, 5)],
        }
    )
    drawing = plan.draw_job_plan(world, Frame.of_world(world), "w", broken, "t")
    assert "nan" not in drawing
    assert "inf" not in drawing
    assert "000000000" not in drawing
    assert plan.draw_bare_path(broken.model_copy(update={"path": [(0.0, math.nan, 0.0)]}), "t") is None


def test_a_robot_that_stood_still_has_marks_and_no_arrows(world: World, make_result: Any) -> None:
    still = make_result("FAIL", 3).model_copy(update={"path": [(0.0, 0.0, 0.0), (0.0, 0.0, 0.0)]})
    root = _parse(plan.draw_job_plan(world, Frame.of_world(world), "w", still, "t"))
    assert not _with_class(root, "arrow")
    assert _with_class(root, "start")


def test_a_bare_path_needs_no_world(make_result: Any) -> None:
    root = _parse(plan.draw_bare_path(make_result("PASS", 22), "t") or "")
    assert _with_class(root, "casing")


@pytest.mark.parametrize("model_type", [*MODEL_TYPES, "ball"])
def test_every_model_type_stays_inside_its_footprint(model_type: str) -> None:
    item = Furniture(
        id="a<b", model_type=model_type, room="r", x=1, y=2, yaw=0.5, width_m=1, depth_m=2, height_m=1, movable=True
    )  # fmt: skip
    root = _parse(draw_furniture(item, Frame.around([(0, 0), (5, 5)])))
    assert root.findtext("title") == "a<b"
    scale = Frame.around([(0, 0), (5, 5)]).scale
    for box in root.iter("rect"):
        x, width = float(box.get("x", "")), float(box.get("width", ""))
        assert -scale - 0.1 <= x <= x + width <= scale + 0.1


def test_collisions_close_together_become_one_mark_hardest_first() -> None:
    spots = cluster([_collision(0, 0, 5, 1), _collision(3, 3, 9, 2), _collision(0.1, 0.1, 7, 3)])
    assert [(spot.x, spot.force_N, len(spot.collisions)) for spot in spots] == [(3, 9, 1), (0.1, 7, 2)]
    assert spots[1].text == "wall: 5.0 N at 1.0 s\nwall: 7.0 N at 3.0 s"


@given(st.lists(st.tuples(_COORDINATE, _COORDINATE, st.floats(0, 500)), max_size=40))
def test_clustering_loses_no_collision(places: list[tuple[float, float, float]]) -> None:
    collisions = [_collision(x, y, force) for x, y, force in places]
    assert sum(len(spot.collisions) for spot in cluster(collisions)) == len(collisions)


@given(st.lists(st.tuples(st.floats(0, 500), _COORDINATE, _COORDINATE), min_size=2, max_size=60))
def test_shaded_runs_join_up_to_the_whole_path(path: list[tuple[float, float, float]]) -> None:
    path.sort()
    runs = shaded_runs(path)
    joined = [runs[0][1][0]] + [point for _, run in runs for point in run[1:]]
    assert joined == [(x, y) for _, x, y in path]
    shades = [shade for shade, _ in runs]
    assert shades == sorted(shades)
    assert 0 <= shades[0] <= shades[-1] < SHADES


def test_the_largest_box_of_a_corner_room_lies_inside_it() -> None:
    corner = [(0.0, 0.0), (5.0, 0.0), (5.0, 2.0), (2.0, 2.0), (2.0, 6.0), (0.0, 6.0)]
    assert largest_box(corner) == Box(0, 0, 2, 6)


def test_a_polygon_of_very_many_corners_is_not_searched() -> None:
    circle = [(math.cos(i / 100), math.sin(i / 100)) for i in range(628)]
    box = largest_box(circle)
    assert (box.left, box.right) == pytest.approx((-1, 1), abs=1e-3)


def test_labels_are_shortened_turned_and_moved_to_fit() -> None:
    frame = Frame.around([(0, 0), (10, 10)])
    wide = [(0.0, 0.0), (9.0, 0.0), (9.0, 5.0), (0.0, 5.0)]
    narrow = [(0.0, 0.0), (1.0, 0.0), (1.0, 9.0), (0.0, 9.0)]
    tiny = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)]
    assert "rotate" not in draw_label("Living room", "20 m²", wide, frame)
    assert "rotate(-90)" in draw_label("Living room", "", narrow, frame)
    short = _parse(draw_label("A very long name <b>", "note", tiny, frame))
    assert short.findtext("title") == "A very long name <b>"
    assert (short.findtext("text") or "").endswith("…")
    middle = frame.at((4.5, 2.5))
    moved = draw_label("Living room", "", wide, frame, crowd=[middle] * 3)
    assert f"translate({middle[0]:.1f} {middle[1]:.1f})" not in moved
