"""Content of an imported world's `world.json`: one area, walls and pieces as seen on its map, and its proofs."""

# MuJoCo ships no types for its compiled module.
# pyright: reportAttributeAccessIssue=false

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from ....schemas.worlds.description import DESCRIPTION_FILE
from ....schemas.worlds.world import (
    WORLD_FILE,
    Floorplan,
    Furniture,
    GazeboSource,
    Point,
    Room,
    RoomType,
    Wall,
    World,
    contains,
)
from ..bundle.bundle import MODEL_FILE
from ..bundle.survey import (
    LOW_M,
    Ground,
    bounds_of_geoms,
    in_the_way,
    nearest_cell,
    on_map,
    reached_cells,
    wall_boxes,
)
from ..furniture.catalogue import IMPORTED
from ..geometry.occupancy import RESOLUTION_M, OccupancyGrid, fill, map_files, room_cells
from ..geometry.slices import solid_outlines
from ..model.description import description_text
from ..pictures.plan_svg import floorplan_svg
from ..proofs.checks import Site, awake_scan, check_world
from ..proofs.guarantees import REST_S

AREA = "Area"
"""Name of the single room of an imported world without notes."""
ROBOT_RADIUS_M = 0.2

_FULL_SHARE = 0.5
"""Share of its bounding box that a piece must cover, seen from above, to be furniture.

A piece that covers less is building.
"""
_LOWEST_CEILING_M = 2.0
_HIGHEST_CEILING_M = 12.0


@dataclass(frozen=True, slots=True)
class Drawn:
    """A compiled imported world with its map and objects."""

    model: mujoco.MjModel
    data: mujoco.MjData
    ground: Ground
    grid: OccupancyGrid
    loose: Sequence[str]
    """Names of the imported world's bodies that move freely."""
    kinds: Mapping[str, str]
    """Kind of furniture of each piece of an imported world, by name."""
    fixed: Sequence[str]
    """Names of the imported world's pieces that never move."""
    rooms: Sequence["NamedArea"] = ()
    """Rooms of an imported world that the notes file names."""


class NamedArea(NamedTuple):
    """A room from the notes file, in the imported world's frame."""

    name: str
    type: RoomType
    polygon: list[Point]


def is_upright(polygon: Sequence[Point]) -> bool:
    """Whether all edges of a polygon run along x or y, to two centimetres."""
    edges = zip(polygon, [*polygon[1:], polygon[0]], strict=True)
    return all(min(abs(x0 - x1), abs(y0 - y1)) < 0.02 for (x0, y0), (x1, y1) in edges)


def world_of(drawn: Drawn, source: GazeboSource, generator: str) -> World:
    """Makes the world record (rooms, furniture, checks) of an imported Gazebo world.

    Args:
        drawn: The world.
        source: Origin of the world (file, hash).
        generator: Version of the generator.
    """
    rows, columns = np.nonzero(drawn.grid.known)
    x, y = drawn.grid.origin
    west, south = x + int(columns.min()) * RESOLUTION_M, y + int(rows.min()) * RESOLUTION_M
    east, north = x + (int(columns.max()) + 1) * RESOLUTION_M, y + (int(rows.max()) + 1) * RESOLUTION_M
    corners: list[Point] = [
        (round(u, 3), round(v, 3)) for u, v in ((west, south), (east, south), (east, north), (west, north))
    ]
    areas = drawn.rooms or [NamedArea(AREA, "Area", corners)]
    furniture, covered = _furniture(drawn, areas)
    rooms = [_room(area, drawn.grid) for area in areas]
    plan = Floorplan(
        footprint=corners,
        ceiling_height_m=_ceiling_m(drawn),
        rooms=rooms,
        walls=_walls(drawn.grid.occupied & ~covered & ~_movable(drawn), drawn.grid, rooms[0].name),
        passages=[],
        wishes=[],
    )
    world = World(
        generator_version=generator,
        floorplan_seed=0,
        interior_seed=0,
        floorplan=plan,
        furniture=furniture,
        wishes=[],
        source=source,
    )
    is_clear = in_the_way(drawn.ground, (0.0, 0.0)) is None
    site = Site(awake_scan(world, drawn.model), drawn.grid, drawn.grid, is_clear, is_planned=False)
    checks = check_world(world, site, robot_radius_m=ROBOT_RADIUS_M, settle_s=REST_S)
    return world.model_copy(update={"checks": checks})


def bundle_texts(world: World, mjcf: str, grid: OccupancyGrid) -> dict[str, bytes]:
    """Returns the files of an imported world's bundle besides meshes and pictures, by their names.

    Args:
        world: The world.
        mjcf: MJCF model of the world.
        grid: Occupancy grid of the world.
    """
    said = "what a robot 0.4 m high meets, from 0.03 m above the floor; all stands as at first"
    return {
        WORLD_FILE: world.to_text().encode(),
        MODEL_FILE: mjcf.encode(),
        "floorplan.svg": floorplan_svg(world).encode(),
        DESCRIPTION_FILE: description_text(world).encode(),
        **map_files(grid, said),
    }


def _room(area: NamedArea, grid: OccupancyGrid) -> Room:
    xs, ys = zip(*area.polygon, strict=True)
    edges = zip(area.polygon, [*area.polygon[1:], area.polygon[0]], strict=True)
    polygon = (
        [*area.polygon] if sum(x0 * y1 - x1 * y0 for (x0, y0), (x1, y1) in edges) > 0 else [*reversed(area.polygon)]
    )
    bare = Room(
        name=area.name,
        type=area.type,
        polygon=_squared(polygon),
        area_m2=round((max(xs) - min(xs)) * (max(ys) - min(ys)), 4),
        desired_area_m2=1.0,
        desired_aspect_ratio=1.0,
        goal=(0.0, 0.0),
    )
    inside = room_cells(grid, bare)
    free_m2 = round(float(np.count_nonzero(grid.free & inside)) * RESOLUTION_M**2, 4)
    goal = _goal(grid, inside, ((min(xs) + max(xs)) / 2, (min(ys) + max(ys)) / 2))
    update = {"floor_area_m2": free_m2, "desired_area_m2": max(free_m2, RESOLUTION_M**2), "goal": goal}
    return bare.model_copy(update=update)


def _squared(polygon: Sequence[Point]) -> list[Point]:
    """Returns the polygon with edges that run exactly along x or y."""
    found = [list(point) for point in polygon]
    for index in range(len(found)):
        before, here = found[index - 1], found[index]
        axis = 0 if abs(before[0] - here[0]) < abs(before[1] - here[1]) else 1
        here[axis] = before[axis]
    last, first = found[-1], found[0]
    axis = 0 if abs(last[0] - first[0]) < abs(last[1] - first[1]) else 1
    last[axis] = first[axis]
    return [(x, y) for x, y in found]


def _goal(grid: OccupancyGrid, inside: NDArray[np.bool_], middle: Point) -> Point:
    """Chooses a goal near the middle of a room that a robot of 30 cm radius reaches.

    Otherwise it is a point that a robot of 20 cm radius reaches, otherwise the middle.
    """
    for radius_m in (0.3, ROBOT_RADIUS_M):
        reached, _ = reached_cells(grid, radius_m)
        if (spot := nearest_cell(reached & inside, grid, middle)) is not None:
            return spot
    return round(middle[0], 3), round(middle[1], 3)


def _ceiling_m(drawn: Drawn) -> float:
    model, data = drawn.model, drawn.data
    solid = (model.geom_contype | model.geom_conaffinity != 0) & (model.geom_type != mujoco.mjtGeom.mjGEOM_PLANE)
    geoms = np.flatnonzero(solid)
    if not len(geoms):
        return _LOWEST_CEILING_M
    axes, boxes = data.geom_xmat[geoms].reshape(-1, 3, 3), model.geom_aabb[geoms]
    tops = (
        data.geom_xpos[geoms, 2] + (axes[:, 2] * boxes[:, :3]).sum(axis=1) + (np.abs(axes[:, 2]) * boxes[:, 3:]).sum(1)
    )
    return round(float(np.clip(tops.max(), _LOWEST_CEILING_M, _HIGHEST_CEILING_M)), 3)


def _movable(drawn: Drawn) -> NDArray[np.bool_]:
    """Returns the map cells that only movable objects occupy."""
    return on_map(drawn.ground.grid.occupied & ~drawn.ground.blocked, drawn.ground, drawn.grid)


def _walls(cells: NDArray[np.bool_], grid: OccupancyGrid, room: str) -> list[Wall]:
    """Converts occupied map cells to straight walls, for plans and pictures.

    There is at least one: if no cell is occupied, a wall of a millimetre at the map's origin.
    """
    found: list[Wall] = []
    for west, south, east, north in wall_boxes(cells, grid):
        if east - west >= north - south:
            middle = round((south + north) / 2, 4)
            start, end, thick = (west, middle), (east, middle), north - south
        else:
            middle = round((west + east) / 2, 4)
            start, end, thick = (middle, south), (middle, north), east - west
        found.append(Wall(start=start, end=end, thickness_m=round(thick, 4), exterior=False, rooms=[room]))
    if not found:  # plans of a world without any wall have one that is too small to be seen
        x, y = grid.origin
        found.append(Wall(start=(x, y), end=(x + 1e-3, y), thickness_m=1e-3, exterior=True, rooms=[room]))
    return found


def _furniture(drawn: Drawn, areas: Sequence[NamedArea]) -> tuple[list[Furniture], NDArray[np.bool_]]:
    """Returns the pieces that are shown as furniture by their outlines, and the map cells that they cover."""
    covered = np.zeros_like(drawn.grid.known)
    found: list[Furniture] = []
    names = _pieces_of_geoms(drawn.model)
    filled = _seen_from_above(drawn)
    ceiling_m = _ceiling_m(drawn)
    for piece in (*drawn.fixed, *drawn.loose):
        is_loose = piece in drawn.loose
        geoms = names.get(piece)
        if geoms is None:
            continue
        low, high = bounds_of_geoms(drawn.model, drawn.data, geoms)
        cells = _cells(drawn.grid, low, high)
        if high[2] < 0.03 or low[2] > ceiling_m or not cells.any() or not (cells & drawn.grid.known).any():
            continue
        wide, deep = (round(float(value), 3) for value in (high - low)[:2])
        if not is_loose:
            seen = filled.get(piece)
            if seen is None or np.count_nonzero(seen & cells) < _FULL_SHARE * np.count_nonzero(cells):
                continue
            covered |= np.asarray(ndimage.binary_dilation(cells), np.bool_)  # also the cells that it only touches
        x, y, _ = (float(value) for value in (low + high) / 2)
        found.append(
            Furniture(
                id=piece,
                model_type=drawn.kinds.get(piece, piece),
                style=IMPORTED,
                room=next((area.name for area in areas if contains(area.polygon, x, y)), areas[0].name),
                x=round(x, 3),
                y=round(y, 3),
                yaw=0.0,
                width_m=max(deep, 0.001),
                depth_m=max(wide, 0.001),
                height_m=round(max(float(high[2] - low[2]), 0.001), 3),
                base_m=round(float(low[2]), 3),
                movable=is_loose,
            )
        )
    return found, covered


def _seen_from_above(drawn: Drawn) -> dict[str, NDArray[np.bool_]]:
    """Returns the map cells that each piece covers below 2 m, by its name."""
    found: dict[str, NDArray[np.bool_]] = {}
    for geom, outline in solid_outlines(drawn.model, drawn.data, LOW_M, _LOWEST_CEILING_M):
        piece = drawn.model.geom(geom).name.partition(".")[0]
        fill(drawn.grid, found.setdefault(piece, np.zeros_like(drawn.grid.known)), outline)
    return found


def _pieces_of_geoms(model: mujoco.MjModel) -> dict[str, list[int]]:
    found: dict[str, list[int]] = {}
    for geom in np.flatnonzero(model.geom_contype | model.geom_conaffinity != 0):
        found.setdefault(model.geom(int(geom)).name.partition(".")[0], []).append(int(geom))
    return found


def _cells(grid: OccupancyGrid, low: NDArray[np.float64], high: NDArray[np.float64]) -> NDArray[np.bool_]:
    rows, columns = grid.known.shape
    x = grid.origin[0] + (np.arange(columns) + 0.5) * grid.resolution_m
    y = grid.origin[1] + (np.arange(rows) + 0.5) * grid.resolution_m
    return ((y >= low[1]) & (y <= high[1]))[:, None] & ((x >= low[0]) & (x <= high[0]))[None, :]
