"""Places where a balcony can be attached to a floor plan: outer walls of rooms with free ground before them."""

from collections.abc import Iterator, Sequence
from math import log
from random import Random
from typing import NamedTuple

from ....schemas.worlds.world import Floorplan, Point, Room, RoomType, Wall, Window, contains
from ..floorplans.brief import DOOR_CLEARANCE, DOOR_WIDTH, EXTERIOR_WALL
from ..floorplans.partition import UNITS_PER_M

RAILING_WALL = 2
"""Thickness of a railing in grid units of 5 cm: as an inner wall, so that its faces lie on the grid."""

_LEAST_DEEP, _MOST_DEEP = 24, 50
"""Depth of a balcony's floor in grid units: 1.2 m hold a chair and a robot beside it, more than 2.5 m is a terrace."""

_LEAST_LONG = DOOR_WIDTH + 2 * DOOR_CLEARANCE
"""Least length of a balcony's floor along the wall, in grid units: its door with the wall beside it."""

_FROM_CORNER = EXTERIOR_WALL
"""Least distance of a railing from the corners of its room, in grid units, so that no railing meets a wall's end."""

_GAP = 6
"""Least free distance to other walls and balconies, in grid units: 0.3 m, so that no slit looks like a mistake."""

_FRAME = 3
"""Least distance between a window and a door or railing, in grid units: both frames fit between."""

_HOST_COSTS: dict[RoomType, float] = {"Living": 0.0, "Bedroom": 0.15, "Dining": 0.2, "Office": 0.3, "Kitchen": 0.3}
"""Costs of a balcony at a room of a type; other types cost `_ODD_HOST`."""
_ODD_HOST = 5.0
_SECOND_BALCONY = 0.5
"""Cost of a balcony at a room that has one already."""
_LOST_WINDOW = 0.3
"""Cost of a window that the glazed door replaces, or that a railing would cut in two."""
_CHANCE = 0.3
"""Largest random cost: what is nearly as good falls either way, so that worlds differ."""
_AREA_WEIGHT = 4.0
"""Weight of a relative error of the area, against the logarithm of an aspect ratio's error: areas matter more."""

Span = tuple[int, int]
Cells = tuple[int, int, int, int]
"""Rectangle in grid units: west, south, east, north."""


class Size(NamedTuple):
    """Size of a balcony's floor along and across the wall, in grid units, and the cost of its errors."""

    long: int
    deep: int
    cost: float


class Site(NamedTuple):
    """A place for a balcony at an outer wall, in grid units from the world's origin."""

    host: str
    """Name of the room that has the balcony's door."""
    wall: int
    """Number of the wall in the floor plan."""
    horizontal: bool
    at: int
    """Centre line of the wall, across it."""
    out: int
    """Direction out of the building, across the wall: 1 or -1."""
    span: Span
    """Centre lines of the railings at both ends of the balcony, along the wall."""
    deep: int
    """Distance from the centre line of the wall to that of the railing in front."""
    door: Span
    cost: float

    def point(self, along: int, off: int) -> Point:
        """Returns the position in metres that is `along` on the wall's axis and `off` units outside its centre line."""
        across = self.at + self.out * off
        x, y = (along, across) if self.horizontal else (across, along)
        # Dividing whole numbers gives the nearest float to the decimal, as in all plans.
        return x / UNITS_PER_M, y / UNITS_PER_M


def sites(plan: Floorplan, area_m2: float, ratio: float, hosts: Sequence[str], dice: Random) -> list[Site]:
    """Lists places for a balcony, the best one first.

    Args:
        plan: The plan so far, with other balconies.
        area_m2: Desired floor area.
        ratio: Desired length over width of the floor.
        hosts: Names of the rooms that may have its door.
        dice: The source of chance.
    """
    rooms = {room.name: room for room in plan.rooms}
    found: list[Site] = []
    for number, wall in enumerate(plan.walls):
        if wall.exterior and not wall.lintel and len(wall.rooms) == 1 and wall.rooms[0] in hosts:
            found += _at_wall(plan, number, rooms[wall.rooms[0]], area_m2 * UNITS_PER_M**2, ratio, dice)
    return sorted(found, key=lambda site: site.cost)


def _at_wall(plan: Floorplan, number: int, host: Room, area: float, ratio: float, dice: Random) -> Iterator[Site]:
    """Yields places at one wall: at its ends, and where the fewest windows are lost.

    Nothing is yielded if the wall is on no side of the host, or if no balcony fits there.

    Args:
        plan: The floor plan.
        number: The wall's number in the plan.
        host: The room that the balcony belongs to.
        area: The balcony's preferred area, in square grid units.
        ratio: Its preferred length over width.
        dice: The source of chance.
    """
    wall = plan.walls[number]
    horizontal, at, (start, end) = line_of(wall)
    edge = _edge_of(host, horizontal, at, (start, end))
    if edge is None:
        return
    low = max(start + RAILING_WALL // 2, edge[0] + _FROM_CORNER)
    high = min(end - RAILING_WALL // 2, edge[1] - _FROM_CORNER)
    size = fitting_size(high - low - RAILING_WALL, area, ratio)
    if size is None:
        return
    middle = (low + high) / 2 / UNITS_PER_M
    beside = (at + EXTERIOR_WALL) / UNITS_PER_M
    out = -1 if contains(host.polygon, *((middle, beside) if horizontal else (beside, middle))) else 1
    windows = [span for line, across, span in map(line_of, plan.windows) if (line, across) == (horizontal, at)]
    has_one = any(
        not each.lintel and host.name in each.rooms and len(each.rooms) == 2 and each.exterior for each in plan.walls
    )
    usual = _HOST_COSTS.get(host.type, _ODD_HOST) + size.cost + _SECOND_BALCONY * has_one
    slack = high - low - RAILING_WALL - size.long
    deep = size.deep + (EXTERIOR_WALL + RAILING_WALL) // 2
    spans = [(low + shift, low + shift + size.long + RAILING_WALL) for shift in range(slack + 1)]
    crossed = {span: sum(is_lost(window, span) for window in windows) for span in spans}
    best = [span for span in spans if crossed[span] == min(crossed.values())]
    for span in sorted({best[0], best[len(best) // 2], best[-1], dice.choice(best), spans[0], spans[-1]}):
        door, lost = _door(span, (edge[0] + EXTERIOR_WALL // 2, edge[1] - EXTERIOR_WALL // 2), windows, dice)
        site = Site(host.name, number, horizontal, at, out, span, deep, door, 0.0)
        if door != (0, 0) and _is_free(plan, site):
            yield site._replace(cost=usual + _LOST_WINDOW * (lost + crossed[span]) + _CHANCE * dice.random())


def line_of(wall: Wall | Window) -> tuple[bool, int, Span]:
    """Returns whether a wall or window runs along x, its centre line and its ends, in grid units.

    The ends are coordinates along the line, the lower one first.
    """
    (x0, y0), (x1, y1) = ((round(x * UNITS_PER_M), round(y * UNITS_PER_M)) for x, y in (wall.start, wall.end))
    if abs(x1 - x0) >= abs(y1 - y0):
        return True, y0, (min(x0, x1), max(x0, x1))
    return False, x0, (min(y0, y1), max(y0, y1))


def _edge_of(host: Room, horizontal: bool, at: int, span: Span) -> Span | None:
    """Returns the ends of the side of a room that a wall is on; `None` if there is none.

    All lengths are in grid units: `at` is the wall's line, and `span` its ends along that line.
    """
    corners = [(round(x * UNITS_PER_M), round(y * UNITS_PER_M)) for x, y in host.polygon]
    for one, other in zip(corners, [*corners[1:], corners[0]], strict=True):
        along, across = (0, 1) if horizontal else (1, 0)
        edge = min(one[along], other[along]), max(one[along], other[along])
        if one[across] == other[across] == at and _overlap(edge, span):
            return edge
    return None


def fitting_size(longest: int, area: float, ratio: float) -> Size | None:
    """Returns the size of a balcony's floor that is nearest to the desired one; `None` if the wall is too short.

    Args:
        longest: Length of the wall that is free for it, in grid units.
        area: Desired floor area, in square grid units.
        ratio: Desired length over width.
    """
    found: list[Size] = []
    for long in range(_LEAST_LONG, longest + 1):
        deep = min(max(round(area / long), _LEAST_DEEP), _MOST_DEEP)
        off = abs(log(max(long, deep) / min(long, deep) / ratio))
        found.append(Size(long, deep, _AREA_WEIGHT * abs(long * deep / area - 1) + off))
    return min(found, key=lambda size: size.cost, default=None)


def _door(span: Span, inside: Span, windows: Sequence[Span], dice: Random) -> tuple[Span, int]:
    """Chooses the place of a balcony's door, and counts the windows that are lost to it.

    Args:
        span: Centre lines of the railings at both ends.
        inside: Faces of the walls at both ends in the room.
        windows: Windows in the wall.
        dice: The source of chance.

    Returns:
        The door's ends along the wall in grid units, (0, 0) if it has no place; and the number of lost windows.
    """
    half = RAILING_WALL // 2
    first = max(span[0] + half, inside[0]) + DOOR_CLEARANCE
    last = min(span[1] - half, inside[1]) - DOOR_CLEARANCE - DOOR_WIDTH
    doors = [(at, at + DOOR_WIDTH) for at in range(first, last + 1)]
    if not doors:
        return (0, 0), 0
    lost = {door: sum(_overlap(_framed(door), window) for window in windows) for door in doors}
    least = min(lost.values())
    best = [door for door in doors if lost[door] == least]
    # At an end of the balcony it leaves the rest to furniture.
    door = dice.choice([best[0], best[-1]])
    return door, least


def _framed(door: Span) -> Span:
    return door[0] - _FRAME, door[1] + _FRAME


def is_lost(window: Span, span: Span, door: Span | None = None) -> bool:
    """Whether a window has no place in a wall with a balcony, all in grid units along the wall.

    Args:
        window: Its ends.
        span: Centre lines of the railings, which must not end at the window.
        door: The balcony's door, if it is known.
    """
    return any(_overlap((side - _FRAME, side + _FRAME), window) for side in span) or (
        door is not None and _overlap(_framed(door), window)
    )


def _is_free(plan: Floorplan, site: Site) -> bool:
    """Whether no wall and no other balcony stands on a site or near it."""
    along = (site.span[0] - _GAP, site.span[1] + _GAP)
    ends = (site.at + site.out * EXTERIOR_WALL // 2, site.at + site.out * (site.deep + _GAP))
    across = min(ends), max(ends)
    (x0, x1), (y0, y1) = (along, across) if site.horizontal else (across, along)
    return not any(_hit((x0, y0, x1, y1), _cells(wall)) for wall in plan.walls if not wall.lintel)


def _cells(wall: Wall) -> Cells:
    horizontal, at, (start, end) = line_of(wall)
    half = round(wall.thickness_m * UNITS_PER_M) // 2
    return (start, at - half, end, at + half) if horizontal else (at - half, start, at + half, end)


def _hit(one: Cells, other: Cells) -> bool:
    return one[0] < other[2] and other[0] < one[2] and one[1] < other[3] and other[1] < one[3]


def _overlap(one: Span, other: Span) -> bool:
    return one[0] < other[1] and other[0] < one[1]
