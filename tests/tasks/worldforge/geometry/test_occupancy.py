"""The occupancy grid agrees with the walls and furniture it was drawn from, and survives its files."""

import json
from math import cos, pi, sin
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.examples import examples
from helpers.written_maps import read_grid
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image
from scipy import ndimage

from prefect_robomaker.schemas.templates.parsing import parse_template_body
from prefect_robomaker.schemas.worlds.world import Floorplan, Furniture
from prefect_robomaker.tasks.worldforge.floorplans.floorplan import generate_floorplan
from prefect_robomaker.tasks.worldforge.geometry.occupancy import (
    OccupancyGrid,
    fitting,
    occupancy_grid,
    reachable,
    room_cells,
    write_map,
)

ROOMS = [("Living", 26, 3), ("Kitchen", 12, 1), ("Bedroom", 16, 1), ("Bathroom", 10, 1)]


def plan(seed: int = 0) -> Floorplan:
    rooms = [
        {"Type": kind, "Name": kind, "DesiredShape": {"Area": area, "AspectRatio": {"x": ratio, "y": 1}}}
        for kind, area, ratio in ROOMS
    ]
    body = json.dumps({"Buildings": [{"Floors": [{"Floorplan": {"Rooms": rooms}}]}]})
    return generate_floorplan(parse_template_body(body), seed)


def piece(x: float = 0, y: float = 0, yaw: float = 0, **changes: float) -> Furniture:
    sizes: dict[str, Any] = {"width_m": 1.0, "depth_m": 0.5, "height_m": 0.8} | changes
    return Furniture(id="f", model_type="Desks", room="Living", x=x, y=y, yaw=yaw, **sizes)


def centers(grid: OccupancyGrid) -> tuple[np.ndarray, np.ndarray]:
    rows, columns = grid.occupied.shape
    x, y = (
        start + (np.arange(count) + 0.5) * grid.resolution_m
        for start, count in zip(grid.origin, (columns, rows), strict=True)
    )
    return np.meshgrid(x, y)


@examples(15)
@given(st.integers(0, 10_000))
def test_cells_are_occupied_exactly_where_a_wall_stands(seed: int) -> None:
    floorplan = plan(seed)
    grid = occupancy_grid(floorplan)
    x, y = centers(grid)
    expected = np.zeros_like(grid.occupied)
    for wall in floorplan.walls:
        if not wall.lintel:
            (x0, y0), (x1, y1) = sorted((wall.start, wall.end))
            half_x, half_y = (wall.thickness_m / 2, 0) if x0 == x1 else (0, wall.thickness_m / 2)
            expected |= (x0 - half_x < x) & (x < x1 + half_x) & (y0 - half_y < y) & (y < y1 + half_y)
    assert (grid.occupied == expected).all()


def test_only_the_building_is_known() -> None:
    floorplan = plan()
    grid = occupancy_grid(floorplan)
    assert len(floorplan.footprint) > 4, "the yard where it is set back is not known"
    building = grid.occupied.copy()
    for room in floorplan.rooms:
        building |= room_cells(grid, room)
    assert (grid.known == building).all()
    assert not grid.known[0].any()
    assert not (grid.occupied & ~grid.known).any()


@examples(40)
@given(x=st.floats(-1, 1), y=st.floats(-1, 1), yaw=st.floats(-7, 7), width=st.floats(0.05, 2), depth=st.floats(0.05, 1))
def test_furniture_occupies_every_cell_it_enters_and_no_other(
    x: float, y: float, yaw: float, width: float, depth: float
) -> None:
    bare = occupancy_grid(EMPTY)
    grid = occupancy_grid(EMPTY, [piece(x, y, yaw, width_m=width, depth_m=depth)])
    added = grid.occupied & ~bare.occupied
    # Points all over the footprint, moved to the world's frame: their cells must be occupied.
    along, across = np.meshgrid(np.linspace(-0.499, 0.499, 41) * depth, np.linspace(-0.499, 0.499, 81) * width)
    points_x = x + along * cos(yaw) - across * sin(yaw)
    points_y = y + along * sin(yaw) + across * cos(yaw)
    for point in zip(points_x.flat, points_y.flat, strict=True):
        assert grid.occupied[grid.cell(point)]
    # And no cell is occupied whose middle is farther from the footprint than half a cell's diagonal.
    cell_x, cell_y = centers(grid)
    front = (cell_x - x) * cos(yaw) + (cell_y - y) * sin(yaw)
    side = -(cell_x - x) * sin(yaw) + (cell_y - y) * cos(yaw)
    away = np.hypot(np.maximum(0, np.abs(front) - depth / 2), np.maximum(0, np.abs(side) - width / 2))
    assert away[added].max(initial=0) <= 0.05 / 2**0.5 + 1e-6


EMPTY = generate_floorplan(
    parse_template_body(
        '{"Buildings":[{"Floors":[{"Floorplan":{"Rooms":[{"Type":"Living","Name":"Hall",'
        '"DesiredShape":{"Area":64,"AspectRatio":{"x":1,"y":1}}}]}}]}]}'
    ),
    0,
)
"""One empty hall, 8 m by 8 m, around the origin."""


@pytest.mark.parametrize(
    ("changes", "seen"),
    [
        ({"base_m": 0.0, "height_m": 0.015}, False),
        ({"base_m": 0.0, "height_m": 0.03}, True),
        ({"base_m": 0.39, "height_m": 0.1}, True),
        ({"base_m": 0.4, "height_m": 0.1}, False),
    ],
)
def test_only_what_a_robot_meets_is_an_obstacle(changes: dict[str, float], seen: bool) -> None:
    grid = occupancy_grid(EMPTY, [piece(**changes)])
    assert grid.occupied[grid.cell((0.01, 0.01))] == seen


def test_legs_passed_as_polygons_leave_the_space_between_them() -> None:
    leg = [(0.5, 0.5), (0.55, 0.5), (0.55, 0.55), (0.5, 0.55)]
    grid = occupancy_grid(EMPTY, polygons=[leg])
    added = grid.occupied & ~occupancy_grid(EMPTY).occupied
    assert added.sum() == 1
    assert added[grid.cell((0.525, 0.525))]


def test_maps_survive_their_files(tmp_path: Path) -> None:
    grid = occupancy_grid(plan(3), [piece(0.3, 0.2, 0.7)])
    write_map(grid, tmp_path)
    again = read_grid(tmp_path)
    assert again.origin == grid.origin
    assert again.resolution_m == grid.resolution_m
    assert (again.occupied == grid.occupied).all()
    assert (again.known == grid.known).all()


def test_the_map_server_reads_free_occupied_and_unknown_as_meant(tmp_path: Path) -> None:
    """Applies the rule of Nav2's map server (mode trinary) to the files."""
    grid = occupancy_grid(plan(3))
    write_map(grid, tmp_path)
    settings_of = dict(line.split(": ", 1) for line in (tmp_path / "map.yaml").read_text().splitlines())
    with Image.open(tmp_path / "map.pgm") as image:
        assert image.format == "PPM"
        occupancy = 1 - np.asarray(image)[::-1] / 255
    occupied = occupancy > float(settings_of["occupied_thresh"])
    free = occupancy < float(settings_of["free_thresh"])
    assert (occupied == grid.occupied).all()
    assert (free == grid.free).all()
    assert settings_of["mode"] == "trinary"
    assert json.loads(settings_of["origin"]) == [*grid.origin, 0.0]


def test_rooms_share_out_the_cells_of_the_footprint() -> None:
    floorplan = plan(5)
    grid = occupancy_grid(floorplan)
    for item in floorplan.rooms:
        assert room_cells(grid, item).sum() * 0.05**2 == pytest.approx(item.area_m2)
    assert sum(room_cells(grid, room).sum() for room in floorplan.rooms) * 0.05**2 == pytest.approx(
        sum(item.area_m2 for item in floorplan.rooms)
    )


@examples(10)
@given(st.integers(0, 10_000))
def test_a_robot_reaches_every_room_of_an_empty_plan(seed: int) -> None:
    floorplan = plan(seed)
    grid = occupancy_grid(floorplan)
    cells = reachable(grid, (0.0, 0.0), 0.3)
    assert all((cells & room_cells(grid, room)).any() for room in floorplan.rooms)
    assert not (cells & ~grid.free).any()


def test_a_disc_passes_a_gap_as_wide_as_itself_and_no_narrower_one() -> None:
    # Two cupboards leave a gap of exactly 0.6 m between them, in an 8 m hall that they divide.
    cupboards = [piece(0, y, width_m=4.0, depth_m=0.4) for y in (2.3, -2.3)]
    grid = occupancy_grid(EMPTY, cupboards)
    west, east = (-2.0, 0.025), (2.0, 0.025)
    assert reachable(grid, west, 0.275)[grid.cell(east)]
    assert not reachable(grid, west, 0.325)[grid.cell(east)]


def test_nothing_is_reachable_from_inside_an_obstacle_or_outside_the_map() -> None:
    grid = occupancy_grid(EMPTY, [piece()])
    assert not reachable(grid, (0.0, 0.0), 0.2).any()
    assert not reachable(grid, (99.0, 0.0), 0.2).any()
    assert reachable(grid, (2.0, 2.0), 0.2).any()


def test_a_turned_desk_lies_where_its_yaw_says() -> None:
    grid = occupancy_grid(EMPTY, [piece(yaw=pi / 2, width_m=2.0, depth_m=0.2)])
    assert grid.occupied[grid.cell((0.9, 0.0))]
    assert not grid.occupied[grid.cell((0.0, 0.9))]


@pytest.mark.parametrize("radius", [0.05, 0.1, 0.2, 0.23, 0.35, 0.6])
def test_a_disc_fits_where_the_distance_to_what_is_not_free_is_its_radius(radius: float) -> None:
    grid = occupancy_grid(EMPTY, [piece(0.3, 0.2, 0.7), piece(-1.0, 0.8, 0.0)])
    distance = np.asarray(ndimage.distance_transform_edt(grid.free)) * grid.resolution_m
    # To the face of the nearest cell, from the middle of each.
    assert (fitting(grid, radius) == (grid.free & (distance - grid.resolution_m / 2 >= radius - 5e-4))).all()
