"""Gives doorways doors: chooses the side of the hinges and the room that each door opens into.

A leaf stands in the gap of its wall, flush with the face on the side it opens to, and turns about its corner there;
so nothing of it ever enters the wall. What it sweeps is a quarter of a disc: free of walls, of what other doors
sweep, and of the clear cylinder at the origin. Fully open it leaves every other way free. Among the places left, an
architect's rules decide: not into a hallway, not into a closet, rather into the smaller room, the leaf against the
nearer wall.
"""

from collections.abc import Sequence
from math import atan2, cos, hypot, pi, sin
from typing import NamedTuple

import numpy as np

from ....schemas.worlds.world import Door, Floorplan, Passage, Point, Room, RoomType, bounds, contains
from ..geometry.boxes import Box, strip
from ..geometry.occupancy import occupancy_grid, reachable, room_cells, wall_corners
from .door_parts import HANDLE_M, leaf_outlines, lintel_over, open_box

THICKNESS_M = 0.04
"""Thickness of a door's leaf, in metres."""
GAP_M = 0.005
"""Gap between a door leaf and its frame, in metres, on every side but the floor's."""
BOTTOM_M = 0.01

_ORIGIN_M = 0.58
"""Radius around the world's origin that no door sweeps, in metres: the free circle for robots, and one map cell."""
_APPROACH_M = 0.6
"""Depth in front of every doorway and opening that no open door leaf may cover, in metres: a robot and some margin."""
_ROBOT_M = 0.25
"""Radius of the robot that must reach every room of the unfurnished plan, in metres.

It is larger than the robot that the worlds are checked for.
"""
_MIN_CELLS = 20
_ARC_STEPS = 6
_TOUCHING_M = 1e-6

_ROOM_COSTS: dict[RoomType, float] = {"Balcony": 6.0, "Hallway": 4.0, "Closet": 2.5, "Storage": 2.5}
"""Cost of a door that opens into a room of this type."""
_INTO_LARGER = 1.0
_CORNER_SPAN_M = 2.0


class Hanging(NamedTuple):
    """One way to hang the door of a doorway: hinge side and opening direction."""

    hinge: Point
    along: Point
    """Unit vector from a door's hinge along the closed leaf."""
    into: Point
    """Unit vector into the room that a door opens into."""
    leaf_m: float
    room: Room
    cost: float

    @property
    def swing(self) -> int:
        """Direction in which the door opens: 1 counter-clockwise, -1 clockwise."""
        return 1 if self.along[0] * self.into[1] - self.along[1] * self.into[0] > 0 else -1

    def at(self, along: float, into: float) -> Point:
        """Returns a point from its distances along the wall and into the room, in metres from the hinge."""
        return (
            self.hinge[0] + along * self.along[0] + into * self.into[0],
            self.hinge[1] + along * self.along[1] + into * self.into[1],
        )

    def local(self, box: Box) -> Box:
        """Converts a box to the frame of a door's hinge: along the wall, into the room."""
        (x, y), (u, v), (p, q) = self.hinge, self.along, self.into
        west, south, east, north = box[0] - x, box[1] - y, box[2] - x, box[3] - y
        # All directions are along axes: two opposite corners say everything.
        one, other = (west * u + south * v, west * p + south * q), (east * u + north * v, east * p + north * q)
        return bounds((one, other))

    def sweeps(self, box: Box, margin: float = 0.0) -> bool:
        """Whether the moving door passes within a margin of a box."""
        west, south, east, north = self.local(box)
        if north < _TOUCHING_M - margin or east < _TOUCHING_M - margin - HANDLE_M:
            return False
        return hypot(max(0.0, west), max(0.0, south)) < self.leaf_m + margin - _TOUCHING_M

    @property
    def outline(self) -> list[Point]:
        """Returns the convex polygon around the area that a moving door sweeps."""
        # Tangents to the arc: the polygon lies outside it.
        radius = self.leaf_m / cos(pi / 4 / _ARC_STEPS)
        angles = [(step + 0.5) * pi / 2 / _ARC_STEPS for step in range(_ARC_STEPS)]
        arc = [self.at(radius * cos(angle), radius * sin(angle)) for angle in angles]
        return [self.at(0, 0), self.at(self.leaf_m, 0), *arc, self.at(-HANDLE_M, self.leaf_m), self.at(-HANDLE_M, 0)]

    @property
    def open_leaf(self) -> Box:
        """Box of the fully open door with its handles."""
        return bounds((self.at(-HANDLE_M, 0), self.at(THICKNESS_M + HANDLE_M, self.leaf_m)))


def hang_doors(plan: Floorplan) -> tuple[Floorplan, dict[int, str]]:
    """Gives every doorway of a floor plan a door, where there is space to open it.

    Args:
        plan: The plan, which is left as it is.

    Returns:
        The plan with doors; for the doorways without one, by their place in `passages`, the reason.
    """
    walls = [bounds(wall_corners(wall)) for wall in plan.walls if not wall.lintel]
    doorways = [index for index, passage in enumerate(plan.passages) if passage.kind == "Doorway"]
    options: dict[int, list[Hanging]] = {}
    reasons: dict[int, str] = {}
    for index in doorways:
        options[index], reasons[index] = _options(plan, index, walls)
    chosen = _choose(options)
    passages = list(plan.passages)
    for number, index in enumerate(doorways):
        if index in chosen:
            door = _door(
                f"door-{number + 1}",
                chosen[index],
                plan.passages[index],
                lintel_over(plan, plan.passages[index]).bottom_m,
            )
            passages[index] = passages[index].model_copy(update={"door": door})
            del reasons[index]
        else:
            reasons[index] = reasons[index] or "it would meet other doors wherever its hinges are"
    hung = plan.model_copy(update={"passages": passages})
    return _without_cages(hung, reasons), reasons


def _without_cages(plan: Floorplan, reasons: dict[int, str]) -> Floorplan:
    """Removes doors whose open leaves would together keep a robot out of a room; rarely any.

    The reason for each removed door is added to `reasons`, by passage number. Returns the plan itself if none is
    removed.
    """
    doors = [index for index, passage in enumerate(plan.passages) if passage.door]
    walls = [bounds(wall_corners(wall)) for wall in plan.walls if not wall.lintel]
    leaves = [passage.door for passage in plan.passages if passage.door]
    if not any(_overlap(_before_tip(door), wall) for door in leaves for wall in walls):
        return plan
    while doors and not _all_reached(plan):
        index = doors.pop()
        reasons[index] = "its open leaf would keep a robot out of a room"
        passages = list(plan.passages)
        passages[index] = passages[index].model_copy(update={"door": None})
        plan = plan.model_copy(update={"passages": passages})
    return plan


def _all_reached(plan: Floorplan) -> bool:
    """Whether a robot reaches every room of the unfurnished plan with all doors fully open."""
    grid = occupancy_grid(plan, (), leaf_outlines(plan, fully_open=True))
    reached = reachable(grid, (0.0, 0.0), _ROBOT_M)
    return all(np.count_nonzero(reached & room_cells(grid, room)) >= _MIN_CELLS for room in plan.rooms)


def _before_tip(door: Door) -> Box:
    """Returns the area before an open leaf's free edge in which a wall would leave a robot no room to pass; metres."""
    box = open_box(door)
    x, y = (round(axis) for axis in (cos(door.yaw_at(door.max_angle_rad)), sin(door.yaw_at(door.max_angle_rad))))
    reach = 2 * _ROBOT_M
    return (
        box[2] if x > 0 else box[0] - reach * (x < 0),
        box[3] if y > 0 else box[1] - reach * (y < 0),
        box[2] + reach * (x > 0) if x >= 0 else box[0],
        box[3] + reach * (y > 0) if y >= 0 else box[1],
    )


def _options(plan: Floorplan, index: int, walls: Sequence[Box]) -> tuple[list[Hanging], str]:
    """Returns the possible hangings of a door, cheapest first, and the reason if none is possible, else no text."""
    passage = plan.passages[index]
    others = [other for number, other in enumerate(plan.passages) if number != index]
    west, south, east, north = bounds((passage.start, passage.end))
    reach = passage.width_m + _CORNER_SPAN_M
    near = (west - reach, south - reach, east + reach, north + reach)
    walls = [wall for wall in walls if _overlap(wall, near)]
    found: list[Hanging] = []
    reason = ""
    for hanging in _hangings(plan, passage, walls):
        if any(hanging.sweeps(wall) for wall in walls):
            reason = reason or "its leaf would meet a wall wherever its hinges are"
        elif hanging.sweeps((0.0, 0.0, 0.0, 0.0), _ORIGIN_M):
            reason = "its leaf would sweep through the free space at the origin"
        elif any(_overlap(hanging.open_leaf, _approach(other)) for other in others):
            reason = "its leaf would stand before another way"
        else:
            found.append(hanging)
    found.sort(key=lambda hanging: hanging.cost)
    return found, "" if found else reason


def _hangings(plan: Floorplan, passage: Passage, walls: Sequence[Box]) -> list[Hanging]:
    """Returns the possible hangings of a door with their costs: hinges at either jamb, swinging into either room.

    There are four, or two where only one side of the door is in a room.
    """
    (x0, y0), (x1, y1) = passage.start, passage.end
    half = lintel_over(plan, passage).thickness_m / 2
    rooms = [room for room in plan.rooms if room.name in passage.rooms]
    larger = max(rooms, key=lambda room: room.area_m2)
    made: list[Hanging] = []
    for jamb, other in ((passage.start, passage.end), (passage.end, passage.start)):
        along = ((other[0] - jamb[0]) / passage.width_m, (other[1] - jamb[1]) / passage.width_m)
        along = (float(round(along[0])), float(round(along[1])))
        for into in ((along[1], along[0]), (-along[1], -along[0])):
            middle = ((x0 + x1) / 2 + into[0] * 2 * half, (y0 + y1) / 2 + into[1] * 2 * half)
            room = next((room for room in rooms if contains(room.polygon, *middle)), None)
            if room is None:
                continue
            hinge = tuple(jamb[axis] + along[axis] * GAP_M + into[axis] * half for axis in (0, 1))
            hinge = (round(hinge[0], 4), round(hinge[1], 4))
            hanging = Hanging(hinge, along, into, round(passage.width_m - 2 * GAP_M, 4), room, 0.0)
            cost = _ROOM_COSTS.get(room.type, 0.0) + (_INTO_LARGER if room is larger else 0.0)
            made.append(hanging._replace(cost=cost + _corner_m(hanging, walls) / _CORNER_SPAN_M))
    return made


def _corner_m(hanging: Hanging, walls: Sequence[Box]) -> float:
    """Returns the distance in metres from the open leaf to the next wall behind it, at most `_CORNER_SPAN_M`."""
    nearest = _CORNER_SPAN_M
    for wall in walls:
        _, south, east, north = hanging.local(wall)
        if south < hanging.leaf_m and north > _TOUCHING_M and east <= 0:
            nearest = min(nearest, -east)
    return nearest


def _choose(options: dict[int, list[Hanging]]) -> dict[int, Hanging]:
    """Chooses one way to hang each door so that no two doors sweep the same area.

    Of the choices found, it takes one with the fewest doors left out, then the lowest cost.
    """
    order = sorted(options, key=lambda index: len(options[index]))
    outlines: dict[int, list[Point]] = {}

    def outline(hanging: Hanging) -> list[Point]:
        if id(hanging) not in outlines:
            outlines[id(hanging)] = hanging.outline
        return outlines[id(hanging)]

    best: dict[int, Hanging] = {}
    for _ in range(len(order) + 1):
        chosen: dict[int, Hanging] = {}
        for index in order:
            for hanging in options[index]:
                if not any(
                    _cage(hanging, other) or _meet(outline(hanging), outline(other))
                    for other in chosen.values()
                    if _near(hanging, other)
                ):
                    chosen[index] = hanging
                    break
        best = max(best, chosen, key=lambda some: (len(some), -sum(each.cost for each in some.values())))
        left = [index for index in order if index not in chosen and options[index]]
        if not left:
            break
        # A door that found no place chooses first next time.
        order.remove(left[0])
        order.insert(0, left[0])
    return best


def _door(identifier: str, hanging: Hanging, passage: Passage, head_m: float) -> Door:
    return Door(
        id=identifier,
        hinge=hanging.hinge,
        closed_yaw=round(atan2(hanging.along[1], hanging.along[0]), 6),
        swing=1 if hanging.swing > 0 else -1,
        room=hanging.room.name,
        leaf_width_m=hanging.leaf_m,
        leaf_height_m=round(head_m - BOTTOM_M - GAP_M, 4),
        thickness_m=THICKNESS_M,
        bottom_m=BOTTOM_M,
        max_angle_rad=round(pi / 2, 4),
        clear_width_m=round(passage.width_m - GAP_M - THICKNESS_M, 4),
    )


def _approach(passage: Passage) -> Box:
    """Returns the area in front of a doorway or opening, on both sides."""
    return strip(passage.start, passage.end, _APPROACH_M)


def _overlap(one: Box, other: Box) -> bool:
    across = min(one[2], other[2]) - max(one[0], other[0])
    return across > _TOUCHING_M and min(one[3], other[3]) - max(one[1], other[1]) > _TOUCHING_M


def _cage(one: Hanging, other: Hanging) -> bool:
    """Whether two open door leaves are too close together for a robot to pass between."""
    return _overlap(_grown(one.open_leaf, _APPROACH_M / 2), _grown(other.open_leaf, _APPROACH_M / 2))


def _grown(box: Box, margin: float) -> Box:
    return box[0] - margin, box[1] - margin, box[2] + margin, box[3] + margin


def _near(one: Hanging, other: Hanging) -> bool:
    """Whether two doors are near enough to touch each other in any position."""
    apart = max(abs(one.hinge[0] - other.hinge[0]), abs(one.hinge[1] - other.hinge[1]))
    return apart < one.leaf_m + other.leaf_m + 2 * HANDLE_M + _APPROACH_M


def _meet(one: Sequence[Point], other: Sequence[Point]) -> bool:
    """Whether two convex polygons overlap: no edge of either separates them (separating axis theorem)."""
    if not _overlap(bounds(one), bounds(other)):
        return False
    for polygon in (one, other):
        for index in range(len(polygon)):
            (x0, y0), (x1, y1) = polygon[index - 1], polygon[index]
            u, v = y1 - y0, x0 - x1
            mine, theirs = ([x * u + y * v for x, y in some] for some in (one, other))
            if max(mine) <= min(theirs) + _TOUCHING_M or max(theirs) <= min(mine) + _TOUCHING_M:
                return False
    return True
