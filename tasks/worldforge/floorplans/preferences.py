"""Outcome of every preference about the floor plan: satisfied, missed or contradictory, with numbers."""

from collections import Counter

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
from .connections import Pair, Way, shared_walls
from .floors import AREA_TOLERANCE, floor_areas, floor_ratios
from .partition import UNIT_M, Partition
from .rivals import FOOTPRINT, competing_preferences, forbidden_together, ratio_of, way_of


def preference_report(
    preferences: TemplateFloorplan, brief: Brief, plan: Partition, ways: list[Way]
) -> list[Preference]:
    """One `Preference` for the footprint, the ceiling, every area, every aspect ratio and every connection."""
    report = [_footprint(preferences, brief, plan), _ceiling(preferences)]
    for number in range(len(preferences.Rooms)):
        report += [_area(preferences, plan, number), _ratio(preferences, brief, plan, number)]
    left = Counter(way.pair for way in ways if way.requested)
    for index, connection in enumerate(preferences.DesiredConnections):
        low, high = sorted(brief.names.index(name) for name in connection.Location)
        report.append(_connection(connection, index, (low, high), brief, plan, left))
        left[low, high] -= 1
    return report


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
    actual, desired = floor_areas(plan)[number] * UNIT_M**2, room.DesiredShape.Area
    near = abs(actual / desired - 1) <= AREA_TOLERANCE
    reason = "" if near else f"its floor became {actual:.1f} m2 instead of {desired:g} m2"
    path = f"{FLOORPLAN_PATH}.Rooms[{number}].DesiredShape.Area"
    return Preference.judged(path, f"{room.Name} of {desired:g} m2", reason)


def _ratio(preferences: TemplateFloorplan, brief: Brief, plan: Partition, number: int) -> Preference:
    room = preferences.Rooms[number]
    actual, desired = floor_ratios(plan)[number], length_over_width(room.DesiredShape.AspectRatio)
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
