"""A world template's preferences for its floor plan, as numbers, and which room types suit as neighbours."""

from collections import Counter
from collections.abc import Iterator, Sequence
from math import log
from typing import NamedTuple, Protocol, TypeVar

from ....schemas.templates.body import RoomTarget, TemplateAspectRatio, TemplateFloorplan
from ....schemas.worlds.world import PassageKind, PreferenceOutcome, Room, RoomType
from .partition import UNITS_PER_M, Contact, Partition, contacts, extent

INTERIOR_WALL = 2
EXTERIOR_WALL = 4
"""Thickness of exterior walls, in grid units. It is even, as that of inner walls, so that faces are on grid lines."""

DOOR_WIDTH = 18
DOOR_CLEARANCE = 6
"""Smallest distance between a doorway's side and the next corner or doorway, in grid units."""

OPENING_WIDTH = 20
"""Smallest clear width of an opening between two rooms (a doorway without door), in grid units."""

MIN_SIDES_M: dict[RoomType, float] = {
    "Bathroom": 1.8,
    "Bedroom": 2.2,
    "Closet": 1.2,
    "Dining": 2.2,
    "Hallway": 1.3,
    "Kitchen": 2.0,
    "Living": 2.2,
    "Office": 2.0,
    "Storage": 1.2,
}
"""Smallest width of a room by type, in metres, between the centre lines of its walls."""

HABITABLE: frozenset[RoomType] = frozenset({"Bedroom", "Dining", "Kitchen", "Living", "Office"})
"""Room types that should have a window."""

PUBLIC: frozenset[RoomType] = frozenset({"Dining", "Hallway", "Kitchen", "Living"})
"""Room types through which other rooms may be reached."""

RATIO_TOLERANCE = log(1.15)
"""Deviation of an aspect ratio's logarithm up to which the preference counts as satisfied, as in the report."""

# What faults cost, in all searches. Costs of a plan are summed; a deviation of a ratio is the absolute logarithm
# of actual over desired, and costs itself. A fault that makes a plan useless (9.0) outweighs everything that a
# plan may miss otherwise.
MISSED_PREFERENCE = 0.6
"""Cost that is added for a deviation above the report's tolerance, as the preference is then missed."""

OUTLIER = 1.5
"""Factor of the square of a room's deviation in the cost.

So one bad room costs more than two that are slightly bad.
"""

FOOTPRINT_WEIGHTS = (0.0, 0.7, 1.3, 2.0)
"""Weight of the footprint's ratio in the cost by number of rooms (3 and more are equal).

With one room, the room's own preference wins.
"""

TOO_NARROW = 9.0
NOT_CONNECTED = 9.0
MISSED_CONNECTION = 2.5
STRANGE_NEIGHBOURS = 0.8
"""Largest cost of a room whose neighbours do not suit its type."""

LIT_WALL = 44
"""Length of outer wall that a room needs for a window, in grid units."""

THROUGHNESS: dict[RoomType, float] = {
    "Bathroom": 0.1,
    "Bedroom": 0.4,
    "Closet": 0.1,
    "Dining": 0.8,
    "Hallway": 1.0,
    "Kitchen": 0.7,
    "Living": 0.95,
    "Office": 0.4,
    "Storage": 0.1,
}
"""Acceptability of passing through a room of a type on the way to another room, 0 to 1."""

_AFFINITY: dict[RoomType, tuple[float, ...]] = {
    "Bathroom": (0.05,),
    "Bedroom": (0.8, 0.15),
    "Closet": (0.1, 0.9, 0.05),
    "Dining": (0.15, 0.3, 0.25, 0.4),
    "Hallway": (1.0, 1.0, 0.8, 0.7, 0.9),
    "Kitchen": (0.1, 0.1, 0.5, 1.0, 0.75, 0.3),
    "Living": (0.45, 0.7, 0.35, 0.95, 0.95, 0.7, 0.6),
    "Office": (0.1, 0.35, 0.3, 0.4, 1.0, 0.15, 0.8, 0.3),
    "Storage": (0.2, 0.15, 0.1, 0.3, 0.9, 0.9, 0.35, 0.3, 0.05),
}
"""Suitability of a door between two room types, 0 to 1, by type and the types listed above it and itself, in order."""


def affinity(one: RoomType, other: RoomType) -> float:
    """Returns how sensible a door between two room types is, from 0 to 1."""
    low, high = sorted((one, other))
    return _AFFINITY[high][[*_AFFINITY].index(low)]


class Brief(NamedTuple):
    """A world template's preferences for the floor plan as numbers, with rooms in the template's order."""

    names: tuple[str, ...]
    types: tuple[RoomType, ...]
    areas_m2: tuple[float, ...]
    ratios: tuple[float, ...]
    """Preferred length over width of each room, at least 1, as rooms may be turned."""
    footprint_ratio: float
    """Preferred extent of the footprint along x over its extent along y."""
    requests: tuple[tuple[tuple[int, int], PassageKind, int], ...]
    """Requested connections: pair of rooms (lower number first), doorway or opening, and how many."""
    diverse: bool = True
    """Whether plans of a template must differ, even if a plan then misses a ratio that the best plan has."""

    @property
    def min_sides(self) -> list[int]:
        """Minimum width of each room, in grid units."""
        return [round(MIN_SIDES_M[kind] * UNITS_PER_M) for kind in self.types]


def brief(preferences: TemplateFloorplan, *, diverse: bool = True) -> Brief:
    """Converts a template's floor plan preferences to numbers.

    Args:
        preferences: The floor plan that is wished for.
        diverse: Whether plans are to differ.
    """
    numbers = {room.Name: number for number, room in enumerate(preferences.Rooms)}
    counts: Counter[tuple[int, int]] = Counter()
    kinds: dict[tuple[int, int], PassageKind] = {}
    for connection in preferences.DesiredConnections:
        low, high = sorted(numbers[name] for name in connection.Location)
        counts[low, high] += 1
        kinds[low, high] = connection.ConnectionType
    return Brief(
        names=tuple(numbers),
        types=tuple(room.Type for room in preferences.Rooms),
        areas_m2=tuple(room.DesiredShape.Area for room in preferences.Rooms),
        ratios=tuple(length_over_width(room.DesiredShape.AspectRatio) for room in preferences.Rooms),
        footprint_ratio=preferences.Footprint.DesiredAspectRatio.x / preferences.Footprint.DesiredAspectRatio.y,
        requests=tuple((pair, kinds[pair], count) for pair, count in counts.items()),
        diverse=diverse,
    )


def length_over_width(ratio: TemplateAspectRatio) -> float:
    """Converts an aspect ratio to longer side over shorter side, which is at least 1."""
    return max(ratio.x, ratio.y) / min(ratio.x, ratio.y)


def deviation(actual: float, desired: float) -> float:
    """Measures how far an aspect ratio is from another: 0 if equal, the same for double and half."""
    return abs(log(actual / desired))


def clear_span(contact: Contact, plan: Partition) -> tuple[int, int]:
    """Returns the part of a shared wall that is free for doors, in grid units.

    Start and end are coordinates along the wall; the end may lie before the start if there is no space.
    """
    limit = plan.width if contact.horizontal else plan.height
    ends = []
    for at, beyond, inward in ((contact.start, contact.start - 0.5, 1), (contact.end, contact.end + 0.5, -1)):
        spots = [
            (beyond, contact.at + side) if contact.horizontal else (contact.at + side, beyond) for side in (-0.5, 0.5)
        ]
        # An outer wall stands at the end, on one side of it at least.
        is_outer = at in (0, limit) or (not plan.is_full and not all(_has_room(plan, *spot) for spot in spots))
        ends.append(at + inward * (EXTERIOR_WALL if is_outer else INTERIOR_WALL) // 2)
    return ends[0], ends[1]


def _has_room(plan: Partition, x: float, y: float) -> bool:
    """Whether a point is inside a room of a plan that has rectangular rooms."""
    return any(box.x0 < x < box.x1 and box.y0 < y < box.y1 for box in map(extent, plan.rooms))


def doors_in(span: int) -> int:
    """Returns how many doorways fit into a length of wall; 0 or less if none does."""
    return (span - DOOR_CLEARANCE) // (DOOR_WIDTH + DOOR_CLEARANCE)


def door_capacity(contact: Contact, plan: Partition) -> int:
    """Returns how many doorways fit into a shared wall; 0 if none does."""
    start, end = clear_span(contact, plan)
    return max(0, doors_in(end - start))


def opening_fits(contact: Contact, plan: Partition) -> bool:
    """Whether a shared wall is long enough to be replaced by an opening."""
    start, end = clear_span(contact, plan)
    return end - start >= OPENING_WIDTH


def shared_spans(plan: Partition) -> Iterator[tuple[tuple[int, int], int]]:
    """Yields each shared wall: its two rooms, and its free length in grid units.

    The same as `clear_span` of all contacts. The search spends much of its time here, and nearly
    all plans have rectangular rooms only, which are compared directly.
    """
    if any(len(corners) > 4 for corners in plan.rooms):
        for contact in contacts(plan.rooms):
            start, end = clear_span(contact, plan)
            yield (min(contact.low, contact.high), max(contact.low, contact.high)), end - start
        return
    boxes = [extent(corners) for corners in plan.rooms]
    for other, (x0, y0, x1, y1) in enumerate(boxes):
        for one in range(other):
            u0, v0, u1, v1 = boxes[one]
            if x0 == u1 or x1 == u0:
                start, end, limit = max(y0, v0), min(y1, v1), plan.height
            elif y0 == v1 or y1 == v0:
                start, end, limit = max(x0, u0), min(x1, u1), plan.width
            else:
                continue
            if start < end:
                outer = (start == 0) + (end == limit)
                yield (one, other), end - start - INTERIOR_WALL - outer * (EXTERIOR_WALL - INTERIOR_WALL) // 2


class TargetedSet(Protocol):
    """A material set or furniture arrangement of a template, which applies to certain rooms."""

    @property
    def Name(self) -> str:  # noqa: N802 (the service's name)
        """Name of a material or furniture set in the template."""
        ...

    @property
    def TargetSet(self) -> RoomTarget:  # noqa: N802 (the service's name)
        """Rooms that a material or furniture set applies to."""
        ...


Set = TypeVar("Set", bound=TargetedSet)


def _for_room(target: RoomTarget, room: Room) -> int | None:
    """Returns how specifically a target names a room: 0 by name, 1 by type, 2 as any room; `None` if it does not."""
    if isinstance(target, str):
        return 2
    if room.name in (target.RoomNames or []):
        return 0
    return 1 if room.type in (target.RoomTypes or []) else None


def targeted(one_set: TargetedSet, rooms: Sequence[Room]) -> list[Room]:
    """Returns the rooms that a material or furniture set asks for, even if other sets have precedence."""
    return [room for room in rooms if _for_room(one_set.TargetSet, room) is not None]


def choose_sets(sets: Sequence[Set], rooms: Sequence[Room]) -> dict[str, int]:
    """Chooses which material or furniture set of the template each room gets, as index by room name.

    A set that names a room wins over one that names its type, and that wins over one for all rooms; among equals the
    first in the template wins.
    """
    chosen: dict[str, int] = {}
    for rank in range(3):
        for index, one_set in enumerate(sets):
            for room in rooms:
                if _for_room(one_set.TargetSet, room) == rank:
                    chosen.setdefault(room.name, index)
    return chosen


def why_unused(
    one_set: TargetedSet, sets: Sequence[TargetedSet], chosen: dict[str, int], rooms: Sequence[Room]
) -> tuple[str, PreferenceOutcome]:
    """Explains why a material or furniture set applies to no room, with the outcome of its preferences.

    The outcome is `missed` if the plan has none of the set's rooms, and `contradictory` if other sets have them all.
    """
    wanted = targeted(one_set, rooms)
    if not wanted:
        target = one_set.TargetSet
        preferred = [target] if isinstance(target, str) else target.RoomNames or target.RoomTypes or []
        return f"the plan has no room {', '.join(preferred)}", "missed"
    others = sorted({sets[chosen[room.name]].Name for room in wanted})
    return f"its rooms follow {', '.join(others)}", "contradictory"
