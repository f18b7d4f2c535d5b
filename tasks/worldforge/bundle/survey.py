"""Occupancy map of a world without a floor plan, computed from its MuJoCo model: floor, free start position, obstacles.

The map shows the floor cells that are connected to the start without a fixed thing between, and the faces of obstacles
around them. Doors and loose objects do not separate cells, as robots push these.
"""

# MuJoCo ships no types for its compiled module.
# pyright: reportAttributeAccessIssue=false

from dataclasses import dataclass
from math import ceil, floor

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from ....schemas.worlds.world import Point
from ..geometry.occupancy import RESOLUTION_M, ROBOT_HIGH_M, OccupancyGrid, connected, fill, fitting
from ..geometry.slices import solid_outlines

LOW_M = 0.03
"""Height above the floor at which a map's slice begins, in metres.

Floors of meshes and thresholds are not level to the centimetre.
"""
START_RADIUS_M = 0.5
"""Radius that is free of obstacles around the start, in metres, as in every generated world."""

_ABOVE_FLOOR_M = 0.5
"""Height from which the floor is searched downwards, in metres.

It is below most table tops, and above floors that are not quite at 0.
"""
_NEAR_M = 0.3
"""Height above the stated floor height from which the floor is searched downwards, in metres.

Robots are put down a little above floors.
"""
_HEADROOM_M = 1.0
"""Free height that a floor found from above must have above it, in metres; below tables and decks there is less."""
_MOST_SURFACES = 64
"""Limit of the surfaces above each other that are examined at one point."""
_SKIN_M = 1e-3
_DEEPEST_M = 3.0
_FLOOR_BAND_M = (-0.05, LOW_M)
"""Range of heights around the floor, in metres, in which a surface counts as floor that a robot can drive on."""
_LEAST_FLOOR_NORMAL = 0.1
"""Upward part of a plane's normal below which the plane is a wall and no floor."""
_MARGIN_M = 1.0
_MOST_SIDE_M = 200.0
"""Limit of the side of an occupancy map, in metres; 4,000 cells."""
_BARE_SIDE_M = 20.0
"""Side of the map of a world that consists of an infinite plane only, in metres."""
_SEEN_DEPTH_M = 1.5
"""Depth in metres to which objects behind a visible face are drawn on the map; walls behind beds then are, too."""
_HOLLOW = 3
"""Half of the width of hollow walls that are filled on the map, in cells: 30 cm are closed."""
_BOX = np.ones((3, 3), np.bool_)
_BORDER_M = 0.5
"""Width of the unknown border around the known cells, in metres, so that a map shows outer walls whole."""
_LEAST_AREA_M2 = 2.0
"""Smallest floor area that a robot must reach from a start that was chosen automatically, in square metres."""
_STEPS = 40


@dataclass(frozen=True, slots=True)
class Ground:
    """Grid of a world at one floor height: cells with floor, and cells with obstacles."""

    grid: OccupancyGrid
    """Occupancy grid with all obstacles; no cell is marked as free yet."""
    supported: NDArray[np.bool_]
    """Mask of the map cells that have a floor."""
    owners: NDArray[np.int32]
    """Id of the geom that occupies each map cell; -1: none."""
    blocked: NDArray[np.bool_]
    """Mask of the map cells that a fixed object occupies."""

    @property
    def free(self) -> NDArray[np.bool_]:
        """Mask of the map cells with a floor and without an obstacle."""
        return self.supported & ~self.grid.occupied


def floor_under(model: mujoco.MjModel, data: mujoco.MjData, point: Point, near_m: float | None = None) -> float | None:
    """Returns the height of the floor at a point; `None` if there is none.

    Args:
        model: The compiled world.
        data: MuJoCo state of the world.
        point: The place.
        near_m: Height that the floor is near, as in a building of several storeys; without, the floor is the first
            surface below 0.5 m, else the lowest one with a metre of free space above.
    """
    height = _low_floor(model, data, point, 0.0 if near_m is None else near_m)
    if height is None and near_m is None:
        return _lowest_surface(model, data, point, float(world_bounds(model, data)[1][2]))
    return height


def _low_floor(model: mujoco.MjModel, data: mujoco.MjData, point: Point, near_m: float = 0.0) -> float | None:
    top_m = max(_ABOVE_FLOOR_M, near_m + _NEAR_M)
    far = _ray(model, data, (*point, top_m), -1.0)
    return top_m - far if 0 <= far <= _DEEPEST_M else None


def _lowest_surface(model: mujoco.MjModel, data: mujoco.MjData, point: Point, top_m: float) -> float | None:
    """Returns the lowest surface height at a point that has room for a robot above it; `None` if there is none.

    The search begins a robot's headroom above `top_m`; heights are in metres.
    """
    found: list[float] = []
    height = top_m + _HEADROOM_M
    for _ in range(_MOST_SURFACES):
        far = _ray(model, data, (*point, height), -1.0)
        if far < 0:
            break
        height -= far
        above = _ray(model, data, (*point, height + _SKIN_M), 1.0)
        if above < 0 or above >= _HEADROOM_M:
            found.append(height)
        height -= _SKIN_M
    return min(found, default=None)


def _ray(model: mujoco.MjModel, data: mujoco.MjData, start: tuple[float, float, float], up: float) -> float:
    """Returns the distance from a point to the first surface above it (`up` is 1) or below it (-1).

    The distance is negative if there is none.
    """
    along = np.array([0.0, 0.0, up])
    return float(mujoco.mj_ray(model, data, np.array(start), along, None, True, -1, np.zeros(1, np.int32)))


def usual_floor(model: mujoco.MjModel, data: mujoco.MjData) -> float | None:
    """Returns the most common floor height of a world in metres; `None` if there is no floor."""
    low, high = world_bounds(model, data)
    spots = [
        (float(x), float(y)) for x in np.linspace(low[0], high[0], _STEPS) for y in np.linspace(low[1], high[1], _STEPS)
    ]
    heights = [height for spot in spots if (height := _low_floor(model, data, spot)) is not None]
    if not heights:  # all of it may be higher than floors mostly are
        found = (_lowest_surface(model, data, spot, float(high[2])) for spot in spots)
        heights = [height for height in found if height is not None]
    if not heights:
        return None
    rounded = np.round(np.array(heights), 2)
    values, counts = np.unique(rounded, return_counts=True)
    common = values[np.argmax(counts)]
    return float(np.median(np.array(heights)[np.abs(rounded - common) < 0.011]))


def world_bounds(model: mujoco.MjModel, data: mujoco.MjData) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Returns the lowest and highest corner (metres) of all finite solid geometry of a world.

    A world without any has the bounds of a usual space around its origin.
    """
    solid = (model.geom_contype | model.geom_conaffinity != 0) & (model.geom_type != int(mujoco.mjtGeom.mjGEOM_PLANE))
    geoms = np.flatnonzero(solid)
    half = _BARE_SIDE_M / 2
    if not len(geoms):
        return np.array([-half, -half, 0.0]), np.array([half, half, 2.5])
    return bounds_of_geoms(model, data, geoms)


def bounds_of_geoms(
    model: mujoco.MjModel, data: mujoco.MjData, geoms: list[int] | NDArray[np.intp]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Returns the lowest and highest corner of some geoms, in metres in the world's frame.

    `geoms` has their numbers, of which there is one at least.
    """
    axes, boxes = data.geom_xmat[geoms].reshape(-1, 3, 3), model.geom_aabb[geoms]
    center = data.geom_xpos[geoms] + (axes @ boxes[:, :3, None])[..., 0]
    reach = (np.abs(axes) @ boxes[:, 3:, None])[..., 0]
    return (center - reach).min(axis=0), (center + reach).max(axis=0)


def ground_at(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    floor_m: float = 0.0,
    near: Point = (0.0, 0.0),
    high_m: float = ROBOT_HIGH_M,
) -> Ground:
    """Scans a world from above for floor and obstacles at one floor height.

    Args:
        model: Compiled model of the world.
        data: MuJoCo state of the world.
        floor_m: Height of the floor.
        near: Place that has to be on the map of a world larger than a map can be.
        high_m: Height of the robot.
    """
    grid = _empty_grid(*world_bounds(model, data), near)
    supported = np.zeros_like(grid.occupied)
    owners = np.full(grid.occupied.shape, -1, np.int32)
    for geom in np.flatnonzero(model.geom_contype | model.geom_conaffinity != 0):
        if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_PLANE:
            _fill_plane(data, int(geom), floor_m, high_m, grid, supported)
        elif model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_HFIELD:
            _fill_terrain(model, data, int(geom), floor_m, grid, supported)
    blocked = grid.occupied.copy()
    for _, outline in solid_outlines(model, data, floor_m + _FLOOR_BAND_M[0], floor_m + _FLOOR_BAND_M[1]):
        fill(grid, supported, outline)
    for geom, outline in solid_outlines(model, data, floor_m + LOW_M, floor_m + high_m):
        rows, columns = _around(grid, outline)
        if rows.start >= rows.stop or columns.start >= columns.stop:
            continue
        # Only the cells around it are looked at: there may be thousands of parts.
        corner = grid.origin[0] + columns.start * RESOLUTION_M, grid.origin[1] + rows.start * RESOLUTION_M
        here = np.zeros((rows.stop - rows.start, columns.stop - columns.start), np.bool_)
        fill(OccupancyGrid(corner, here, here), here, outline)
        owners[rows, columns][here] = geom
        grid.occupied[rows, columns] |= here
        if model.body_weldid[model.geom_bodyid[geom]] == 0:
            blocked[rows, columns] |= here
    return Ground(grid, supported, owners, blocked)


def _around(grid: OccupancyGrid, outline: list[Point]) -> tuple[slice, slice]:
    """Returns the rows and columns of grid cells around an outline, with a cell more on each side if there is one."""
    found = []
    for axis, count in ((1, grid.occupied.shape[0]), (0, grid.occupied.shape[1])):
        values = [point[axis] - grid.origin[axis] for point in outline]
        first, last = floor(min(values) / RESOLUTION_M) - 1, ceil(max(values) / RESOLUTION_M) + 1
        found.append(slice(max(0, first), min(count, last)))
    return found[0], found[1]


def _empty_grid(low: NDArray[np.float64], high: NDArray[np.float64], near: Point) -> OccupancyGrid:
    first, last = [], []
    for axis in range(2):
        # A plane has no end: a place on it is on the map, also beyond all that is on it.
        begin, end = min(low[axis], near[axis]) - _MARGIN_M, max(high[axis], near[axis]) + _MARGIN_M
        begin, end = max(begin, near[axis] - _MOST_SIDE_M / 2), min(end, near[axis] + _MOST_SIDE_M / 2)
        first.append(floor(begin / RESOLUTION_M))
        last.append(max(ceil(end / RESOLUTION_M), first[axis] + 1))
    shape = (last[1] - first[1], last[0] - first[0])
    per_m = round(1 / RESOLUTION_M)
    return OccupancyGrid((first[0] / per_m, first[1] / per_m), np.zeros(shape, np.bool_), np.zeros(shape, np.bool_))


def _centers(grid: OccupancyGrid) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    rows, columns = grid.occupied.shape
    x = grid.origin[0] + (np.arange(columns) + 0.5) * grid.resolution_m
    y = grid.origin[1] + (np.arange(rows) + 0.5) * grid.resolution_m
    return x[None, :], y[:, None]


def _fill_plane(
    data: mujoco.MjData,
    geom: int,
    floor_m: float,
    high_m: float,
    grid: OccupancyGrid,
    supported: NDArray[np.bool_],
) -> None:
    """Marks where a plane is the floor, and where a robot would be behind it: all that is there is solid.

    Both `grid.occupied` and `supported`, the mask of cells that have a floor, are changed in place.
    """
    normal, place = data.geom_xmat[geom].reshape(3, 3)[:, 2], data.geom_xpos[geom]
    x, y = _centers(grid)
    lowest = floor_m + (LOW_M if normal[2] >= 0 else high_m) - place[2]
    behind = (x - place[0]) * normal[0] + (y - place[1]) * normal[1] + lowest * normal[2] < 0
    grid.occupied[:] |= np.broadcast_to(behind, supported.shape)
    if normal[2] < _LEAST_FLOOR_NORMAL:
        return  # a wall without an end, or a ceiling
    height = place[2] - ((x - place[0]) * normal[0] + (y - place[1]) * normal[1]) / normal[2] - floor_m
    supported |= np.broadcast_to((height >= _FLOOR_BAND_M[0]) & (height <= _FLOOR_BAND_M[1]), supported.shape)


def _fill_terrain(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    geom: int,
    floor_m: float,
    grid: OccupancyGrid,
    supported: NDArray[np.bool_],
) -> None:
    """Marks the cells where a height field is level with the floor, and as obstacles those where it is higher.

    Both `grid.occupied` and `supported`, the mask of cells that have a floor, are changed in place.
    """
    field = int(model.geom_dataid[geom])
    rows, columns = int(model.hfield_nrow[field]), int(model.hfield_ncol[field])
    start = int(model.hfield_adr[field])
    shares = model.hfield_data[start : start + rows * columns].reshape(rows, columns)
    half_x, half_y, top, _ = model.hfield_size[field]
    turn, place = data.geom_xmat[geom].reshape(3, 3), data.geom_xpos[geom]
    x, y = _centers(grid)
    u = (x - place[0]) * turn[0, 0] + (y - place[1]) * turn[1, 0]
    v = (x - place[0]) * turn[0, 1] + (y - place[1]) * turn[1, 1]
    inside = (np.abs(u) <= half_x) & (np.abs(v) <= half_y)
    spots = [(v + half_y) / (2 * half_y) * (rows - 1), (u + half_x) / (2 * half_x) * (columns - 1)]
    height = ndimage.map_coordinates(shares * top, spots, order=1, mode="nearest") + place[2] - floor_m
    supported |= inside & (height >= _FLOOR_BAND_M[0]) & (height <= _FLOOR_BAND_M[1])
    grid.occupied[:] |= inside & (height > LOW_M)


def free_start(ground: Ground) -> Point | None:
    """Returns the free position (metres) nearest to the world's origin where a robot can start; `None` without one.

    Small pockets of free space do not count, unless there are no others.
    """
    known = OccupancyGrid(ground.grid.origin, ~ground.free, np.ones_like(ground.free))
    # The origin need not be on the middle of a cell, and half a cell more hides that.
    fits = fitting(known, START_RADIUS_M + RESOLUTION_M)
    border = round(START_RADIUS_M / RESOLUTION_M) + 1
    fits[:border], fits[-border:], fits[:, :border], fits[:, -border:] = False, False, False, False
    found, _ = ndimage.label(fits)  # pyright: ignore[reportGeneralTypeIssues]
    labels = np.asarray(found, np.intp)
    sizes = np.bincount(labels.ravel()) * RESOLUTION_M**2
    sizes[0] = 0.0
    good = sizes[labels] >= min(_LEAST_AREA_M2, float(sizes.max()))
    if not (good & fits).any():
        return None
    x, y = _centers(ground.grid)
    away = np.where(good & fits, np.hypot(*np.broadcast_arrays(x, y)), np.inf)
    row, column = np.unravel_index(int(np.argmin(away)), away.shape)
    return round(float(x[0, column]), 3), round(float(y[row, 0]), 3)


def in_the_way(ground: Ground, start: Point) -> list[int] | None:
    """Returns the geoms that block a start position; `None` if it is free, empty if it has no floor."""
    x, y = _centers(ground.grid)
    near = np.hypot(*np.broadcast_arrays(x - start[0], y - start[1])) < START_RADIUS_M
    if not (near & ~ground.free).any():
        return None if near.any() else []
    return sorted({int(geom) for geom in ground.owners[near & ground.grid.occupied] if geom >= 0})


def survey(model: mujoco.MjModel, high_m: float = ROBOT_HIGH_M) -> OccupancyGrid:
    """Computes the occupancy grid of a world whose robot starts at the origin.

    Args:
        model: Compiled model of the world.
        high_m: Height of the robot.
    """
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    return known_map(ground_at(model, data, high_m=high_m), (0.0, 0.0))


def known_map(ground: Ground, start: Point) -> OccupancyGrid:
    """Computes the occupancy grid of the area that can be seen from a start position.

    Args:
        ground: The world from above.
        start: Start position of the robot.
    """
    grid = ground.grid
    reached = connected(ground.supported & ~ground.blocked, grid.cell(start))
    # Walls of meshes are hollow: the two faces of one are a wall.
    closed = np.asarray(ndimage.binary_closing(np.pad(grid.occupied, _HOLLOW), _BOX, iterations=_HOLLOW), np.bool_)
    occupied = grid.occupied | (closed[_HOLLOW:-_HOLLOW, _HOLLOW:-_HOLLOW] & ~reached)
    steps = round(_SEEN_DEPTH_M / grid.resolution_m)
    known = np.asarray(ndimage.binary_dilation(reached, iterations=steps, mask=reached | occupied), np.bool_)
    rows, columns = np.nonzero(known)
    if not len(rows):
        return OccupancyGrid(grid.origin, occupied, known)
    # A map ends half a metre beyond what is known.
    border = round(_BORDER_M / grid.resolution_m)
    south, west = max(0, int(rows.min()) - border), max(0, int(columns.min()) - border)
    north, east = int(rows.max()) + border + 1, int(columns.max()) + border + 1
    part = slice(south, north), slice(west, east)
    per_m = round(1 / grid.resolution_m)
    origin = (round(grid.origin[0] * per_m) + west) / per_m, (round(grid.origin[1] * per_m) + south) / per_m
    return OccupancyGrid(origin, occupied[part] & known[part], known[part])


def on_map(cells: NDArray[np.bool_], ground: Ground, grid: OccupancyGrid) -> NDArray[np.bool_]:
    """Converts cells of the scan from above to cells of the occupancy grid.

    Args:
        cells: Cells of `ground`.
        ground: The world from above.
        grid: Occupancy grid of the world.
    """
    row, column = ground.grid.cell((grid.origin[0] + RESOLUTION_M / 2, grid.origin[1] + RESOLUTION_M / 2))
    found = np.zeros_like(grid.known)
    part = cells[row : row + found.shape[0], column : column + found.shape[1]]
    found[: part.shape[0], : part.shape[1]] = part
    return found


def reached_cells(grid: OccupancyGrid, radius_m: float) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Returns masks of the cells that a disc-shaped robot reaches from the origin, and where it fits."""
    fits = fitting(grid, radius_m)
    return connected(fits, grid.cell((0.0, 0.0))), fits


_MOST_WALLS = 3000


def wall_boxes(cells: NDArray[np.bool_], grid: OccupancyGrid) -> list[tuple[float, float, float, float]]:
    """Covers cells with rectangles (west, south, east, north in metres), as walls of the world.

    Args:
        cells: Cells of the grid.
        grid: Occupancy grid with the cells' positions.
    """
    size, blocks = grid.resolution_m, cells
    while True:
        found = _rectangles(blocks)
        if len(found) <= _MOST_WALLS or min(blocks.shape) < 4:
            break
        rows, columns = (count + count % 2 for count in blocks.shape)
        padded = np.zeros((rows, columns), np.bool_)
        padded[: blocks.shape[0], : blocks.shape[1]] = blocks
        blocks = np.asarray(padded.reshape(rows // 2, 2, columns // 2, 2).any(axis=(1, 3)), np.bool_)
        size *= 2
    x, y = grid.origin
    return [
        tuple(round(value, 3) for value in (x + west * size, y + south * size, x + east * size, y + north * size))
        for south, west, north, east in found
    ]  # pyright: ignore[reportReturnType]


def _rectangles(cells: NDArray[np.bool_]) -> list[tuple[int, int, int, int]]:
    left, found = cells.copy(), []
    for row, column in np.argwhere(cells):
        if not left[row, column]:
            continue
        # The longer of both ways first, so that walls are long.
        along, up = _run(left[row, column:]), _run(left[row:, column])
        if along >= up:
            east, north = column + along, row + 1
            while north < left.shape[0] and left[north, column:east].all():
                north += 1
        else:
            north, east = row + up, column + 1
            while east < left.shape[1] and left[row:north, east].all():
                east += 1
        left[row:north, column:east] = False
        found.append((int(row), int(column), int(north), int(east)))
    return found


def _run(cells: NDArray[np.bool_]) -> int:
    return int(len(cells) if cells.all() else np.argmin(cells))


def nearest_cell(cells: NDArray[np.bool_], grid: OccupancyGrid, to: Point) -> Point | None:
    """Returns the centre (metres) of the marked cell nearest to a point; `None` if no cell is marked."""
    rows, columns = np.nonzero(cells)
    if not len(rows):
        return None
    x = grid.origin[0] + (columns + 0.5) * grid.resolution_m
    y = grid.origin[1] + (rows + 0.5) * grid.resolution_m
    index = int(np.argmin(np.hypot(x - to[0], y - to[1])))
    return round(float(x[index]), 3), round(float(y[index]), 3)
