"""Compares a world's map with its model: cell by cell, and with simulated lidar rays."""

# MuJoCo ships no types for its compiled module.
# pyright: reportAttributeAccessIssue=false

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from ....schemas.worlds.world import Fault, Furniture, Point, World
from ..geometry.occupancy import ROBOT_HIGH_M, ROBOT_LOW_M, OccupancyGrid, fill
from ..geometry.slices import solid_outlines
from .checks import Site, goals_of
from .parts import room_at
from .scan import GRACE_M, Scan, lidar_scan

_OUTLINE_M = 0.02
"""Largest distance by which a piece's outline on the map may extend beyond its parts, in metres."""
_MOST_PLACES = 3
"""Limit of the places named for each kind of difference; the number of all cells is given with them."""

Cells = NDArray[np.bool_]


class _Expected(NamedTuple):
    """Map cells that a correct map must show, and those that it may show."""

    must_occupy: Cells
    may_occupy: Cells
    """Map cells that may be occupied, such as the inside of furniture's outlines."""
    must_know: Cells
    may_know: Cells

    @classmethod
    def of_plan(cls, world: World, scan: Scan, grid: OccupancyGrid) -> "_Expected":
        """Computes the expected occupancy map of a generated world from its model alone."""
        must_occupy, may_occupy, walls, near = (np.zeros_like(grid.known) for _ in range(4))
        for _, outline in scan.slices:
            fill(grid, must_occupy, outline, GRACE_M)
            fill(grid, may_occupy, outline, -GRACE_M)
        for item in world.furniture:
            if (outline := _footprint(item, scan)) is not None:
                fill(grid, may_occupy, outline, -_OUTLINE_M)
        are_walls = np.array([piece.startswith("wall_") for piece in scan.pieces]) & scan.solid
        top_m = world.floorplan.ceiling_height_m
        for _, outline in solid_outlines(scan.model, scan.data, 0.0, top_m, are_walls):
            fill(grid, walls, outline, GRACE_M)
            fill(grid, near, outline, -GRACE_M)
        for _, outline in scan.floors:
            fill(grid, near, outline, -GRACE_M)
        return cls(must_occupy, may_occupy, scan.floor(grid) | walls, near | may_occupy)


def _footprint(item: Furniture, scan: Scan) -> list[Point] | None:
    """Returns the rectangle around all parts of a piece in its own frame; `None` if a robot passes over or under it."""
    geoms = scan.parts_of.get(item.id)
    if not geoms or scan.low[geoms, 2].min() >= ROBOT_HIGH_M or scan.high[geoms, 2].max() <= ROBOT_LOW_M:
        return None
    data, body = scan.data, int(scan.model.geom_bodyid[geoms[0]])
    frame = data.xmat[body].reshape(3, 3)
    axes = frame.T @ data.geom_xmat[geoms].reshape(-1, 3, 3)
    boxes = scan.model.geom_aabb[geoms]
    center = (data.geom_xpos[geoms] - data.xpos[body]) @ frame + (axes @ boxes[:, :3, None])[..., 0]
    half = (np.abs(axes) @ boxes[:, 3:, None])[..., 0]
    (x0, y0), (x1, y1) = (center - half).min(axis=0)[:2], (center + half).max(axis=0)[:2]
    corners = np.array([(x0, y0), (x1, y0), (x1, y1), (x0, y1)])
    return [(float(x), float(y)) for x, y in data.xpos[body, :2] + corners @ frame[:2, :2].T]


def map_faults(world: World, site: Site, read: OccupancyGrid, *, as_described: bool) -> Iterator[Fault]:
    """Yields the differences between a map and the model of its world, as all stands at first.

    Args:
        world: The world.
        site: Model of the world.
        read: Stored map of the world.
        as_described: Whether each part of the model is as the world describes it.
    """
    grid, scan = site.first, site.scan
    if read.known.shape != grid.known.shape:
        one, other = (
            f"{each.known.shape[1]} x {each.known.shape[0]} cells from {each.origin}" for each in (read, grid)
        )
        yield Fault.placed("map", f"map.pgm has {one}; {other} would be right")
        return
    if as_described and np.array_equal(read.occupied, grid.occupied) and np.array_equal(read.known, grid.known):
        return  # which spares looking at each outline again
    if site.is_planned:
        expected = _Expected.of_plan(world, scan, grid)
    else:
        expected = _Expected(grid.occupied, grid.occupied, grid.known, grid.known)
    for cells, said in (
        (expected.must_occupy & ~read.occupied, "map.pgm shows nothing where {there} stands"),
        (read.occupied & ~expected.may_occupy, "map.pgm shows an obstacle where nothing stands"),
        (expected.must_know & ~read.known, "map.pgm does not know what is there"),
        (read.known & ~expected.may_know, "map.pgm shows floor where the world has none"),
    ):
        for count, place in _places(cells, grid):
            there = _there(scan, place) if "{there}" in said else ""
            yield Fault.placed("map", f"{said.format(there=there)}, {count} cells", place, room_at(world, place))


def _places(cells: Cells, grid: OccupancyGrid) -> Iterator[tuple[int, Point]]:
    """Yields the three largest groups of connected cells: their number of cells, and the place of one in metres."""
    if not cells.any():
        return
    found, count = ndimage.label(cells, np.ones((3, 3)))  # pyright: ignore[reportGeneralTypeIssues]
    labels = np.asarray(found, np.intp)
    sizes = np.bincount(labels.ravel(), minlength=int(count) + 1)[1:]
    for label in np.argsort(-sizes, kind="stable")[:_MOST_PLACES].tolist():
        rows, columns = np.nonzero(labels == label + 1)
        middle = len(rows) // 2
        x, y = (
            start + (float(cell[middle]) + 0.5) * grid.resolution_m
            for start, cell in zip(grid.origin, (columns, rows), strict=True)
        )
        yield int(sizes[label]), (x, y)


def _there(scan: Scan, place: Point) -> str:
    """Returns the name of the solid part at a position; `something` if there is none."""
    for geom, outline in scan.slices:
        xs, ys = zip(*outline, strict=True)
        if min(xs) - 0.05 < place[0] < max(xs) + 0.05 and min(ys) - 0.05 < place[1] < max(ys) + 0.05:
            return scan.names[geom] or scan.pieces[geom] or "a part without a name"
    return "something"


def lidar_faults(world: World, site: Site, read: OccupancyGrid) -> list[Fault]:
    """Lists places where a lidar hits geoms that do not collide or that the map lacks, or hits nothing.

    Args:
        world: The world.
        site: Model of the world; in a building with a plan, each ray must hit a wall.
        read: Stored map of the world.
    """
    scan = site.scan
    places = [place for place in ((0.0, 0.0), *(goal for _, goal in goals_of(world))) if _is_free(site.first, place)]
    near = np.asarray(ndimage.binary_dilation(read.occupied | ~read.known, np.ones((3, 3))), np.bool_)
    found: dict[tuple[str, str], Fault] = {}
    for place in places:
        seen = lidar_scan(scan, place)
        met = seen.geoms >= 0
        soft = met & ~scan.solid[seen.geoms]
        cells = np.floor((seen.ends - read.origin) / read.resolution_m)
        inside = met & np.all((cells >= 0) & (cells < read.occupied.shape[::-1]), axis=1)
        columns, rows = np.where(inside[:, None], cells, 0).astype(np.intp).T
        unshown = inside & ~near[rows, columns]
        for rays, said in (
            (soft, "a lidar meets {there}, which does not collide"),
            (unshown, "a lidar meets {there}, which map.pgm does not show"),
            (~met & site.is_planned, "a lidar sees out of the building"),
        ):
            for ray in np.flatnonzero(rays)[:1].tolist():
                there = scan.names[seen.geoms[ray]] or scan.pieces[seen.geoms[ray]]
                end = seen.ends[ray].tolist() if met[ray] else place
                key = (said, there if met[ray] else "")
                found.setdefault(key, Fault.placed("lidar", said.format(there=there), end, room_at(world, end)))
    return list(found.values())


def _is_free(grid: OccupancyGrid, place: Point) -> bool:
    row, column = grid.cell(place)
    rows, columns = grid.free.shape
    return 0 <= row < rows and 0 <= column < columns and bool(grid.free[row, column])
