"""Chooses the materials of floors and walls, and decides the outcome of the preferences about them."""

from collections.abc import Sequence

import numpy as np

from ....schemas.templates.body import INTERIOR_PATH, FloorMaterialSet, WallMaterialSet, WorldTemplateBody
from ....schemas.worlds.world import Preference, Room, RoomType
from ..floorplans.targets import choose_sets, why_unused
from .materials import FLOORS, USUAL_FLOORS, USUAL_WALLS, WALLS, Material

MaterialSets = Sequence[FloorMaterialSet] | Sequence[WallMaterialSet]

_SAME_FINISH_SHARE = 0.7


def choose_surfaces(
    body: WorldTemplateBody, rooms: Sequence[Room], rng: np.random.Generator
) -> tuple[list[Room], list[Preference]]:
    """Gives every room a floor and a wall material, each in one of its finishes.

    Args:
        body: the template.
        rooms: the plan's rooms.
        rng: the source of chance.

    Returns:
        The rooms with their materials, and the outcome of each listed material.
    """
    floors, floor_preferences = _choose("Flooring", body.interior.Flooring.MaterialSets, USUAL_FLOORS, rooms, rng)
    walls, wall_preferences = _choose("Walls", body.interior.Walls.MaterialSets, USUAL_WALLS, rooms, rng)
    floor_finishes, wall_finishes = _finishes(floors, FLOORS, rng), _finishes(walls, WALLS, rng)
    finished = [
        room.model_copy(
            update={
                "floor_material": floors[room.name],
                "wall_material": walls[room.name],
                "floor_finish": floor_finishes[room.name],
                "wall_finish": wall_finishes[room.name],
            }
        )
        for room in rooms
    ]
    return finished, floor_preferences + wall_preferences


def _choose(
    part: str,
    sets: MaterialSets,
    usual: dict[RoomType, tuple[str, ...]],
    rooms: Sequence[Room],
    rng: np.random.Generator,
) -> tuple[dict[str, str], list[Preference]]:
    chosen = choose_sets(sets, rooms)
    materials: dict[str, str] = {}
    for index, one_set in enumerate(sets):
        if one_set.SampleSet is None:
            continue
        mine = [room.name for room in rooms if chosen.get(room.name) == index]
        # Dealt out in turn, so that as many of the listed materials as there are rooms really appear.
        dealt = [str(material) for material in rng.permutation(list(dict.fromkeys(one_set.SampleSet.MaterialTypes)))]
        materials |= {name: dealt[number % len(dealt)] for number, name in enumerate(mine)}
    for room in rooms:
        if room.name not in materials:
            materials[room.name] = str(rng.choice(usual[room.type]))
    preferences = [
        preference
        for index in range(len(sets))
        for preference in _preferences(part, sets, index, chosen, materials, rooms)
    ]
    return materials, preferences


def _finishes(chosen: dict[str, str], table: dict[str, Material], rng: np.random.Generator) -> dict[str, str]:
    """One finish per material and building, mostly: homes do not have a different oak in every room."""
    usual = {material: str(rng.choice([each.name for each in table[material].finishes])) for material in sorted(table)}
    finishes: dict[str, str] = {}
    for room, material in chosen.items():
        other = str(rng.choice([each.name for each in table[material].finishes]))
        finishes[room] = usual[material] if rng.random() < _SAME_FINISH_SHARE else other
    return finishes


def _preferences(
    part: str,
    sets: MaterialSets,
    index: int,
    chosen: dict[str, int],
    materials: dict[str, str],
    rooms: Sequence[Room],
) -> list[Preference]:
    one_set = sets[index]
    if one_set.SampleSet is None:
        return []
    mine = [room.name for room in rooms if chosen.get(room.name) == index]
    present = {materials[name] for name in mine}
    missed = f"{len(one_set.SampleSet.MaterialTypes)} materials for {len(mine)} rooms"
    path = f"{INTERIOR_PATH}.{part}.MaterialSets[{index}].SampleSet.MaterialTypes"
    preferences: list[Preference] = []
    for number, material in enumerate(one_set.SampleSet.MaterialTypes):
        reason, outcome = "" if material in present else missed, "missed"
        if not mine:
            reason, outcome = why_unused(one_set, sets, chosen, rooms)
        preferences.append(Preference.judged(f"{path}[{number}]", f"{material} in {one_set.Name}", reason, outcome))
    return preferences
