"""Generates a floor plan from a world template: rooms, walls, doorways, windows, and the outcome of preferences."""

from collections.abc import Sequence
from random import Random
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ....schemas.templates.body import TemplateFloorplan, WorldTemplateBody
from ....schemas.worlds.world import Floorplan, Passage, Point, Room, RoomType, Wall, Window
from ..doors.doors import hang_doors
from .brief import EXTERIOR_WALL, brief, length_over_width
from .connections import Way, connect
from .partition import UNITS_PER_M, Corners, Partition, area, extent, outline
from .partition_choice import find_partition
from .plan_seed import PlanSeed
from .preferences import preference_report
from .walls import Pane, Piece, build_walls, floor_shapes, place_windows

LINTEL_M = 2.1
"""Height of doorways in metres, below the lintel."""

_ORIGIN_CLEARANCE = 20
"""Preferred distance of the world's origin from walls, in grid units."""

_LATTICE = 10

Spot = tuple[int, int]


class Spots(NamedTuple):
    """Candidate positions in a room in grid units, with their distance from the walls."""

    x: NDArray[np.int64]
    y: NDArray[np.int64]
    clearance: NDArray[np.float64]


def generate_floorplan(body: WorldTemplateBody, seed: int) -> Floorplan:
    """Generates a floor plan from a world template; equal template and seed give the same plan.

    Rooms tile the footprint, which may be set back from a rectangle. Every room is connected. The origin lies inside a
    room, at least 0.5 m from every wall, and all coordinates are multiples of 5 cm.

    Args:
        body: The template.
        seed: From 0; seeds that follow each other give plans that differ, as long as there are others. `PlanSeed` says
            what it means.

    Raises:
        WorldGenerationError: No valid plan within the bounded number of attempts.
    """
    preferences = body.floorplan
    # The search takes thousands of small draws, for which the standard library's generator is ten times faster.
    dice = Random(int(np.random.SeedSequence(seed).generate_state(1, np.uint64)[0]))  # noqa: S311
    plan_seed = PlanSeed.of(seed)
    numbers = brief(preferences, diverse=plan_seed.diverse)
    plan = find_partition(numbers, plan_seed, dice)
    ways = connect(plan, numbers, dice)
    panes = place_windows(plan, numbers, dice)
    spots = [spots_in(corners) for corners in plan.rooms]
    origin = choose_origin(plan.rooms, numbers.types, ways, spots)
    drawn = Floorplan(
        footprint=placed_points(outline(plan), origin),
        ceiling_height_m=preferences.Ceiling.Height,
        rooms=[_room(preferences, plan, number, spots[number], origin) for number in range(len(plan.rooms))],
        walls=[placed_wall(piece, numbers.names, origin) for piece in build_walls(plan, ways)],
        passages=[placed_passage(way, numbers.names, origin) for way in ways],
        windows=[placed_window(pane, numbers.names, origin) for pane in panes],
        wishes=preference_report(preferences, numbers, plan, ways),
    )
    return hang_doors(drawn)[0] if body.Version == "2" else drawn


def choose_origin(rooms: Sequence[Corners], types: Sequence[RoomType], ways: Sequence[Way], spots: list[Spots]) -> Spot:
    """Chooses the world's origin, where robots start: a free position in the largest living room or hallway.

    Args:
        rooms: The rooms' corners.
        types: Their types.
        ways: The ways between them.
        spots: Candidate positions in each room.

    Returns:
        The position, in grid units.
    """

    def rank(room: int) -> tuple[int, bool, float]:
        public = types[room] in ("Living", "Hallway")
        clearance = round(spots[room].clearance.max())
        return min(clearance, _ORIGIN_CLEARANCE), public, area(rooms[room])

    room = max(range(len(rooms)), key=rank)
    x, y, clearance = spots[room]
    # A room without ways has its middle instead.
    doors = [_middle(way) for way in ways if room in way.pair] or [(int(x.mean()), int(y.mean()))]
    far = sum((np.hypot(x - u, y - v) for u, v in doors), np.zeros(len(x)))
    best = np.lexsort((far, -np.minimum(clearance, _ORIGIN_CLEARANCE)))[0]
    return int(x[best]), int(y[best])


def spots_in(corners: Corners) -> Spots:
    """Returns a grid of candidate positions in a room's bounding box, with the clearance of each, in grid units.

    The clearance is the distance to the nearest wall's face; it is negative outside the room.
    """
    box = extent(corners)
    steps = np.arange(1, _LATTICE)
    columns = box.x0 + (box.x1 - box.x0) * steps // _LATTICE
    rows = box.y0 + (box.y1 - box.y0) * steps // _LATTICE
    x, y = np.tile(columns, len(rows)), np.repeat(rows, len(columns))
    ends = np.array([*corners, corners[0]])
    starts, ends = ends[:-1], ends[1:]
    (x0, y0), (x1, y1) = np.minimum(starts, ends).T[..., np.newaxis], np.maximum(starts, ends).T[..., np.newaxis]
    # Distance to each edge, which is axis-aligned: how far beside its span and how far off its line.
    nearest = np.hypot(np.maximum(0, np.maximum(x0 - x, x - x1)), np.maximum(0, np.maximum(y0 - y, y - y1))).min(axis=0)
    inside = ((x0 == x1) & (x < x0) & (y0 <= y) & (y < y1)).sum(axis=0) % 2 == 1
    return Spots(x, y, np.where(inside, nearest, -nearest) - EXTERIOR_WALL / 2)


def _middle(way: Way) -> Spot:
    along = (way.start + way.end) // 2
    return (along, way.contact.at) if way.contact.horizontal else (way.contact.at, along)


def placed_points(spots: Corners, origin: Spot) -> list[Point]:
    """Converts points from grid units to metres from the world's origin."""
    # Dividing whole numbers gives the nearest float to the decimal: 3.15, not 3.1500000000000004.
    return [((x - origin[0]) / UNITS_PER_M, (y - origin[1]) / UNITS_PER_M) for x, y in spots]


def _ends(horizontal: bool, at: int, start: int, end: int, origin: Spot) -> tuple[Point, Point]:
    spots = ((start, at), (end, at)) if horizontal else ((at, start), (at, end))
    first, last = placed_points(spots, origin)
    return first, last


def placed_wall(piece: Piece, names: Sequence[str], origin: Spot) -> Wall:
    """Converts a wall segment from grid units to metres."""
    start, end = _ends(piece.horizontal, piece.at, piece.start, piece.end, origin)
    return Wall(
        start=start,
        end=end,
        thickness_m=piece.thickness / UNITS_PER_M,
        exterior=len(piece.rooms) == 1,
        rooms=[names[room] for room in piece.rooms],
        lintel=piece.lintel,
        bottom_m=LINTEL_M if piece.lintel else 0.0,
    )


def placed_passage(way: Way, names: Sequence[str], origin: Spot) -> Passage:
    """Converts a doorway or opening from grid units to metres."""
    start, end = _ends(way.contact.horizontal, way.contact.at, way.start, way.end, origin)
    return Passage(
        kind=way.kind,
        rooms=(names[way.pair[0]], names[way.pair[1]]),
        start=start,
        end=end,
        width_m=(way.end - way.start) / UNITS_PER_M,
        requested=way.requested,
    )


def placed_window(pane: Pane, names: Sequence[str], origin: Spot) -> Window:
    """Converts a window from grid units to metres."""
    start, end = _ends(pane.horizontal, pane.at, pane.start, pane.end, origin)
    return Window(start=start, end=end, room=names[pane.room])


def _room(preferences: TemplateFloorplan, plan: Partition, number: int, spots: Spots, origin: Spot) -> Room:
    preference, corners = preferences.Rooms[number], plan.rooms[number]
    middle, floor = int(spots.clearance.argmax()), floor_shapes(plan)[number]
    return Room(
        name=preference.Name,
        original_name=preference.OriginalName,
        type=preference.Type,
        polygon=placed_points(corners, origin),
        area_m2=area(corners) / UNITS_PER_M**2,
        floor_area_m2=floor.area / UNITS_PER_M**2,
        aspect_ratio=round(floor.ratio, 4),
        desired_area_m2=preference.DesiredShape.Area,
        desired_aspect_ratio=length_over_width(preference.DesiredShape.AspectRatio),
        goal=placed_points(((int(spots.x[middle]), int(spots.y[middle])),), origin)[0],
    )
