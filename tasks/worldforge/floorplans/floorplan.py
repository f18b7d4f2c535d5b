"""Makes a floor plan from a template: rooms, walls, ways, windows, and the outcome of its preferences."""

from random import Random
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ....schemas.templates.body import TemplateFloorplan, WorldTemplateBody
from ....schemas.worlds.world import Floorplan, Passage, Point, Room, Wall, Window
from ..doors.doors import hang_doors
from .brief import EXTERIOR_WALL, Brief, brief, length_over_width
from .connections import Way, connect
from .partition import UNITS_PER_M, Corners, Partition, area, extent, slenderness
from .partition_search import find_partition
from .preferences import preference_report
from .walls import Pane, Piece, build_walls, place_windows

LINTEL_M = 2.1
"""Height of doorways."""

_ORIGIN_CLEARANCE = 20
"""Distance of the origin from walls where there is room for it, in units."""

_LATTICE = 10

Spot = tuple[int, int]


class Spots(NamedTuple):
    """Places spread over a room, in units, and their distance from its walls' faces; negative outside."""

    x: NDArray[np.int64]
    y: NDArray[np.int64]
    clearance: NDArray[np.float64]


def generate_floorplan(body: WorldTemplateBody, rng: np.random.Generator) -> Floorplan:
    """Makes a floor plan; the same body and the same generator state give the same plan.

    Rooms tile the footprint. Every room is connected. The origin lies inside a room, at least 0.5 m
    from every wall, and all coordinates are multiples of 5 cm.

    Args:
        body: the template.
        rng: the source of chance.

    Raises:
        WorldGenerationError: no valid plan within the bounded number of attempts.
    """
    preferences = body.floorplan
    # The search takes thousands of small draws, for which the standard library's generator is ten times faster.
    dice = Random(int(rng.integers(2**63)))  # noqa: S311
    numbers = brief(preferences)
    plan = find_partition(numbers, dice)
    ways = connect(plan, numbers, dice)
    panes = place_windows(plan, numbers, dice)
    spots = [_spots(corners) for corners in plan.rooms]
    origin = _origin(plan, numbers, ways, spots)
    drawn = Floorplan(
        footprint=_points(((0, 0), (plan.width, 0), (plan.width, plan.height), (0, plan.height)), origin),
        ceiling_height_m=preferences.Ceiling.Height,
        rooms=[_room(preferences, plan, number, spots[number], origin) for number in range(len(plan.rooms))],
        walls=[_wall(piece, numbers, origin) for piece in build_walls(plan, ways)],
        passages=[_passage(way, numbers, origin) for way in ways],
        windows=[_window(pane, numbers, origin) for pane in panes],
        wishes=preference_report(preferences, numbers, plan, ways),
    )
    return hang_doors(drawn)[0] if body.Version == "2" else drawn


def _origin(plan: Partition, numbers: Brief, ways: list[Way], spots: list[Spots]) -> Spot:
    """A free spot: in the largest living room or hallway if that is wide enough, near its ways in."""

    def rank(room: int) -> tuple[int, bool, float]:
        public = numbers.types[room] in ("Living", "Hallway")
        clearance = round(spots[room].clearance.max())
        return min(clearance, _ORIGIN_CLEARANCE), public, area(plan.rooms[room])

    room = max(range(len(plan.rooms)), key=rank)
    x, y, clearance = spots[room]
    # A room without ways has its middle instead.
    doors = [_middle(way) for way in ways if room in way.pair] or [(int(x.mean()), int(y.mean()))]
    far = sum((np.hypot(x - u, y - v) for u, v in doors), np.zeros(len(x)))
    best = np.lexsort((far, -np.minimum(clearance, _ORIGIN_CLEARANCE)))[0]
    return int(x[best]), int(y[best])


def _spots(corners: Corners) -> Spots:
    """A lattice of spots over a room."""
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


def _points(spots: Corners, origin: Spot) -> list[Point]:
    # Dividing whole numbers gives the nearest float to the decimal: 3.15, not 3.1500000000000004.
    return [((x - origin[0]) / UNITS_PER_M, (y - origin[1]) / UNITS_PER_M) for x, y in spots]


def _ends(horizontal: bool, at: int, start: int, end: int, origin: Spot) -> tuple[Point, Point]:
    spots = ((start, at), (end, at)) if horizontal else ((at, start), (at, end))
    first, last = _points(spots, origin)
    return first, last


def _room(preferences: TemplateFloorplan, plan: Partition, number: int, spots: Spots, origin: Spot) -> Room:
    preference, corners = preferences.Rooms[number], plan.rooms[number]
    middle = int(spots.clearance.argmax())
    return Room(
        name=preference.Name,
        original_name=preference.OriginalName,
        type=preference.Type,
        polygon=_points(corners, origin),
        area_m2=area(corners) / UNITS_PER_M**2,
        aspect_ratio=round(slenderness(plan, number), 4),
        desired_area_m2=preference.DesiredShape.Area,
        desired_aspect_ratio=length_over_width(preference.DesiredShape.AspectRatio),
        goal=_points(((int(spots.x[middle]), int(spots.y[middle])),), origin)[0],
    )


def _wall(piece: Piece, numbers: Brief, origin: Spot) -> Wall:
    start, end = _ends(piece.horizontal, piece.at, piece.start, piece.end, origin)
    return Wall(
        start=start,
        end=end,
        thickness_m=piece.thickness / UNITS_PER_M,
        exterior=len(piece.rooms) == 1,
        rooms=[numbers.names[room] for room in piece.rooms],
        lintel=piece.lintel,
        bottom_m=LINTEL_M if piece.lintel else 0.0,
    )


def _passage(way: Way, numbers: Brief, origin: Spot) -> Passage:
    start, end = _ends(way.contact.horizontal, way.contact.at, way.start, way.end, origin)
    return Passage(
        kind=way.kind,
        rooms=(numbers.names[way.pair[0]], numbers.names[way.pair[1]]),
        start=start,
        end=end,
        width_m=(way.end - way.start) / UNITS_PER_M,
        requested=way.requested,
    )


def _window(pane: Pane, numbers: Brief, origin: Spot) -> Window:
    start, end = _ends(pane.horizontal, pane.at, pane.start, pane.end, origin)
    return Window(start=start, end=end, room=numbers.names[pane.room])
