"""Free space for furniture in a room: rectangles, keep-clear zones, and paths for robots that must stay open."""

import itertools
from collections.abc import Iterable, Sequence
from typing import NamedTuple

from ....schemas.worlds.world import Floorplan, Passage, Point, Room, Wall, bounds, contains
from ..doors.door_parts import open_box, swept_box
from ..geometry.boxes import FRONTS, Box, Pose, hits, left_over, strip
from ..geometry.occupancy import wall_corners
from .free_ways import Ways

TALL_M = 1.1
"""Height above which furniture would cover the glass of a window, in metres."""

WALL_GAP_M = 0.015
"""Gap between a piece of furniture and the wall beside or behind it, in metres."""

_HALF_WAY_M = 0.3
"""Half the width of the paths kept open in rooms, in metres.

It is the robot's radius of 0.2 m, a map cell, and some margin.
"""

_HALF_HALLWAY_M = 0.4
"""Half the width of the paths kept open in hallways, in metres.

Cells are squares of 5 cm, so at least 0.85 m stay clear there.
"""

_LEAST_HALF_M = 0.25
"""Half the width of the paths kept open where open doors leave no more, in metres: the robot's need, and a map cell."""

_ORIGIN_HALF_M = 0.56
_DOOR_DEPTH_M = 0.8
_OPENING_DEPTH_M = 0.5
_WINDOW_DEPTH_M = 0.4
_GATE_M = 0.475
"""Distance from the middle of a wall to the beginning of paths, in metres.

It is the nearest cell centre that a path can have.
"""


class Side(NamedTuple):
    """A side of a room with a wall, seen from inside."""

    low: float
    """Start of a wall along its axis, on the corners' centre lines, in metres."""
    high: float
    face: float
    """Coordinate of a wall's face across the wall, in metres."""
    quarter: int
    """Direction from the wall into the room, in quarter turns from +x."""

    @property
    def axis(self) -> int:
        """Axis along which a room's side runs: 0 for x, 1 for y."""
        return 1 - self.quarter % 2

    def pose(self, along: float, inward: float, score: float = 0.0) -> Pose:
        """Returns a furniture pose with its back to the wall, its centre `inward` metres from the wall."""
        at = self.face + inward * sum(FRONTS[self.quarter])
        return Pose(along, at, self.quarter, score) if self.axis == 0 else Pose(at, along, self.quarter, score)

    def strip(self, near: float, far: float) -> Box:
        """Returns the floor rectangle between two distances from the wall."""
        sign = sum(FRONTS[self.quarter])
        one, other = sorted((self.face + sign * near, self.face + sign * far))
        return (self.low, one, self.high, other) if self.axis == 0 else (one, self.low, other, self.high)


class RoomSpace:
    """Free space of a room while it is being furnished.

    Attributes:
        room: The room.
        bounds: Bounding box of the room.
        sides: Sides of the room that have walls.
        kept_m2: Floor before doors and openings, on which nothing stands.
    """

    def __init__(self, room: Room, floorplan: Floorplan, *, is_small: bool = False) -> None:
        """Makes the space of an empty room.

        Args:
            room: The room.
            floorplan: Floor plan of the room.
            is_small: Whether paths are only as wide as a robot needs, in place of the usual width.
        """
        self.room = room
        self.bounds = bounds(room.polygon)
        self.sides = _sides_of(room, floorplan)
        outside = _complement(room)
        walls = _walls_near(self.bounds, floorplan)
        self._solids = [*walls, *outside]
        passages = [passage for passage in floorplan.passages if room.name in passage.rooms]
        self._keep = [(-_ORIGIN_HALF_M, -_ORIGIN_HALF_M, _ORIGIN_HALF_M, _ORIGIN_HALF_M)]
        for passage in passages:
            self._keep += _clear_at(passage, room)
        self.kept_m2 = sum(one.width_m * _depth_m(one) for one in passages)
        self._glass = [strip(w.start, w.end, _WINDOW_DEPTH_M) for w in floorplan.windows if w.room == room.name]
        self._zones: dict[str, list[Box]] = {}
        leaves = [open_box(passage.door) for passage in floorplan.passages if passage.door]
        gates = [_gate(room, passage.start, passage.end) for passage in passages]
        gates += [(0.0, 0.0)] if contains(room.polygon, 0.0, 0.0) else []
        halves = (_HALF_HALLWAY_M, _HALF_WAY_M, _LEAST_HALF_M)
        for half in halves[2 if is_small and room.type != "Hallway" else room.type != "Hallway" :]:
            self._ways = Ways(self.bounds, half, [*walls, *leaves], outside)
            self._ways.join(gates)
            if self._ways.joined:
                break

    def admits(self, box: Box, *, tall: bool = False, partners: Sequence[str] = (), tucked: Box | None = None) -> bool:
        """Whether a piece of furniture may cover a rectangle, apart from its own clearances and the robots' paths.

        Args:
            box: The rectangle.
            tall: Whether the piece would hide a window.
            partners: Ids of the pieces it belongs to, whose keep-clear zones it may enter.
            tucked: Footprint of the piece it may be pushed under.
        """
        x0, y0, x1, y1 = self.bounds
        if box[0] < x0 or box[1] < y0 or box[2] > x1 or box[3] > y1:
            return False
        if hits(box, self._keep) or not self.is_clear(box, tucked) or (tall and hits(box, self._glass)):
            return False
        if not partners:
            return not hits(box, itertools.chain.from_iterable(self._zones.values()))
        return not any(hits(box, zone) for owner, zone in self._zones.items() if owner not in partners)

    def is_clear(self, box: Box, tucked: Box | None = None) -> bool:
        """Whether a rectangle is free of walls and furniture; the piece whose footprint is `tucked` does not count."""
        return not hits(box, self._solids if tucked is None else [solid for solid in self._solids if solid != tucked])

    def spans(self, side: Side, depth_m: float, front_m: float, *, tall: bool = False) -> list[tuple[float, float]]:
        """Returns the free stretches of a wall for furniture of a depth, with free space in front.

        They are (low, high) in metres along the wall; stretches of up to 0.2 m are left out.
        """
        axis = side.axis
        body = side.strip(0.0, depth_m + WALL_GAP_M)
        before = side.strip(depth_m + WALL_GAP_M, depth_m + WALL_GAP_M + front_m)
        kept = [*self._keep, *itertools.chain.from_iterable(self._zones.values()), *(self._glass if tall else ())]
        taken = _shadows(axis, body, [*self._solids, *kept])
        if front_m:
            taken += _shadows(axis, before, self._solids)
        gap = WALL_GAP_M
        ends = (side.low, side.high)
        return [
            (low + (gap if low > ends[0] else 0.0), high - (gap if high < ends[1] else 0.0))
            for low, high in left_over(side.low, side.high, taken)
            if high - low > 0.2
        ]

    def stays_open(self, *boxes: Box) -> bool:
        """Whether a robot can still get from every door to every other with the given pieces in place."""
        return self._ways.stays_open(*boxes)

    def beside_ways(self) -> list[Point]:
        """Returns points near walls and furniture, where robots do not drive anyway; furniture may cover them."""
        return self._ways.margins()

    def keep_clear(self, owner: str, box: Box) -> None:
        """Reserves a floor rectangle that only its owner's partners may use."""
        self._zones[owner].append(box)

    def add(self, owner: str, box: Box, zones: Sequence[Box]) -> None:
        """Places a piece of furniture that `admits` and `stays_open` have accepted."""
        self._solids.append(box)
        self._zones[owner] = list(zones)
        self._ways.block(box)

    def goal(self) -> Point:
        """Returns the point nearest to the room's middle that a robot can reach."""
        return self._ways.nearest(self.room.goal)


def _shadows(axis: int, strip: Box, boxes: Iterable[Box]) -> list[tuple[float, float]]:
    """Returns the stretches (low, high) along an axis in which boxes overlap a strip along it, in the boxes' order."""
    across = 1 - axis
    near, far = strip[across] + 1e-6, strip[across + 2] - 1e-6
    return [(box[axis], box[axis + 2]) for box in boxes if box[across] < far and near < box[across + 2]]


def _sides_of(room: Room, floorplan: Floorplan) -> list[Side]:
    """Returns the sides of a room that have a wall; the inside of a counter-clockwise polygon lies to their left."""
    walls = [wall for wall in floorplan.walls if not wall.lintel and room.name in wall.rooms]
    sides: list[Side] = []
    for start, end in _edges(room):
        upright = start[0] == end[0]
        quarter = (2 if end[1] > start[1] else 0) if upright else (1 if end[0] > start[0] else 3)
        across, along = (0, 1) if upright else (1, 0)
        half = max((wall.thickness_m / 2 for wall in walls if _lies_on(wall, across, start[across])), default=0.0)
        if half > 0:
            low, high = sorted((start[along], end[along]))
            sides.append(Side(low, high, start[across] + half * sum(FRONTS[quarter]), quarter))
    return sides


def _lies_on(wall: Wall, across: int, at: float) -> bool:
    return abs(wall.start[across] - at) < 1e-6 and abs(wall.end[across] - at) < 1e-6


def _edges(room: Room) -> list[tuple[Point, Point]]:
    return list(zip(room.polygon, [*room.polygon[1:], room.polygon[0]], strict=True))


def _clear_at(passage: Passage, room: Room) -> list[Box]:
    """Returns the boxes that must stay free at a door or opening: the approach, and the swing of its door."""
    found = [strip(passage.start, passage.end, _depth_m(passage))]
    if passage.door is not None and passage.door.room == room.name:
        found.append(swept_box(passage.door))
    return found


def _depth_m(passage: Passage) -> float:
    return _DOOR_DEPTH_M if passage.kind == "Doorway" else _OPENING_DEPTH_M


def _gate(room: Room, start: Point, end: Point) -> Point:
    """Returns the point inside the room in front of the middle of a door or opening."""
    x, y = (start[0] + end[0]) / 2, (start[1] + end[1]) / 2
    along_x = abs(end[0] - start[0]) > abs(end[1] - start[1])
    sides = [(x, y + _GATE_M), (x, y - _GATE_M)] if along_x else [(x + _GATE_M, y), (x - _GATE_M, y)]
    return next((side for side in sides if contains(room.polygon, *side)), sides[0])


def _complement(room: Room) -> list[Box]:
    """Returns rectangles that cover a room's bounding box outside the room."""
    xs, ys = (sorted({corner[axis] for corner in room.polygon}) for axis in (0, 1))
    return [
        (x0, y0, x1, y1)
        for x0, x1 in itertools.pairwise(xs)
        for y0, y1 in itertools.pairwise(ys)
        if not contains(room.polygon, (x0 + x1) / 2, (y0 + y1) / 2)
    ]


def _walls_near(box: Box, floorplan: Floorplan) -> list[Box]:
    near = (box[0] - 0.3, box[1] - 0.3, box[2] + 0.3, box[3] + 0.3)
    walls = [bounds(wall_corners(wall)) for wall in floorplan.walls if not wall.lintel]
    return [wall for wall in walls if hits(near, (wall,))]
