"""Floor plans of templates with balconies: the building is divided first, as if there were none, then they are added.

So balconies change nothing in the search for plans, and worlds without balconies stay what they are.
"""

import re
from collections.abc import Iterator, Sequence
from random import Random

import numpy as np

from ....schemas.templates.body import FLOORPLAN_PATH, TemplateFloorplan, TemplateRoom, WorldTemplateBody
from ....schemas.wire.errors import WorldGenerationError
from ....schemas.worlds.world import OUTDOOR_ROOM_TYPE, Floorplan, Preference, Room
from ..doors.doors import hang_doors
from ..floorplans.brief import RATIO_TOLERANCE, deviation, length_over_width
from ..floorplans.connections import AREA_TOLERANCE
from ..floorplans.floorplan import generate_floorplan
from ..floorplans.preferences import is_stated, reported
from .building import with_balcony
from .sites import Site, sites

_DRAWS = 1
"""Key of the random numbers of balconies among those of a floor plan's seed."""

_TRIES = 8
"""Limit of the places that are tried until all doors of the building can be hung."""

_NUMBERED = re.compile(r"(Rooms|DesiredConnections)\[(\d+)\]")


def whole_floorplan(body: WorldTemplateBody, seed: int) -> Floorplan:
    """Generates a floor plan with the balconies that a template asks for; equal arguments give the same plan.

    Args:
        body: The template.
        seed: Seed of the floor plan, as for `generate_floorplan`.

    Raises:
        WorldGenerationError: There is no valid plan, or no outer wall has room for a balcony.
    """
    inside = without_balconies(body)
    plan = generate_floorplan(inside, seed)
    if inside is body:
        return plan
    # As for plans: thousands of small draws would be slow with NumPy's generator.
    state = np.random.SeedSequence(seed, spawn_key=(_DRAWS,)).generate_state(1, np.uint64)
    dice = Random(int(state[0]))  # noqa: S311 (chance, not secrecy)
    for room in body.floorplan.Rooms:
        if room.Type == OUTDOOR_ROOM_TYPE:
            plan = _added(body, plan, room, dice)
    order = {room.Name: number for number, room in enumerate(body.floorplan.Rooms)}
    rooms = sorted(plan.rooms, key=lambda room: order[room.name])
    passages = [
        each.model_copy(update={"rooms": tuple(sorted(each.rooms, key=lambda name: order[name]))})
        for each in plan.passages
    ]
    wishes = _report(body.floorplan, plan)
    return plan.model_copy(update={"rooms": rooms, "passages": passages, "wishes": wishes})


def without_balconies(body: WorldTemplateBody) -> WorldTemplateBody:
    """Returns a template without its balconies and their connections; the template itself if it has none."""
    plan = body.floorplan
    outside = _balconies(plan)
    if not outside:
        return body
    less = {
        "Rooms": [room for room in plan.Rooms if room.Name not in outside],
        "DesiredConnections": [each for each in plan.DesiredConnections if not outside & each.pair],
    }
    building = body.Buildings[0]
    floor = building.Floors[0].model_copy(update={"Floorplan": plan.model_copy(update=less)})
    return body.model_copy(update={"Buildings": [building.model_copy(update={"Floors": [floor]})]})


def _balconies(plan: TemplateFloorplan) -> frozenset[str]:
    return frozenset(room.Name for room in plan.Rooms if room.Type == OUTDOOR_ROOM_TYPE)


def _host_wished(plan: TemplateFloorplan, balcony: str) -> str | None:
    """Returns the room from which a template asks for a balcony's door; `None` if it leaves that open."""
    pairs = (each.pair for each in plan.DesiredConnections if balcony in each.pair)
    return next((name for pair in pairs for name in pair if name != balcony), None)


def _added(body: WorldTemplateBody, plan: Floorplan, room: TemplateRoom, dice: Random) -> Floorplan:
    """Returns the plan with one more balcony, at the best place where no door of the building is lost.

    Raises WorldGenerationError if no outer wall has room for it.
    """
    wished = _host_wished(body.floorplan, room.Name)
    shape = room.DesiredShape
    ratio = length_over_width(shape.AspectRatio)
    inside = [each.name for each in plan.rooms if not each.is_outdoor]
    found: list[Site] = []
    for hosts in ([wished] if wished else [], inside):
        found = found or sites(plan, shape.Area, ratio, hosts, dice)
    best: tuple[int, Floorplan] | None = None
    for site in found[:_TRIES]:
        made = with_balcony(plan, site, room, requested=site.host == wished)
        doorless = 0
        if body.Version == "2":
            made, reasons = hang_doors(made)
            doorless = len(reasons)
        if best is None or doorless < best[0]:
            best = doorless, made
        if not doorless:
            break
    if best is None:
        raise WorldGenerationError(f"no outer wall of the plan has room for the balcony {room.Name} and its door")
    return best[1]


def _report(wished: TemplateFloorplan, plan: Floorplan) -> list[Preference]:
    """Returns all preferences about a floor plan, in the template's order, with the paths that they have there.

    Those of the plan are taken over; those about balconies and their connections are judged here.
    """
    outside = _balconies(wished)
    numbers = {
        "Rooms": [number for number, room in enumerate(wished.Rooms) if room.Name not in outside],
        "DesiredConnections": [
            number for number, each in enumerate(wished.DesiredConnections) if not outside & each.pair
        ],
    }

    def at_home(preference: Preference) -> Preference:
        path = _NUMBERED.sub(lambda match: f"{match[1]}[{numbers[match[1]][int(match[2])]}]", preference.path)
        return preference.model_copy(update={"path": path})

    rooms = {room.name: room for room in plan.rooms}
    told = [at_home(each) for each in plan.wishes]
    told += [
        each
        for number, room in enumerate(wished.Rooms)
        if room.Name in outside
        for each in _shape(number, room, rooms[room.Name])
    ]
    told += _ways(wished, plan, outside)
    return sorted(told, key=_place)


def _place(preference: Preference) -> tuple[int, int]:
    """Returns the sort key of a preference in the report: 0 building, 1 rooms, 2 connections, then the number there."""
    match = _NUMBERED.search(preference.path)
    if match is None:
        return 0, 0
    return (1 if match[1] == "Rooms" else 2), int(match[2])


def _shape(number: int, wished: TemplateRoom, room: Room) -> Iterator[Preference]:
    """Yields the outcome of a balcony's area and aspect ratio, but no default that is missed."""
    shape, path = wished.DesiredShape, f"{FLOORPLAN_PATH}.Rooms[{number}].DesiredShape"
    near = abs(room.floor_m2 / shape.Area - 1) <= AREA_TOLERANCE
    reason = "" if near else f"its floor became {room.floor_m2:.1f} m2 instead of {shape.Area:g} m2"
    area = Preference.judged(f"{path}.Area", f"{room.name} of {shape.Area:g} m2", reason)
    yield from reported(area, stated="DesiredShape" in wished.model_fields_set)
    actual, desired = room.aspect_ratio or 1.0, room.desired_aspect_ratio
    ratio = f"{shape.AspectRatio.x:g}:{shape.AspectRatio.y:g}"
    why = f"it became {actual:.2f} instead of {desired:.2f}; a balcony is 1.2 to 2.5 m deep and as long as its wall"
    is_near = deviation(actual, desired) <= RATIO_TOLERANCE
    outcome = Preference.judged(f"{path}.AspectRatio", f"{room.name} with aspect ratio {ratio}", "" if is_near else why)
    yield from reported(outcome, stated=is_stated(shape.AspectRatio))


def _ways(wished: TemplateFloorplan, plan: Floorplan, outside: frozenset[str]) -> Sequence[Preference]:
    """Returns the outcome of the connections of balconies."""
    pairs = {frozenset(way.rooms) for way in plan.passages}
    told: list[Preference] = []
    for number, each in enumerate(wished.DesiredConnections):
        if outside & each.pair:
            one, other = each.Location
            wish = f"{each.ConnectionType} between {one} and {other}"
            reason = "" if each.pair in pairs else f"no outer wall of {next(iter(each.pair - outside))} has room for it"
            told.append(Preference.judged(f"{FLOORPLAN_PATH}.DesiredConnections[{number}]", wish, reason))
    return told
