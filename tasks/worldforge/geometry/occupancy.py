"""Occupancy grid of a world: obstacles for a robot's lidar and planner.

Rows count from south to north, columns from west to east; cell `[0, 0]` begins at the grid's origin. The grid shows the
slice of the world between `ROBOT_LOW_M` and the robot's height, mostly `ROBOT_HIGH_M`, above the floor. `write_map`
writes the pair of files that Nav2's map server reads.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from math import ceil, cos, floor, hypot, sin, sqrt
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from ....schemas.worlds.world import Floorplan, Furniture, Point, Room, Wall

RESOLUTION_M = 0.05
ROBOT_LOW_M = 0.02
ROBOT_HIGH_M = 0.4

OCCUPIED_PIXEL = 0
FREE_PIXEL = 254
UNKNOWN_PIXEL = 205

_MARGIN_M = 0.5
"""Width of the unknown border around the building, in metres, so that a map shows its outer walls whole."""

_TOUCHING_M = 1e-6
"""Depth up to which an obstacle only touches a cell and does not occupy it, in metres."""

_GRACE_M = 5e-4


@dataclass(frozen=True)
class OccupancyGrid:
    """Grid map of a world: occupied cells, and cells that are known at all."""

    origin: Point
    """South-west corner of map cell `[0, 0]`, in metres."""

    occupied: NDArray[np.bool_]
    """Whether each map cell is occupied, shape (rows, columns)."""

    known: NDArray[np.bool_]
    """Whether each cell is known, shape (rows, columns).

    Cells outside the building are unknown; occupied cells are known.
    """

    resolution_m: float = RESOLUTION_M
    """Side of a map cell, in metres."""

    @property
    def free(self) -> NDArray[np.bool_]:
        """Mask of the map cells that are known and not occupied."""
        return self.known & ~self.occupied

    def cell(self, point: Point) -> tuple[int, int]:
        """Returns row and column of the cell at a point, which may be outside the grid."""
        x, y = (value - start for value, start in zip(point, self.origin, strict=True))
        return floor(y / self.resolution_m), floor(x / self.resolution_m)


def occupancy_grid(
    floorplan: Floorplan,
    furniture: Iterable[Furniture] = (),
    polygons: Iterable[Sequence[Point]] = (),
    high_m: float = ROBOT_HIGH_M,
) -> OccupancyGrid:
    """Computes the occupancy grid of a floor plan with furniture, for a robot of a height.

    A cell is occupied as soon as an obstacle enters it. Lintels and everything else that begins above the
    robot, or stays flat on the floor, leaves no trace.

    Args:
        floorplan: The walls and the outline.
        furniture: Obstacles as oriented rectangles.
        polygons: Further obstacles as convex polygons, counter-clockwise, at the robot's height; for
            furniture that a robot can drive under, pass its legs here and leave it out of `furniture`.
        high_m: Height of the robot, in metres.
    """
    half = max(wall.thickness_m for wall in floorplan.walls) / 2
    xs, ys = zip(*floorplan.footprint, strict=True)
    border = half + _MARGIN_M
    # On whole cells, so that walls at multiples of the resolution fill cells exactly.
    first_x, first_y = (floor(round((min(values) - border) / RESOLUTION_M, 6)) for values in (xs, ys))
    last_x, last_y = (ceil(round((max(values) + border) / RESOLUTION_M, 6)) for values in (xs, ys))
    shape = (last_y - first_y, last_x - first_x)
    # Dividing keeps multiples of 5 cm exact to the last bit.
    origin = (first_x / round(1 / RESOLUTION_M), first_y / round(1 / RESOLUTION_M))
    grid = OccupancyGrid(origin, np.zeros(shape, np.bool_), np.zeros(shape, np.bool_))
    for room in floorplan.rooms:  # what is neither room nor wall lies outside, also inside the outline
        grid.known[room_cells(grid, room)] = True
    for wall in floorplan.walls:
        fill(grid, grid.known, wall_corners(wall))
        if wall.bottom_m < high_m:
            fill(grid, grid.occupied, wall_corners(wall))
    for item in furniture:
        if item.base_m < high_m and item.base_m + item.height_m > ROBOT_LOW_M:
            fill(grid, grid.occupied, furniture_corners(item))
    for polygon in polygons:
        fill(grid, grid.occupied, polygon)
    return grid


def wall_corners(wall: Wall) -> list[Point]:
    """Returns the corners of a wall on the floor, counter-clockwise."""
    (x0, y0), (x1, y1) = wall.start, wall.end
    length = hypot(x1 - x0, y1 - y0)
    u, v = (x1 - x0) / length * wall.thickness_m / 2, (y1 - y0) / length * wall.thickness_m / 2
    return [(x0 + v, y0 - u), (x1 + v, y1 - u), (x1 - v, y1 + u), (x0 - v, y0 + u)]


def furniture_corners(item: Furniture) -> list[Point]:
    """Returns the corners of a piece of furniture on the floor, counter-clockwise from right rear."""
    c, s = cos(item.yaw), sin(item.yaw)
    half_depth, half_width = item.depth_m / 2, item.width_m / 2
    return [
        (item.x + along * c - across * s, item.y + along * s + across * c)
        for along, across in (
            (-half_depth, -half_width),
            (half_depth, -half_width),
            (half_depth, half_width),
            (-half_depth, half_width),
        )
    ]


def fill(
    grid: OccupancyGrid, cells: NDArray[np.bool_], corners: Sequence[Point], touching_m: float = _TOUCHING_M
) -> None:
    """Marks every grid cell that a convex polygon touches.

    Args:
        grid: Occupancy grid with the cells' positions.
        cells: The cells, shape (rows, columns), which are changed.
        corners: The polygon, counter-clockwise.
        touching_m: Depth by which it must enter a cell; negative values also mark cells that are as near.
    """
    size = grid.resolution_m
    xs, ys = zip(*corners, strict=True)
    rows, columns = cells.shape
    west = max(0, floor((min(xs) - grid.origin[0] + touching_m) / size))
    east = min(columns, ceil((max(xs) - grid.origin[0] - touching_m) / size))
    south = max(0, floor((min(ys) - grid.origin[1] + touching_m) / size))
    north = min(rows, ceil((max(ys) - grid.origin[1] - touching_m) / size))
    if west >= east or south >= north:
        return
    if _is_upright(corners):
        cells[south:north, west:east] = True
        return
    x = grid.origin[0] + (np.arange(west, east) + 0.5) * size
    y = grid.origin[1] + (np.arange(south, north) + 0.5)[:, np.newaxis] * size
    entered = np.ones((north - south, east - west), np.bool_)
    for index in range(len(corners)):
        (x0, y0), (x1, y1) = corners[index - 1], corners[index]
        length = hypot(x1 - x0, y1 - y0)
        if length == 0:
            continue
        # The outward normal of an edge of a counter-clockwise polygon.
        u, v = (y1 - y0) / length, (x0 - x1) / length
        reach = (abs(u) + abs(v)) * size / 2
        entered &= (x - x0) * u + (y - y0) * v < reach - touching_m
    cells[south:north, west:east] |= entered


def _is_upright(corners: Sequence[Point]) -> bool:
    """Whether a polygon is an axis-aligned rectangle, which covers all cells of its bounding box."""
    return len(corners) == 4 and all(
        abs(x - u) < _TOUCHING_M or abs(y - v) < _TOUCHING_M
        for (x, y), (u, v) in zip(corners, (*corners[1:], corners[0]), strict=True)
    )


def fitting(grid: OccupancyGrid, radius_m: float) -> NDArray[np.bool_]:
    """Returns a mask of the cells where a disc-shaped robot can be without touching anything.

    Several times faster than the distances themselves: a cell is left out when one that is not free lies within the
    radius, row by row of the disc.

    Returns:
        Shape (rows, columns).
    """
    # Half a millimetre of grace: distances are sums of floats.
    limit = (radius_m - _GRACE_M) / grid.resolution_m + 0.5
    reach = ceil(limit) - 1
    rows, columns = grid.known.shape
    blocked = ~grid.free
    # Counts of blocked cells west of each column; beyond the border nothing counts.
    west_of = np.zeros((rows, columns + 1), np.int32)
    np.cumsum(blocked, axis=1, out=west_of[:, 1:])
    column = np.arange(columns)
    for up in range(reach + 1):
        half = ceil(sqrt(limit * limit - up * up)) - 1
        last, first = np.minimum(column + half + 1, columns), np.maximum(column - half, 0)
        near = west_of[:, last] != west_of[:, first]
        blocked[: rows - up] |= near[up:]
        blocked[up:] |= near[: rows - up]
    return ~blocked


def reachable(grid: OccupancyGrid, start: Point, radius_m: float) -> NDArray[np.bool_]:
    """Returns a mask of the cells that a disc-shaped robot can reach from `start`.

    Args:
        grid: The map; unknown cells count as occupied.
        start: Start position of the disc's centre, in metres.
        radius_m: The disc's radius.

    Returns:
        Shape (rows, columns); nothing at all when the disc does not fit at `start`.
    """
    return connected(fitting(grid, radius_m), grid.cell(start))


def connected(cells: NDArray[np.bool_], start: tuple[int, int]) -> NDArray[np.bool_]:
    """Returns the connected part of a mask that contains the cell `start` (row, column); all false if that is not set.

    Cells are connected over their sides, not over their corners.
    """
    row, column = start
    if not (0 <= row < cells.shape[0] and 0 <= column < cells.shape[1] and cells[row, column]):
        return np.zeros_like(cells)
    # Four neighbours: a disc does not slip through where two obstacles touch at a corner.
    labels, _ = ndimage.label(cells)  # pyright: ignore[reportGeneralTypeIssues]
    return labels == labels[row, column]


def room_cells(grid: OccupancyGrid, room: Room) -> NDArray[np.bool_]:
    """Returns a mask of the map cells inside a room's polygon."""
    xs, ys = zip(*room.polygon, strict=True)
    # Only what is around the room is looked at.
    (west, east), (south, north) = (
        (max(0, floor((min(values) - first) / grid.resolution_m)), ceil((max(values) - first) / grid.resolution_m))
        for values, first in zip((xs, ys), grid.origin, strict=True)
    )
    inside = np.zeros_like(grid.occupied)
    around = inside[south:north, west:east]
    x = grid.origin[0] + (np.arange(west, west + around.shape[1]) + 0.5) * grid.resolution_m
    y = (grid.origin[1] + (np.arange(south, south + around.shape[0]) + 0.5) * grid.resolution_m)[:, np.newaxis]
    for index in range(len(room.polygon)):
        (x0, y0), (x1, y1) = room.polygon[index - 1], room.polygon[index]
        if x0 == x1:  # polygons are axis-aligned: only these edges cross an eastward ray
            around ^= (x < x0) & (min(y0, y1) <= y) & (y < max(y0, y1))
    return inside


def write_map(grid: OccupancyGrid, folder: Path, said: str | None = None) -> None:
    """Writes an occupancy grid as `map.pgm` and `map.yaml` to a folder.

    Files of these names are replaced. The folder must exist. `said` is a comment in `map.yaml`.
    """
    for name, content in map_files(grid, said).items():
        (folder / name).write_bytes(content)


def map_files(grid: OccupancyGrid, said: str | None = None) -> dict[str, bytes]:
    """Converts an occupancy grid to `map.pgm` and `map.yaml`, as Nav2's map server reads them.

    Args:
        grid: The map.
        said: Comment in `map.yaml`.
    """
    height, width = grid.occupied.shape
    pixels = np.full((height, width), UNKNOWN_PIXEL, np.uint8)
    pixels[grid.free] = FREE_PIXEL
    pixels[grid.occupied] = OCCUPIED_PIXEL
    # A picture's first row is its top, which is north.
    picture = b"P5\n%d %d\n255\n" % (width, height) + pixels[::-1].tobytes()
    # An unknown pixel is occupied with probability (255 - 205) / 255 = 0.1961; that must not be below
    # free_thresh, or the map server would read unknown as free.
    lines = [
        *([f"# {said}"] if said else []),
        "image: map.pgm",
        "mode: trinary",
        f"resolution: {grid.resolution_m}",
        f"origin: [{grid.origin[0]}, {grid.origin[1]}, 0.0]",
        "negate: 0",
        "occupied_thresh: 0.65",
        "free_thresh: 0.196",
    ]
    return {"map.pgm": picture, "map.yaml": ("\n".join(lines) + "\n").encode()}
