"""Rectangles that are divided into rooms: the geometry of floor plans, in whole grid units.

A partition is written as a slicing tree in postfix order (a Polish expression): a number from 0 is a room, a negative
number an operator that joins the two trees before it.

| operator | meaning |
| --- | --- |
| `SIDE_BY_SIDE` | the first left of the second |
| `STACKED` | the first below the second |
| `POCKETS` | the second in a corner of the first, which is one room and becomes L-shaped |

All coordinates are multiples of `UNIT_M`, which is also the resolution of the occupancy map: rooms
tile exactly, and wall faces fall on cell borders.
"""

from collections.abc import Iterator, Sequence
from math import sqrt
from typing import NamedTuple

UNIT_M = 0.05
UNITS_PER_M = 20

SIDE_BY_SIDE = -1
STACKED = -2
POCKETS = (-3, -4, -5, -6)
"""Corner of the box in which the pocket room is: south-west, south-east, north-west, north-east."""

_CORRIDOR_SHARE = 0.4
"""Largest share of the box's area for a pocket room; a larger pocket turns the room around it into a corridor."""

_POCKET_SPAN = 0.75
"""Largest share of the box's side that a pocket room may take."""

Corners = tuple[tuple[int, int], ...]
"""Corners of a room, counter-clockwise, in grid units."""


class Box(NamedTuple):
    """An axis-aligned rectangle in grid units."""

    x0: int
    y0: int
    x1: int
    y1: int


class Contact(NamedTuple):
    """A straight border between two rooms, in grid units; `low` is left of or below `high`."""

    low: int
    high: int
    horizontal: bool
    at: int
    start: int
    end: int


class Partition(NamedTuple):
    """A building footprint from (0, 0) to (`width`, `height`) in grid units, divided into rooms."""

    width: int
    height: int
    rooms: tuple[Corners, ...]
    arms: tuple[int, ...]
    """Narrowest width of each room, in grid units."""

    @property
    def is_full(self) -> bool:
        """Whether the rooms fill the whole rectangle; otherwise all rooms are rectangles."""
        return sum(area(corners) for corners in self.rooms) == self.width * self.height


def partition(
    expression: Sequence[int], areas: Sequence[float], ratios: Sequence[float], width: int, height: int
) -> Partition:
    """Divides a footprint into rooms by a slicing tree, each in proportion to its wished area.

    Args:
        expression: The slicing tree; every room occurs once.
        areas: The rooms' desired areas, in any unit.
        ratios: The rooms' desired length over width; only pockets, which can choose, look at it.
        width: Footprint along x, in units.
        height: Footprint along y, in units.
    """
    sizes, firsts = _sizes(expression, areas)
    boxes: list[Box | None] = [None] * len(expression)
    boxes[-1] = Box(0, 0, width, height)
    rooms: list[Corners] = [()] * len(areas)
    arms = [0] * len(areas)
    for index in range(len(expression) - 1, -1, -1):
        token, box = expression[index], boxes[index]
        if box is None:  # the host of a pocket, which is cut already
            continue
        x0, y0, x1, y1 = box
        if token >= 0:
            rooms[token] = ((x0, y0), (x1, y0), (x1, y1), (x0, y1))
            arms[token] = min(x1 - x0, y1 - y0)
            continue
        first, second = firsts[index], index - 1
        share = sizes[first] / sizes[index]
        host, guest = expression[first], expression[second]
        if token < STACKED and host >= 0:
            pocket = _pocket(box, token, 1 - share, _pocket_ratio(box, guest, ratios))
            boxes[second] = pocket
            rooms[host], arms[host] = _around(box, pocket)
        elif token == STACKED:
            cut = y0 + round((y1 - y0) * share)
            boxes[first], boxes[second] = Box(x0, y0, x1, cut), Box(x0, cut, x1, y1)
        else:
            cut = x0 + round((x1 - x0) * share)
            boxes[first], boxes[second] = Box(x0, y0, cut, y1), Box(cut, y0, x1, y1)
    return Partition(width, height, tuple(rooms), tuple(arms))


def _sizes(expression: Sequence[int], areas: Sequence[float]) -> tuple[list[float], list[int]]:
    """Returns for every token of a slicing tree its subtree's area, and for operators where the first operand ends."""
    sizes: list[float] = []
    firsts: list[int] = []
    roots: list[int] = []
    for index, token in enumerate(expression):
        if token >= 0:
            sizes.append(areas[token])
            firsts.append(-1)
        else:
            second, first = roots.pop(), roots.pop()
            sizes.append(sizes[first] + sizes[second])
            firsts.append(first)
        roots.append(index)
    return sizes, firsts


def _pocket_ratio(box: Box, guest: int, ratios: Sequence[float]) -> float:
    """Returns the preferred width over height (x over y) of a pocket with one room, or with several."""
    if guest >= 0:
        return ratios[guest] if box.x1 - box.x0 > box.y1 - box.y0 else 1 / ratios[guest]
    return {SIDE_BY_SIDE: 2.0, STACKED: 0.5}.get(guest, 1.0)


def _pocket(box: Box, corner: int, share: float, ratio: float) -> Box:
    """Returns the rectangle in a corner of a box with `share` of its area.

    It has the given ratio unless that would make the rest of the box a corridor.
    """
    width, height = box.x1 - box.x0, box.y1 - box.y0
    if share > _CORRIDOR_SHARE:
        # What is left is a corridor around two sides; it is equally wide on both.
        half = (width + height) / 2
        arm = half - sqrt(half * half - width * height * (1 - share))
        along, up = width - arm, height - arm
    else:
        area = share * width * height
        along = sqrt(area * ratio)
        along = max(min(along, width * _POCKET_SPAN), area / (height * _POCKET_SPAN))
        up = area / along
    x_size, y_size = round(along), round(up)
    west, south = corner in (POCKETS[0], POCKETS[2]), corner in (POCKETS[0], POCKETS[1])
    x0 = box.x0 if west else box.x1 - x_size
    y0 = box.y0 if south else box.y1 - y_size
    return Box(x0, y0, x0 + x_size, y0 + y_size)


def _around(box: Box, pocket: Box) -> tuple[Corners, int]:
    """Returns the L-shaped rest of a box around a pocket, counter-clockwise, and the width of its narrower arm."""
    x0, y0, x1, y1 = box
    west, south = pocket.x0 == x0, pocket.y0 == y0
    x, y = (pocket.x1 if west else pocket.x0), (pocket.y1 if south else pocket.y0)
    corners = {
        (True, True): ((x, y0), (x1, y0), (x1, y1), (x0, y1), (x0, y), (x, y)),
        (False, True): ((x0, y0), (x, y0), (x, y), (x1, y), (x1, y1), (x0, y1)),
        (True, False): ((x0, y0), (x1, y0), (x1, y1), (x, y1), (x, y), (x0, y)),
        (False, False): ((x0, y0), (x1, y0), (x1, y), (x, y), (x, y1), (x0, y1)),
    }[west, south]
    return corners, min(x1 - x if west else x - x0, y1 - y if south else y - y0)


def extent(corners: Sequence[tuple[int, int]]) -> Box:
    """Returns the bounding box of a room, in grid units."""
    if len(corners) == 4:  # counter-clockwise from a corner, so opposite corners span it
        (x0, y0), (x1, y1) = corners[0], corners[2]
        if x0 > x1:
            x0, x1 = x1, x0
        if y0 > y1:
            y0, y1 = y1, y0
        return Box(x0, y0, x1, y1)
    xs, ys = [x for x, _ in corners], [y for _, y in corners]
    return Box(min(xs), min(ys), max(xs), max(ys))


def area(corners: Sequence[tuple[float, float]]) -> float:
    """Returns the signed area of a polygon in square grid units; negative if clockwise."""
    following = (*corners[1:], *corners[:1])
    return sum(x * v - u * y for (x, y), (u, v) in zip(corners, following, strict=True)) / 2


def slenderness(plan: Partition, room: int) -> float:
    """Returns length over width of a room, also of L-shaped ones.

    An L-shape with wide arms counts as the rectangle it nearly is, one with narrow arms as a corridor
    that is as long as its arms together: area over width squared.
    """
    corners, arm = plan.rooms[room], plan.arms[room]
    x0, y0, x1, y1 = extent(corners)
    along, up = x1 - x0, y1 - y0
    if len(corners) > 4 and 3 * arm < 2 * min(along, up):
        return area(corners) / arm**2
    return along / up if along > up else up / along


class Lines(NamedTuple):
    """Room borders on one straight line, separated by the side on which the room is."""

    below: list[tuple[int, int, int]]
    """Room borders left of or below a line: (start, end, room)."""
    above: list[tuple[int, int, int]]
    """Room borders right of or above a line: (start, end, room)."""


def lines(rooms: Sequence[Corners]) -> dict[tuple[bool, int], Lines]:
    """Groups all room borders by the line they are on: (horizontal, coordinate).

    Each line has the borders of the rooms below it (or west of it) and above it, as (start, end, room number).
    """
    found: dict[tuple[bool, int], Lines] = {}
    for room, corners in enumerate(rooms):
        x, y = corners[-1]
        for u, v in corners:
            # Counter-clockwise: the room lies to the left of every edge.
            if y == v:
                line = found.setdefault((True, y), Lines([], []))
                if u > x:
                    line.above.append((x, u, room))
                else:
                    line.below.append((u, x, room))
            else:
                line = found.setdefault((False, x), Lines([], []))
                if v > y:
                    line.below.append((y, v, room))
                else:
                    line.above.append((v, y, room))
            x, y = u, v
    return found


def contacts(rooms: Sequence[Corners]) -> list[Contact]:
    """Lists all straight borders that two rooms share."""
    return [
        Contact(low, high, horizontal, at, max(start, other_start), min(end, other_end))
        for (horizontal, at), (below, above) in lines(rooms).items()
        for start, end, low in below
        for other_start, other_end, high in above
        if max(start, other_start) < min(end, other_end)
    ]


class Side(NamedTuple):
    """A straight piece of the building's outline, beside one room."""

    horizontal: bool
    at: int
    start: int
    end: int
    room: int
    forward: bool
    """Whether the room is to the left of its outer wall, when walking from start to end."""


def border(rooms: Sequence[Corners]) -> list[Side]:
    """Lists the sides of rooms that face the outside of the building."""
    found: list[Side] = []
    for (horizontal, at), (below, above) in lines(rooms).items():
        for own, others in ((below, above), (above, below)):
            for start, end, room in own:
                forward = horizontal == (own is above)
                found += [Side(horizontal, at, low, high, room, forward) for low, high in _left(start, end, others)]
    return found


def outline(plan: Partition) -> Corners:
    """Returns the corners of the building's outline, counter-clockwise.

    Raises:
        ValueError: The outline comes twice to a corner, where a yard touches the outside.
    """
    following: dict[tuple[int, int], tuple[int, int]] = {}
    for side in border(plan.rooms):
        low, high = ((along, side.at) if side.horizontal else (side.at, along) for along in (side.start, side.end))
        following.update({low: high} if side.forward else {high: low})
    corners = [min(following)]
    while (corner := following[corners[-1]]) != corners[0]:
        corners.append(corner)
        if len(corners) > len(following):  # caught in a loop that does not come by the first corner
            raise ValueError(f"the outline comes twice to the corner {corner}")
    return turns(corners)


def turns(points: Sequence[tuple[int, int]]) -> Corners:
    """Removes duplicate and collinear points from an outline."""
    kept = [point for index, point in enumerate(points) if point != points[index - 1]]
    return tuple(
        point
        for index, point in enumerate(kept)
        if not any(kept[index - 1][axis] == point[axis] == kept[(index + 1) % len(kept)][axis] for axis in (0, 1))
    )


def _left(start: int, end: int, others: list[tuple[int, int, int]]) -> Iterator[tuple[int, int]]:
    """Yields the parts of an interval that no other interval covers."""
    for low, high, _ in sorted(others):
        if low < end and high > start:
            if low > start:
                yield start, low
            start = max(start, high)
    if start < end:
        yield start, end
