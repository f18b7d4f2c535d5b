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
    preference = Preference(
        path=f"{FLOORPLAN_PATH}.Footprint.DesiredAspectRatio",
        wish=f"footprint with aspect ratio {_colon(preferences.Footprint.DesiredAspectRatio)}",
        outcome="satisfied",
    )
    if deviation(ratio, brief.footprint_ratio) <= RATIO_TOLERANCE:
        return preference
    if len(preferences.Rooms) == 1:
        # The one room is the footprint; its own preference wins.
        room_ratio = _colon(preferences.Rooms[0].DesiredShape.AspectRatio)
        reason = f"the only room fills the footprint and is wished to be {room_ratio}"
        return preference.model_copy(update={"outcome": "contradictory", "reason": reason})
    rivals = competing_preferences(brief, plan, FOOTPRINT)
    reason = f"it became {ratio:.2f} instead of {brief.footprint_ratio:.2f}; {rivals}"
    return preference.model_copy(update={"outcome": "missed", "reason": reason})


def _ceiling(preferences: TemplateFloorplan) -> Preference:
    return Preference(
        path=f"{FLOORPLAN_PATH}.Ceiling.Height",
        wish=f"ceiling {preferences.Ceiling.Height:g} m above the floor",
        outcome="satisfied",
    )


def _area(preferences: TemplateFloorplan, plan: Partition, number: int) -> Preference:
    room = preferences.Rooms[number]
    preference = Preference(
        path=f"{FLOORPLAN_PATH}.Rooms[{number}].DesiredShape.Area",
        wish=f"{room.Name} of {room.DesiredShape.Area:g} m2",
        outcome="satisfied",
    )
    actual = floor_areas(plan)[number] * UNIT_M**2
    if abs(actual / room.DesiredShape.Area - 1) <= AREA_TOLERANCE:
        return preference
    reason = f"its floor became {actual:.1f} m2 instead of {room.DesiredShape.Area:g} m2"
    return preference.model_copy(update={"outcome": "missed", "reason": reason})


def _ratio(preferences: TemplateFloorplan, brief: Brief, plan: Partition, number: int) -> Preference:
    room = preferences.Rooms[number]
    desired = length_over_width(room.DesiredShape.AspectRatio)
    preference = Preference(
        path=f"{FLOORPLAN_PATH}.Rooms[{number}].DesiredShape.AspectRatio",
        wish=f"{room.Name} with aspect ratio {_colon(room.DesiredShape.AspectRatio)}",
        outcome="satisfied",
    )
    actual = floor_ratios(plan)[number]
    if deviation(actual, desired) <= RATIO_TOLERANCE:
        return preference
    least, width = MIN_SIDES_M[room.Type], (room.DesiredShape.Area / desired) ** 0.5
    if width + EXTERIOR_WALL * UNIT_M < least:
        cause = (
            f"at {room.DesiredShape.Area:g} m2 its floor would be {width:.2f} m wide, and between the middles of its "
            f"walls a room of this type is at least {least:g} m"
        )
        return preference.model_copy(update={"outcome": "contradictory", "reason": cause})
    reason = f"it became {actual:.2f} instead of {desired:.2f}; {competing_preferences(brief, plan, ratio_of(number))}"
    return preference.model_copy(update={"outcome": "missed", "reason": reason})


def _connection(
    connection: DesiredConnection, index: int, pair: Pair, brief: Brief, plan: Partition, left: Counter[Pair]
) -> Preference:
    one, other = connection.Location
    preference = Preference(
        path=f"{FLOORPLAN_PATH}.DesiredConnections[{index}]",
        wish=f"{connection.ConnectionType} between {one} and {other}",
        outcome="satisfied",
    )
    if left[pair] > 0:
        return preference
    walls = shared_walls(plan).get(pair, [])
    needed = (
        OPENING_WIDTH if connection.ConnectionType == "Opening" else DOOR_WIDTH + 2 * DOOR_CLEARANCE
    ) + INTERIOR_WALL
    if walls:
        longest = walls[0].end - walls[0].start
        reason = (
            f"they share {longest * UNIT_M:.2f} m of wall, and it takes {needed * UNIT_M:.2f} m"
            if longest < needed + INTERIOR_WALL
            else f"their shared wall of {longest * UNIT_M:.2f} m has no room for another doorway"
        )
        rivals = competing_preferences(brief, plan, way_of(brief, pair))
        return preference.model_copy(update={"outcome": "missed", "reason": f"{reason}; {rivals}"})
    if together := forbidden_together({each for each, _, _ in brief.requests}, pair):
        ways = ", ".join(f"{brief.names[low]} - {brief.names[high]}" for low, high in together)
        reason = (
            f"no plan of rectangular rooms has these {len(together)} ways together, "
            f"while without any one of them the others go together: {ways}"
        )
        return preference.model_copy(update={"outcome": "contradictory", "reason": reason})
    reason = f"the two rooms share no wall in this plan; {competing_preferences(brief, plan, way_of(brief, pair))}"
    return preference.model_copy(update={"outcome": "missed", "reason": reason})


def _colon(ratio: TemplateAspectRatio) -> str:
    return f"{ratio.x:g}:{ratio.y:g}"
