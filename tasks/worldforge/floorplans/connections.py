"""Doorways and openings between rooms: the requested ones if possible, and more until every room is connected."""

from random import Random
from typing import NamedTuple

from ....schemas.worlds.world import PassageKind, RoomType
from .brief import (
    DOOR_CLEARANCE,
    DOOR_WIDTH,
    EXTERIOR_WALL,
    INTERIOR_WALL,
    THROUGHNESS,
    Brief,
    affinity,
    clear_span,
    door_capacity,
    opening_fits,
)
from .partition import Contact, Corners, Partition, area, contacts, extent, slenderness

_MAX_WAYS_PER_ROOM = 4
_OPEN_PLAN: frozenset[RoomType] = frozenset({"Dining", "Hallway", "Kitchen", "Living"})
_OPEN_PLAN_SHARE = 0.35
"""Share of openings (instead of doorways) among connections that the template does not request, between these types."""

_LONGEST_HALLWAY_OPENING = 52
"""Longest wall of a hallway that may become an opening, in grid units.

So a hallway is open towards a room at its end and not along its side, unless the template prefers that.
"""

_NEAR_CORNER_SHARE = 0.75
_NEAR_CORNER = 6

Pair = tuple[int, int]


class Way(NamedTuple):
    """A doorway or opening in a shared wall, from `start` to `end` along the wall, in grid units."""

    pair: Pair
    contact: Contact
    kind: PassageKind
    start: int
    end: int
    requested: bool


def shared_walls(plan: Partition) -> dict[Pair, list[Contact]]:
    """Returns the shared walls of every two rooms of a floor plan, longest first.

    Keys are pairs of room numbers, the lower first; rooms that share no wall have no entry.
    """
    walls: dict[Pair, list[Contact]] = {}
    for contact in contacts(plan.rooms):
        pair = (min(contact.low, contact.high), max(contact.low, contact.high))
        walls.setdefault(pair, []).append(contact)
    for shared in walls.values():
        shared.sort(key=lambda contact: contact.start - contact.end)
    return walls


def connect(plan: Partition, brief: Brief, dice: Random) -> list[Way]:
    """Chooses and places doorways and openings so that every room is connected.

    Args:
        plan: A valid partition.
        brief: The preferences.
        dice: The source of chance.

    Returns:
        The requested ways as far as they fit, and then others.
    """
    walls = shared_walls(plan)
    ways: list[Way] = []
    for pair, kind, count in brief.requests:
        if kind == "Opening":
            ways += _opening(plan, pair, walls.get(pair, []), requested=True)
        else:
            ways += _doorways(plan, pair, walls.get(pair, []), count, dice, requested=True)
    main = _grown({_most_public(plan, brief)}, ways)
    while len(main) < len(plan.rooms):
        pair = _next_pair(plan, brief, walls, ways, main, dice)
        open_plan = _may_be_open(brief, pair, walls[pair]) and dice.random() < _OPEN_PLAN_SHARE
        added = _opening(plan, pair, walls[pair], requested=False) if open_plan else []
        ways += added or _doorways(plan, pair, walls[pair], 1, dice, requested=False)
        main = _grown(main | set(pair), ways)
    return ways


def _may_be_open(brief: Brief, pair: Pair, shared: list[Contact]) -> bool:
    """Whether the wall between two rooms may be left out (an opening), judged by the rooms' types."""
    types = {brief.types[room] for room in pair}
    along = shared[0].end - shared[0].start
    return types <= _OPEN_PLAN and ("Hallway" not in types or along <= _LONGEST_HALLWAY_OPENING)


def _most_public(plan: Partition, brief: Brief) -> int:
    return max(range(len(plan.rooms)), key=lambda room: (THROUGHNESS[brief.types[room]], area(plan.rooms[room])))


def _grown(rooms: set[int], ways: list[Way]) -> set[int]:
    """Returns all rooms that can be reached from the given ones through the connections."""
    grown = set(rooms)
    while True:
        found = {room for way in ways if grown.intersection(way.pair) for room in way.pair}
        if found <= grown:
            return grown
        grown |= found


def _next_pair(
    plan: Partition, brief: Brief, walls: dict[Pair, list[Contact]], ways: list[Way], main: set[int], dice: Random
) -> Pair:
    """Returns the best pair of rooms to connect next: one room is connected already, the other is not.

    At least one pair must have space for a door, else ValueError is raised.
    """
    degrees = [sum(room in way.pair for way in ways) for room in range(len(plan.rooms))]

    def sense(pair: Pair) -> float:
        inner, outer = pair if pair[0] in main else pair[::-1]
        value = affinity(brief.types[inner], brief.types[outer]) * THROUGHNESS[brief.types[inner]]
        if len(_grown({outer}, ways)) > 1:
            value *= THROUGHNESS[brief.types[outer]]
        if max(degrees[inner], degrees[outer]) >= _MAX_WAYS_PER_ROOM:
            value *= 0.1
        # Near ties fall either way.
        return value * (0.8 + 0.2 * dice.random())

    possible = [
        pair
        for pair, shared in walls.items()
        if (pair[0] in main) != (pair[1] in main) and any(door_capacity(contact, plan) for contact in shared)
    ]
    return max(possible, key=sense)


def _opening(plan: Partition, pair: Pair, shared: list[Contact], *, requested: bool) -> list[Way]:
    """Replaces the longest shared wall of two rooms by an opening, from corner to corner, and returns it in a list.

    The list is empty if that wall is too short.
    """
    if not shared or not opening_fits(shared[0], plan):
        return []
    return [Way(pair, shared[0], "Opening", *clear_span(shared[0], plan), requested)]


def _doorways(
    plan: Partition, pair: Pair, shared: list[Contact], count: int, dice: Random, *, requested: bool
) -> list[Way]:
    """Returns doorways spread over two rooms' shared walls, at random places: `count` of them, or as many as fit."""
    places = [contact for contact in shared for _ in range(door_capacity(contact, plan))]
    chosen = dice.sample(places, min(count, len(places)))
    ways = []
    for contact in shared:
        number = chosen.count(contact)
        start, end = clear_span(contact, plan)
        free = end - start - number * DOOR_WIDTH - (number + 1) * DOOR_CLEARANCE
        shifts = _shifts(number, free, dice)
        for index, shift in enumerate(shifts):
            jamb = start + DOOR_CLEARANCE + index * (DOOR_WIDTH + DOOR_CLEARANCE) + shift
            ways.append(Way(pair, contact, "Doorway", jamb, jamb + DOOR_WIDTH, requested))
    return ways


def _shifts(number: int, free: int, dice: Random) -> list[int]:
    """Chooses how far each doorway is shifted along its wall, given `free` grid units of slack.

    A single doorway is mostly near one end of the wall, which leaves the rest of the wall to furniture.
    """
    if number == 1 and dice.random() < _NEAR_CORNER_SHARE:
        shift = dice.randint(0, min(free, _NEAR_CORNER))
        return [shift if dice.random() < 0.5 else free - shift]
    return sorted(dice.randint(0, free) for _ in range(number))


AREA_TOLERANCE = 0.05
"""Share of the preferred floor area by which a room's area may differ and still satisfy the preference."""


def inside_walls(plan: Partition) -> Partition:
    """Returns the floor plan with room corners moved to the faces of the walls.

    Where a wall is taken away for an opening, the strip below it belongs to no room.

    Args:
        plan: A plan that fills its rectangle.
    """
    rooms = tuple(_inset(plan, corners) for corners in plan.rooms)
    return plan._replace(rooms=rooms, arms=tuple(map(_arm, rooms)))


def floor_areas(plan: Partition) -> list[float]:
    """Returns the floor area of each room of a plan that fills its rectangle, in square grid units."""
    return [area(corners) for corners in inside_walls(plan).rooms]


def floor_ratios(plan: Partition) -> list[float]:
    """Returns length over width of each room's floor, in a plan that fills its rectangle."""
    inside = inside_walls(plan)
    return [slenderness(inside, room) for room in range(len(inside.rooms))]


def _inset(plan: Partition, corners: Corners) -> Corners:
    """Returns a room's corners moved inwards by half the thickness of the walls there.

    The room is to the left of every edge.
    """
    moved: list[tuple[int, int]] = []
    for index, (x, y) in enumerate(corners):
        before, after = corners[index - 1], corners[(index + 1) % len(corners)]
        across, along = (before, after) if before[0] == x else (after, before)
        # One edge at the corner is upright, from or to `across`; the other is level.
        up = (y > across[1]) == (across is before)
        right = (x > along[0]) == (along is before)
        inward = -1 if up else 1, 1 if right else -1
        moved.append((x + inward[0] * _half_wall(x, plan.width), y + inward[1] * _half_wall(y, plan.height)))
    return tuple(moved)


def _half_wall(at: int, limit: int) -> int:
    return (EXTERIOR_WALL if at in (0, limit) else INTERIOR_WALL) // 2


def _arm(corners: Corners) -> int:
    """Returns the narrowest width of a rectangular or L-shaped room, in grid units."""
    box = extent(corners)
    if len(corners) == 4:
        return min(box.x1 - box.x0, box.y1 - box.y0)
    x = next((x for x, _ in corners if box.x0 < x < box.x1), box.x0)
    y = next((y for _, y in corners if box.y0 < y < box.y1), box.y0)
    # The corner of the box that is none of the room's lies in the pocket.
    west = not {(box.x0, box.y0), (box.x0, box.y1)} <= {*corners}
    south = not {(box.x0, box.y0), (box.x1, box.y0)} <= {*corners}
    return min(box.x1 - x if west else x - box.x0, box.y1 - y if south else y - box.y0)
