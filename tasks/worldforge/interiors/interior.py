"""Furnishes a floor plan: materials, furniture, loose objects, and the outcome of the preferences."""

from collections import Counter
from collections.abc import Callable, Sequence
from functools import partial
from math import ceil
from random import Random

import numpy as np

from ....schemas.templates.body import INTERIOR_PATH, FurnitureArrangement, WorldTemplateBody
from ....schemas.worlds.world import Floorplan, Furniture, Preference, Room
from ..floorplans.brief import choose_sets, why_unused
from ..furniture.usual_furniture import (
    BALCONY_SET,
    INDISPENSABLE,
    KITCHEN_RUN,
    SPARE,
    Density,
    dining_room,
    usual_types,
)
from ..materials.materials import choose_surfaces
from .kitchen_run import line_up
from .loose_objects import MOST_LOOSE, scatter
from .room_furnishing import RoomFurnishing
from .sitting_groups import GROUP, arrange_balcony, arrange_groups, arrange_seating, is_watched
from .small_rooms import furnish_small, put_back, small_room_preferences, small_rooms

_PATH = f"{INTERIOR_PATH}.Furniture.FurnitureArrangements"


def furnish(
    body: WorldTemplateBody, floorplan: Floorplan, rng: np.random.Generator
) -> tuple[list[Furniture], list[Preference], list[Room]]:
    """Places furniture and loose objects in a floor plan; equal arguments and random state give the same result.

    Every piece leaves the ways through its room open for a robot and the 1 m cylinder at the origin free.

    Args:
        body: The template.
        floorplan: The plan, which is left as it is.
        rng: The source of chance.

    Returns:
        Furniture and loose objects; the outcome of each preference; the rooms with materials and goals.
    """
    rooms, preferences = choose_surfaces(body, floorplan.rooms, rng)
    arrangements = body.interior.Furniture.FurnitureArrangements
    chosen = choose_sets(arrangements, rooms)
    names: Counter[str] = Counter()
    # Scalar after scalar, Python's own generator is several times faster.
    dice = Random(int(rng.integers(2**63)))  # noqa: S311 (chance, not secrecy)

    def new_id(kind: str) -> str:
        names[kind] += 1
        return f"{kind}_{names[kind]}"

    furniture: list[Furniture] = []
    done: dict[str, RoomFurnishing] = {}
    lying: Counter[str] = Counter()
    loose, dines, small = 0, dining_room(rooms), small_rooms(body)
    for room in rooms:
        index = chosen.get(room.name)
        arrangement = None if index is None else arrangements[index]
        kinds = _kinds(arrangement, room, dines=room.name == dines)
        begin = partial(
            RoomFurnishing.begin, room, floorplan, _density(arrangement), dice, new_id, is_small=room.name in small
        )
        is_open = arrangement is None or arrangement.SampleSet is None
        if room.name in small:
            work = furnish_small(begin, partial(_furnish_room, kinds=kinds, is_open=is_open), kinds, names)
            preferences += small_room_preferences(work, kinds) if is_open else []
        else:
            work, bare = _furnished(begin, kinds, names, is_open=is_open)
            preferences += bare
        asked = None if arrangement is None else arrangement.LooseObjects
        if asked is not None:
            things = scatter(work, asked, fill=True)
        else:
            things = scatter(work, ceil((MOST_LOOSE - loose) / (len(rooms) - len(done)))) if kinds else []
            loose += len(things)
        furniture += [*work.items, *things]
        lying[room.name] = len(things)
        done[room.name] = work
    for index in range(len(arrangements)):
        preferences += _preferences(arrangements, index, chosen, done)
        preferences += _loose_preferences(
            arrangements[index], index, {n: lying[n] for n in chosen if chosen[n] == index}
        )
    return furniture, preferences, [room.model_copy(update={"goal": done[room.name].space.goal()}) for room in rooms]


def _furnished(
    begin: Callable[[], RoomFurnishing], kinds: Sequence[str], names: Counter[str], *, is_open: bool
) -> tuple[RoomFurnishing, list[Preference]]:
    """Furnishes a room, a second time if essential furniture is missing, and returns it with the preferences it misses.

    Args:
        begin: Makes the empty room.
        kinds: Kinds of furniture to place.
        names: Pieces of each kind in the world so far; those of the room are added.
        is_open: Whether the template names no furniture for the room.
    """
    before = names.copy()
    work = begin()
    _furnish_room(work, kinds, is_open=is_open)
    if lacking := _lacking(work, kinds):
        # What had no room beside everything else comes first now.
        put_back(names, before)
        work = begin()
        work.place_first_that_fits(lacking)
        work.furnish(kinds)
        return work, _bare_preferences(work, kinds) if is_open else []
    if "DiningTables" in kinds and work.room.type == "Living" and not work.dines:
        after = names.copy()
        put_back(names, before)
        other = begin()
        other.place_first_that_fits(("DiningTables",))
        _furnish_room(other, kinds, is_open=is_open)
        if other.dines and (is_watched(other) or not is_watched(work)):
            return other, []
        put_back(names, after)
    return work, []


def _loose_preferences(arrangement: FurnitureArrangement, index: int, lying: dict[str, int]) -> list[Preference]:
    """Reports the preferred number of loose objects, if the template has one: satisfied when every room has as many.

    The list is empty if the template does not ask, or if no room has the arrangement.
    """
    asked = arrangement.LooseObjects
    if asked is None or not lying:
        return []
    short = {name: count for name, count in lying.items() if count < asked}
    found = [f"{name} has place for {count}, on tops and on the floor" for name, count in short.items()]
    wish = f"{asked} loose objects in each room of {arrangement.Name}"
    return [Preference.judged(f"{_PATH}[{index}].LooseObjects", wish, "; ".join(found))]


def _furnish_room(work: RoomFurnishing, kinds: Sequence[str], *, is_open: bool) -> None:
    """Furnishes a room: first groups of pieces that belong together, then single ones.

    Args:
        work: The room.
        kinds: Kinds of furniture to place.
        is_open: Whether the template names no furniture for the room.
    """
    if work.room.type == "Kitchen":
        line_up(work, [kind for kind in KITCHEN_RUN if kind in kinds])
    elif work.room.is_outdoor and set(BALCONY_SET) <= set(kinds):
        arrange_balcony(work)
    elif {"MediaStorage", "Sofas"} <= set(kinds):
        arrange_seating(work, table="CoffeeTables" in kinds)
    work.place_each(kinds)
    if work.room.type == "Living" and set(GROUP) <= set(kinds):
        arrange_groups(work)
    work.fill(kinds)
    if is_open and work.density == "Dense":
        work.fill(SPARE.get(work.room.type, ()))


def _lacking(work: RoomFurnishing, kinds: Sequence[str]) -> list[str]:
    """Returns the essential kinds of a room type if the room has none of them; empty otherwise."""
    needed = [kind for kind in INDISPENSABLE.get(work.room.type, ()) if kind in kinds]
    return [] if any(work.placed(kind) for kind in needed) else needed


def _bare_preferences(work: RoomFurnishing, kinds: Sequence[str]) -> list[Preference]:
    """Returns a missed preference if a room has none of the furniture that its type needs, such as a bed in a bedroom.

    The list is empty if it has one. For rooms whose furniture the template lists, callers report each kind instead.

    Args:
        work: The furnished room.
        kinds: Kinds of furniture that were to be placed in it.
    """
    lacking = _lacking(work, kinds)
    if not lacking:
        return []
    wish = f"{' or '.join(lacking)} in {work.room.name}, which is a {work.room.type}"
    reason = "; ".join(dict.fromkeys(work.missed[kind] for kind in lacking if kind in work.missed))
    return [Preference(path=f"{INTERIOR_PATH}.Furniture", wish=wish, outcome="missed", reason=reason)]


def _density(arrangement: FurnitureArrangement | None) -> Density:
    return "Moderate" if arrangement is None else arrangement.DesiredSpatialDensity


def _kinds(arrangement: FurnitureArrangement | None, room: Room, *, dines: bool) -> Sequence[str]:
    if arrangement is None or arrangement.SampleSet is None:
        return usual_types(room.type, _density(arrangement), room.floor_m2, dines=dines)
    return arrangement.SampleSet.ModelTypes


def _preferences(
    arrangements: Sequence[FurnitureArrangement], index: int, chosen: dict[str, int], done: dict[str, RoomFurnishing]
) -> list[Preference]:
    """Returns the preferences of an arrangement: about its density, and one for each listed kind.

    A kind is satisfied when every room of the arrangement has it. An empty list of kinds asks for bare rooms.
    """
    arrangement = arrangements[index]
    rooms = [work for name, work in done.items() if chosen.get(name) == index]
    kinds = None if arrangement.SampleSet is None else arrangement.SampleSet.ModelTypes
    bare = kinds is not None and not kinds
    preferences = [] if bare else _density_preferences(arrangement, index, rooms)
    for number, kind in enumerate(kinds or ()):
        reason, outcome = "; ".join(work.missed[kind] for work in rooms if kind in work.missed), "missed"
        if not rooms:
            reason, outcome = why_unused(arrangement, arrangements, chosen, [work.room for work in done.values()])
        path = f"{_PATH}[{index}].SampleSet.ModelTypes[{number}]"
        preferences.append(Preference.judged(path, f"{kind} in {arrangement.Name}", reason, outcome))
    return preferences


def _density_preferences(
    arrangement: FurnitureArrangement, index: int, rooms: Sequence[RoomFurnishing]
) -> list[Preference]:
    """Reports the preferred density: satisfied when every room is about as full.

    Nothing is reported if no room has a preference.
    """
    density = arrangement.DesiredSpatialDensity
    short = [work for work in rooms if work.covered_share < work.granted_share]
    found = [
        f"furniture covers {work.covered_share:.0%} of {work.room.name}, not {work.wished_share:.0%}" for work in short
    ]
    if not rooms or "DesiredSpatialDensity" not in arrangement.model_fields_set:
        return []
    path = f"{_PATH}[{index}].DesiredSpatialDensity"
    return [Preference.judged(path, f"{density} furniture in {arrangement.Name}", "; ".join(found))]
