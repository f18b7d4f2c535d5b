"""Sets the finish and initial opening of each door, and reports the template's preferences about doors."""

from collections.abc import Sequence

import numpy as np

from ....schemas.templates.body import (
    INTERIOR_PATH,
    DoorwayTarget,
    InteriorDoorwaySet,
    TemplateTargetSet,
    WorldTemplateBody,
)
from ....schemas.worlds.world import Floorplan, Passage, Preference, Room
from .door_parts import FINISHES, FORMS, FULLY_OPEN_PERCENT
from .doors import hang_doors

_RANKS = 4
_OUTER_FORM = "glazed"
"""Form of doors to balconies: they light the room in place of a window."""


def dress_doors(
    body: WorldTemplateBody, plan: Floorplan, rng: np.random.Generator
) -> tuple[Floorplan, list[Preference]]:
    """Sets the finish and initial opening of a floor plan's doors, as the world template asks.

    All doors of a world have one finish. A door that no doorway set is for is fully open.

    Args:
        body: The template.
        plan: The plan, with the doors that `hang_doors` gave it; left as it is.
        rng: The source of chance.

    Returns:
        The plan with its doors in their initial state, and the outcome of each doorway set.
    """
    sets = body.interior.Doorways.DoorwaySets if body.interior.Doorways else []
    chosen = choose_doorway_sets(sets, plan)
    finish = FINISHES[int(rng.integers(len(FINISHES)))]
    outside = {room.name for room in plan.rooms if room.is_outdoor}
    passages: list[Passage] = []
    for index, passage in enumerate(plan.passages):
        # Drawn for every way, so that a set for one door leaves the others as they were.
        form, chance = FORMS[int(rng.integers(len(FORMS)))], float(rng.integers(0, 101))
        if passage.door is None:
            passages.append(passage)
            continue
        preferred = (
            sets[chosen[index]].Door.InitialState.OpenPosition.Percent if index in chosen else FULLY_OPEN_PERCENT
        )
        if any(name in outside for name in passage.rooms):
            form = _OUTER_FORM
        percent = chance if preferred == "Random" else float(preferred)
        door = passage.door.model_copy(update={"style": f"{form} {finish}", "open_percent": percent})
        passages.append(passage.model_copy(update={"door": door}))
    preferences = [_preference(sets, index, chosen, plan) for index in range(len(sets))]
    return plan.model_copy(update={"passages": passages}), preferences


def choose_doorway_sets(sets: Sequence[InteriorDoorwaySet], plan: Floorplan) -> dict[int, int]:
    """Returns which set of the world template applies to each doorway, by passage number.

    Sets that name both rooms come first, then those that name one, then those of types alone, then those for
    all doorways; among equals the first in the template wins.
    """
    rooms = {room.name: room for room in plan.rooms}
    chosen: dict[int, int] = {}
    for rank in range(_RANKS):
        for number, one_set in enumerate(sets):
            if _rank(one_set.TargetSet) == rank:
                for index, passage in enumerate(plan.passages):
                    if passage.kind == "Doorway" and _means(one_set.TargetSet, passage, rooms):
                        chosen.setdefault(index, number)
    return chosen


def _rank(target: DoorwayTarget) -> int:
    if isinstance(target, str):
        return _RANKS - 1
    return (target.From.RoomNames is None) + (target.To.RoomNames is None)


def _means(target: DoorwayTarget, passage: Passage, rooms: dict[str, Room]) -> bool:
    """Whether a doorway set of the world template applies to a doorway, in either direction."""
    if isinstance(target, str):
        return True
    one, other = (rooms[name] for name in passage.rooms)
    return (_has(target.From, one) and _has(target.To, other)) or (_has(target.From, other) and _has(target.To, one))


def _has(some: TemplateTargetSet, room: Room) -> bool:
    return room.name in (some.RoomNames or []) or room.type in (some.RoomTypes or [])


def _preference(sets: Sequence[InteriorDoorwaySet], number: int, chosen: dict[int, int], plan: Floorplan) -> Preference:
    one_set = sets[number]
    percent = one_set.Door.InitialState.OpenPosition.Percent
    opening = "at random" if percent == "Random" else f"{percent:g} %"
    path, wish = f"{INTERIOR_PATH}.Doorways.DoorwaySets[{number}]", f"doors of {one_set.Name} open {opening}"
    target = one_set.TargetSet
    rooms = {room.name: room for room in plan.rooms}
    meant = [
        index
        for index, passage in enumerate(plan.passages)
        if passage.kind == "Doorway" and _means(target, passage, rooms)
    ]
    mine = [index for index in meant if chosen[index] == number]
    if meant and not mine:
        others = sorted({sets[chosen[index]].Name for index in meant})
        return Preference.judged(path, wish, f"its doorways follow {', '.join(others)}", "contradictory")
    problems = _missing(target, plan)
    if not meant and not problems:
        problems = [_nothing(target)]
    doorless = [index for index in mine if plan.passages[index].door is None]
    if doorless:
        why = hang_doors(plan)[1]
        problems += [f"no door between {' and '.join(plan.passages[index].rooms)}: {why[index]}" for index in doorless]
    return Preference.judged(path, wish, "; ".join(problems))


def _missing(target: DoorwayTarget, plan: Floorplan) -> list[str]:
    """Returns the pairs of rooms that a doorway set names and that no doorway connects, as texts."""
    if isinstance(target, str) or target.From.RoomNames is None or target.To.RoomNames is None:
        return []
    kinds = {frozenset(passage.rooms): passage.kind for passage in plan.passages}
    pairs = dict.fromkeys(frozenset((one, other)) for one in target.From.RoomNames for other in target.To.RoomNames)
    order = {room.name: place for place, room in enumerate(plan.rooms)}
    found: list[str] = []
    for pair in pairs:
        names = " and ".join(sorted(pair, key=lambda name: order[name]))
        if len(pair) == 1:
            continue
        if pair not in kinds:
            found.append(f"{names} are not joined by a doorway")
        elif kinds[pair] == "Opening":
            found.append(f"{names} are joined by an opening, which has no door")
    return found


def _nothing(target: DoorwayTarget) -> str:
    if isinstance(target, str):
        return "the plan has no doorway"
    ends = [" or ".join(some.RoomNames or some.RoomTypes or []) for some in (target.From, target.To)]
    return f"no doorway joins {ends[0]} with {ends[1]}"
