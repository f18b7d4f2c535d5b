"""Report of the floor plan preferences of a template: satisfied, missed or contradictory, with numbers."""

from collections import Counter
from collections.abc import Collection, Iterator, Sequence
from math import log

import numpy as np

from ....schemas.templates.body import FLOORPLAN_PATH, DesiredConnection, TemplateAspectRatio, TemplateFloorplan
from ....schemas.worlds.world import Preference
from .brief import (
    DOOR_CLEARANCE,
    DOOR_WIDTH,
    EXTERIOR_WALL,
    INTERIOR_WALL,
    MIN_SIDES_M,
    OPENING_WIDTH,
    RATIO_TOLERANCE,
    Brief,
    deviation,
    length_over_width,
)
from .connections import AREA_TOLERANCE, Pair, Way, shared_walls
from .partition import UNIT_M, UNITS_PER_M, Partition
from .partition_choice import shortlists
from .walls import floor_shapes

_FORBIDDEN = (
    "ab ac ad bc bd cd",
    "ab ac ad ae bc bd be",
    "ad ae af bd be bf cd ce cf",
    "ac ad ae af bc bd be bf ce cf de df",
)
"""Smallest sets of connections that no division of a rectangle into rectangles has.

They are: four rooms that all touch each other; two that touch, with three more that touch both; three that each touch
three others; and six that each touch all but one.
"""


def forbidden_together(requests: Collection[Pair], pair: Pair) -> list[Pair]:
    """Returns the smallest set of requested connections that no plan of rectangular rooms can have together.

    Args:
        requests: Pairs of rooms, lower number first.
        pair: The one that a plan misses.

    Returns:
        The connections, the given one among them; empty if some plan has all.
    """
    rooms = sorted({room for request in requests for room in request})
    for walls in _FORBIDDEN:
        for place in _placed(walls.split(), rooms, requests, {}):
            ways = sorted(_ordered(place[one], place[other]) for one, other in walls.split())
            if pair in ways:
                return ways
    return []


def _placed(
    walls: Sequence[str], rooms: Sequence[int], requests: Collection[Pair], before: dict[str, int]
) -> Iterator[dict[str, int]]:
    """Yields assignments of rooms to the letters of a forbidden pattern such that each of its walls is requested.

    Rooms of low numbers come first.

    Args:
        walls: Pairs of letters.
        rooms: Numbers of rooms.
        requests: Pairs of rooms, lower number first.
        before: Rooms that are assigned to the first letters already.
    """
    letters = sorted({*"".join(walls)})
    if len(before) == len(letters):
        yield before
        return
    letter = letters[len(before)]
    for room in rooms:
        place = {**before, letter: room}
        if room not in before.values() and all(
            _ordered(place[one], place[other]) in requests
            for one, other in walls
            if letter in (one, other) and one in place and other in place
        ):
            yield from _placed(walls, rooms, requests, place)


def _ordered(one: int, other: int) -> Pair:
    return (one, other) if one < other else (other, one)


def competing_preferences(brief: Brief, plan: Partition, missed: int) -> str:
    """Explains, as the end of a sentence, which other preferences would have to be given up to satisfy a missed one.

    The text says so if no plan satisfies it, or if another plan satisfies all.

    Args:
        brief: The preferences, of two rooms or more.
        plan: The plan that misses one.
        missed: The number of that preference, in the order of the search.
    """
    lists = shortlists(brief)
    if not lists:
        return "no plan was found that grants it"
    misses = np.concatenate([plans.misses for plans in lists], axis=1)
    granting = np.flatnonzero(~misses[missed])
    if not len(granting):
        tried = sum(plans.tried for plans in lists)
        compared = f"none of the {misses.shape[1]} best plans of {tried} tried grants it"
        return f"{compared} together with the areas and the least widths"
    rivals = misses[:, granting] & ~_misses(brief, plan, len(misses))[:, None]
    costs = np.concatenate([plans.cost for plans in lists])[granting]
    fewest = np.lexsort((costs, rivals.sum(axis=0)))[0]
    names = [name for name, rival in zip(_names(brief), rivals[:, fewest].tolist(), strict=True) if rival]
    if names:
        return f"the best plan that grants it misses {' and '.join(names)}"
    if brief.diverse:
        return "another plan grants it; this one was taken so that worlds differ (`diversity: 0` gives the best plan)"
    return "a plan that grants it was found, and its rooms lie together worse than these"


def ratio_of(room: int) -> int:
    """Returns the index of a room's aspect ratio among the template's preferences."""
    return 1 + room


def way_of(brief: Brief, pair: Pair) -> int:
    """Returns the index of a requested connection among the template's preferences."""
    return 1 + 2 * len(brief.ratios) + [each for each, _, _ in brief.requests].index(pair)


FOOTPRINT = 0
"""Number of the preferred footprint ratio among all preferences."""


def _misses(brief: Brief, plan: Partition, preferences: int) -> np.ndarray:
    """Returns a mask of the shape preferences that a plan misses; requested connections count as satisfied.

    The order is: footprint, aspect ratios of all rooms, areas of all rooms, connections.
    """
    missed = np.zeros(preferences, bool)
    missed[0] = abs(log(plan.width / plan.height / brief.footprint_ratio)) > RATIO_TOLERANCE
    rooms = len(brief.ratios)
    shapes = zip(brief.ratios, brief.areas_m2, floor_shapes(plan), strict=True)
    for number, (ratio, square_metres, (floor, actual)) in enumerate(shapes):
        missed[1 + number] = abs(log(actual / ratio)) > RATIO_TOLERANCE
        missed[1 + rooms + number] = abs(floor / (square_metres * UNITS_PER_M**2) - 1) > AREA_TOLERANCE
    return missed


def _names(brief: Brief) -> list[str]:
    """Returns the descriptions of all preferences of the floor plan, in the order in which they are numbered."""
    ratios = [f"the aspect ratio {ratio:.2f} of {name}" for name, ratio in zip(brief.names, brief.ratios, strict=True)]
    areas = [f"the area of {name}" for name in brief.names]
    pairs = [f"the way between {brief.names[low]} and {brief.names[high]}" for (low, high), _, _ in brief.requests]
    return [f"the footprint's {brief.footprint_ratio:.2f}", *ratios, *areas, *pairs]


def preference_report(
    preferences: TemplateFloorplan, brief: Brief, plan: Partition, ways: list[Way]
) -> list[Preference]:
    """Reports for every floor plan preference of the template whether the world satisfies it.

    What the template leaves out has a default, at which the search aims as well: it is no wish, so that none is missed.
    """
    ratio = preferences.Footprint.DesiredAspectRatio
    report = [*reported(_footprint(preferences, brief, plan), stated=is_stated(ratio)), _ceiling(preferences)]
    for number, room in enumerate(preferences.Rooms):
        report += reported(_area(preferences, plan, number), stated="DesiredShape" in room.model_fields_set)
        report += reported(_ratio(preferences, brief, plan, number), stated=is_stated(room.DesiredShape.AspectRatio))
    left = Counter(way.pair for way in ways if way.requested)
    for index, connection in enumerate(preferences.DesiredConnections):
        low, high = sorted(brief.names.index(name) for name in connection.Location)
        report.append(_connection(connection, index, (low, high), brief, plan, left))
        left[low, high] -= 1
    return report


def reported(preference: Preference, *, stated: bool) -> list[Preference]:
    """Returns what the report says of a preference: nothing where a world misses a default."""
    return [preference] if stated or preference.outcome == "satisfied" else []


def is_stated(ratio: TemplateAspectRatio) -> bool:
    """Whether a template states an aspect ratio: `{}`, or none at all, leaves it to the default."""
    return bool(ratio.model_fields_set)


def _footprint(preferences: TemplateFloorplan, brief: Brief, plan: Partition) -> Preference:
    ratio = plan.width / plan.height
    path = f"{FLOORPLAN_PATH}.Footprint.DesiredAspectRatio"
    wish = f"footprint with aspect ratio {_colon(preferences.Footprint.DesiredAspectRatio)}"
    if deviation(ratio, brief.footprint_ratio) <= RATIO_TOLERANCE:
        return Preference.judged(path, wish)
    if len(preferences.Rooms) == 1:
        # The one room is the footprint; its own preference wins.
        room_ratio = _colon(preferences.Rooms[0].DesiredShape.AspectRatio)
        reason = f"the only room fills the footprint and is wished to be {room_ratio}"
        return Preference.judged(path, wish, reason, "contradictory")
    rivals = competing_preferences(brief, plan, FOOTPRINT)
    return Preference.judged(path, wish, f"it became {ratio:.2f} instead of {brief.footprint_ratio:.2f}; {rivals}")


def _ceiling(preferences: TemplateFloorplan) -> Preference:
    wish = f"ceiling {preferences.Ceiling.Height:g} m above the floor"
    return Preference.judged(f"{FLOORPLAN_PATH}.Ceiling.Height", wish)


def _area(preferences: TemplateFloorplan, plan: Partition, number: int) -> Preference:
    room = preferences.Rooms[number]
    actual, desired = floor_shapes(plan)[number].area * UNIT_M**2, room.DesiredShape.Area
    near = abs(actual / desired - 1) <= AREA_TOLERANCE
    reason = "" if near else f"its floor became {actual:.1f} m2 instead of {desired:g} m2"
    path = f"{FLOORPLAN_PATH}.Rooms[{number}].DesiredShape.Area"
    return Preference.judged(path, f"{room.Name} of {desired:g} m2", reason)


def _ratio(preferences: TemplateFloorplan, brief: Brief, plan: Partition, number: int) -> Preference:
    room = preferences.Rooms[number]
    actual, desired = floor_shapes(plan)[number].ratio, length_over_width(room.DesiredShape.AspectRatio)
    path = f"{FLOORPLAN_PATH}.Rooms[{number}].DesiredShape.AspectRatio"
    wish = f"{room.Name} with aspect ratio {_colon(room.DesiredShape.AspectRatio)}"
    if deviation(actual, desired) <= RATIO_TOLERANCE:
        return Preference.judged(path, wish)
    least, width = MIN_SIDES_M[room.Type], (room.DesiredShape.Area / desired) ** 0.5
    if width + EXTERIOR_WALL * UNIT_M < least:
        cause = (
            f"at {room.DesiredShape.Area:g} m2 its floor would be {width:.2f} m wide, and between the middles of its "
            f"walls a room of this type is at least {least:g} m"
        )
        return Preference.judged(path, wish, cause, "contradictory")
    rivals = competing_preferences(brief, plan, ratio_of(number))
    return Preference.judged(path, wish, f"it became {actual:.2f} instead of {desired:.2f}; {rivals}")


def _connection(
    connection: DesiredConnection, index: int, pair: Pair, brief: Brief, plan: Partition, left: Counter[Pair]
) -> Preference:
    one, other = connection.Location
    path = f"{FLOORPLAN_PATH}.DesiredConnections[{index}]"
    wish = f"{connection.ConnectionType} between {one} and {other}"
    if left[pair] > 0:
        return Preference.judged(path, wish)
    walls = shared_walls(plan).get(pair, [])
    if not walls and (together := forbidden_together({each for each, _, _ in brief.requests}, pair)):
        ways = ", ".join(f"{brief.names[low]} - {brief.names[high]}" for low, high in together)
        reason = (
            f"no plan of rectangular rooms has these {len(together)} ways together, "
            f"while without any one of them the others go together: {ways}"
        )
        return Preference.judged(path, wish, reason, "contradictory")
    reason = "the two rooms share no wall in this plan"
    if walls:
        longest = walls[0].end - walls[0].start
        least = OPENING_WIDTH if connection.ConnectionType == "Opening" else DOOR_WIDTH + 2 * DOOR_CLEARANCE
        needed = least + INTERIOR_WALL
        reason = (
            f"they share {longest * UNIT_M:.2f} m of wall, and it takes {needed * UNIT_M:.2f} m"
            if longest < needed + INTERIOR_WALL
            else f"their shared wall of {longest * UNIT_M:.2f} m has no room for another doorway"
        )
    return Preference.judged(path, wish, f"{reason}; {competing_preferences(brief, plan, way_of(brief, pair))}")


def _colon(ratio: TemplateAspectRatio) -> str:
    return f"{ratio.x:g}:{ratio.y:g}"
