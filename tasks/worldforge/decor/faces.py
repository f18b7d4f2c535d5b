"""Faces of walls as rooms see them, the openings in them, and the boxes that cover them."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from ....schemas.worlds.world import Room, Wall, Window, World, bounds, contains
from ..geometry.boxes import Box, box_of, hits
from ..geometry.parts import Color, Span, Vector
from ..ornaments.ornaments import ALONG_X, ALONG_Y, CYLINDER_QUAT, Ornament, color_look

WINDOW_SILL_M = 0.9
WINDOW_HEAD_M = 2.1

_SAME_M = 1e-6
_WALL_M = 0.1
"""Half the thickness of an outer wall, in metres."""


@dataclass(frozen=True, slots=True)
class Face:
    """One side of a wall, seen from one room, on which decoration is placed."""

    number: int
    """Number of the wall in the floor plan."""
    wall: Wall
    room: Room
    along_x: bool
    at: float
    """Coordinate of a wall's face across the wall, in metres."""
    inward: float
    """Direction from a wall's face into the room, along the axis across the wall: 1 or -1."""
    span: Span
    """Coordinates of a wall's two ends along the wall, in metres."""
    windows: list[tuple[int, Span]]
    """Number and two ends of each window in the wall, in order along the wall."""

    def box(self, along: Span, off: Span, up: Span) -> tuple[Vector, Vector]:
        """Returns centre and half sizes of a box on a wall, from distances along, off and up the wall."""
        middle, across = (along[0] + along[1]) / 2, self.at + self.inward * (off[0] + off[1]) / 2
        half, deep, high = (along[1] - along[0]) / 2, (off[1] - off[0]) / 2, (up[1] - up[0]) / 2
        z = (up[0] + up[1]) / 2
        if self.along_x:
            return (middle, across, z), (half, deep, high)
        return (across, middle, z), (deep, half, high)

    def bar(self, name: str, along: Span, off: Span, up: Span, color: Color) -> Ornament:
        """Makes a decorative box on a wall, from distances along, off and up the wall."""
        return Ornament(name, "box", *self.box(along, off, up), color_look(color))

    def rod(self, name: str, along: Span, off: float, up: float, radius: float, color: Color) -> Ornament:
        """Makes a decorative cylinder along the wall."""
        center, half = self.box(along, (off, off), (up, up))
        quat = CYLINDER_QUAT["x" if self.along_x else "y"]
        return Ornament(name, "cylinder", center, (radius, max(half)), color_look(color), quat)

    def strip(self, along: Span, near: float, far: float) -> Box:
        """Returns the floor area between two distances off a wall."""
        one, other = sorted((self.at + self.inward * near, self.at + self.inward * far))
        return (along[0], one, along[1], other) if self.along_x else (one, along[0], other, along[1])

    @property
    def inner(self) -> Span:
        """Returns the stretch of the wall's side that is certainly inside the room, as coordinates along the wall."""
        low, high = bounds(self.room.polygon)[1 - self.along_x :: 2]
        return max(self.span[0], low + _WALL_M), min(self.span[1], high - _WALL_M)

    @property
    def quat(self) -> str:
        """Returns the MJCF quaternion that turns a picture on the wall to face the room."""
        return ALONG_X if self.along_x else ALONG_Y


def wall_span(wall: Wall | Window) -> tuple[bool, float, Span]:
    """Returns whether a wall or window runs along x, its centre line, and its ends, in metres.

    The ends are coordinates along the line, the lower one first.
    """
    (x0, y0), (x1, y1) = wall.start, wall.end
    if abs(x1 - x0) >= abs(y1 - y0):
        return True, y0, (min(x0, x1), max(x0, x1))
    return False, x0, (min(y0, y1), max(y0, y1))


def faces(world: World) -> Iterator[Face]:
    """Lists the sides that all walls that reach the floor turn to rooms inside the building."""
    rooms = {room.name: room for room in world.floorplan.rooms if not room.is_outdoor}
    for number, wall in enumerate(world.floorplan.walls):
        if wall.lintel:
            continue
        along_x, at, span = wall_span(wall)
        middle = (span[0] + span[1]) / 2
        windows = windows_in(wall, world)
        for name in filter(rooms.__contains__, wall.rooms):
            for side in (1.0, -1.0):
                across = at + side * wall.thickness_m
                if contains(rooms[name].polygon, *((middle, across) if along_x else (across, middle))):
                    face_at = at + side * wall.thickness_m / 2
                    yield Face(number, wall, rooms[name], along_x, face_at, side, span, windows)


def window_heights(world: World) -> Span:
    """Returns the heights of sill and head of all windows of a world, in metres."""
    return WINDOW_SILL_M, min(WINDOW_HEAD_M, world.floorplan.ceiling_height_m - 0.2)


def walls_of_windows(world: World) -> dict[int, Wall]:
    """Returns the wall of each window, by the window's number."""
    return {number: wall for wall in world.floorplan.walls for number, _ in windows_in(wall, world)}


def windows_in(wall: Wall, world: World) -> list[tuple[int, Span]]:
    """Lists the windows in an outer wall, in order of place: number in the plan, and ends along the wall in metres.

    Inner walls and lintels have none.
    """
    if not wall.exterior or wall.lintel:
        return []
    along_x, at, (low, high) = wall_span(wall)
    found = []
    for number, window in enumerate(world.floorplan.windows):
        runs, line, span = wall_span(window)
        same = runs == along_x and abs(line - at) < _SAME_M
        if same and low - _SAME_M <= span[0] and span[1] <= high + _SAME_M:
            found.append((number, span))
    return sorted(found, key=lambda each: each[1])


Standing = tuple[Box, float]
"""Footprint of a piece of furniture, and its height in metres."""


def covered(world: World, room: str) -> list[Standing]:
    """Lists the furniture on a room's floor: footprint and height of each piece."""
    return [
        (box_of(item), item.height_m) for item in world.furniture if item.room == room and not item.movable
    ]  # fmt: skip


def free_height(spot: Box, standing: Sequence[Standing]) -> float:
    """Returns the height in metres of the tallest furniture in an area; 0 without furniture."""
    return max((height for box, height in standing if hits(spot, (box,))), default=0.0)
