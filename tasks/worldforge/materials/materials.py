"""Floor and wall materials: their looks, their friction, the rooms that usually have them, and choosing them.

Every material has several finishes: another wood, another tile, another wallpaper. `world.json` names both, so that its
readers can draw the surface again.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, cast

import numpy as np

from ....schemas.templates.body import INTERIOR_PATH, FloorMaterialSet, WallMaterialSet, WorldTemplateBody
from ....schemas.worlds.world import FLOOR_MATERIALS, WALL_MATERIALS, Preference, Room, RoomType
from ..floorplans.brief import choose_sets, why_unused
from ..geometry.parts import Color, rgb

Surface = Literal["floor", "wall"]
Pattern = Literal[
    "plain", "pile", "mottled", "boards", "marbled", "checkered", "parquet", "herringbone", "tiles", "metro",
    "bricks", "stones", "formwork", "panels", "stripes", "trellis", "sprigs",
]  # fmt: skip


@dataclass(frozen=True, slots=True)
class Finish:
    """A finish (colour and pattern) of a floor or wall material."""

    name: str
    """Name that is unique among the finishes of its material."""
    pattern: Pattern
    """Pattern of a surface finish: the layout of its colours."""
    color: Color
    """Main colour of a surface finish."""
    second: Color
    """Second colour of a surface finish: of every second board, stripe or stone."""
    line: Color
    """Colour of joints, grooves and specks of a surface finish."""


@dataclass(frozen=True, slots=True)
class Material:
    """A floor or wall material with its finishes."""

    finishes: tuple[Finish, ...]
    """Finishes of the material; the first one is used where a plan names none."""
    friction: float = 0.8
    """Sliding friction of dry rubber on a floor material; walls do not use it."""


def _material(*finishes: str, friction: float = 0.8) -> Material:
    """Makes a material from texts, one per finish: name, pattern, main colour, second colour and line colour."""
    return Material(tuple(map(_finish, finishes)), friction)


def _finish(written: str) -> Finish:
    name, pattern, *colors = written.split()
    return Finish(name, cast("Pattern", pattern), *map(rgb, colors))


# Sliding friction of clean, dry, soft rubber, as wheels and shoe soles have it. Engineering tables give
# 0.6 to 0.85 on dry concrete and up to 1.0 where it is rough, 0.7 to 0.75 on lacquered wood, 0.6 to 0.7 on
# glazed tiles, 0.8 to 0.9 on linoleum; carpet also holds by its pile, hence more than 1. The order is what
# matters: tiles are the slipperiest, then parquetry, floorboards, linoleum, concrete, carpet.
FLOORS: dict[str, Material] = {
    "Carpet": _material(
        "sand pile b9ad9c a89c8a c9beae",
        "slate pile 7f8891 717a84 939ca5",
        "moss pile 8f9780 808871 a2aa93",
        "rose pile b39a94 a38a84 c4aca6",
        friction=1.1,
    ),
    "Concrete": _material(
        "pale mottled bfc0be b2b4b2 9b9d9b",
        "grey mottled a3a5a5 969899 808283",
        "warm mottled b7b0a6 aaa298 938b82",
        friction=0.9,
    ),
    "Floorboards": _material(
        "oak boards c9a377 b98f62 8a6843",
        "walnut boards 8a6144 774f35 513422",
        "grey boards b5ada2 a59c91 7d756c",
        "pine boards dcbb8a cfa973 a58353",
        friction=0.75,
    ),
    "Linoleum": _material(
        "sage marbled b3bfae 9eac9b c9d2c3",
        "checkered checkered dcd9d0 6f7f83 b9b6ae",
        "ochre marbled c9ae7f b8996a dcc69e",
        "blue marbled 93a7b5 8196a6 adbecb",
        friction=0.85,
    ),
    "Parquetry": _material(
        "oak parquet bd8d59 a97a48 7c5630",
        "herringbone herringbone c39a68 ae8353 80592f",
        "walnut herringbone 855b3e 714a31 4b301f",
        "cherry parquet a5643f 935433 673821",
        friction=0.7,
    ),
    "Tiles": _material(
        "white tiles e6e6e3 dcdddb b4b6b5",
        "terracotta tiles bf7f5d b07150 d8c6b4",
        "slate tiles 727a80 666e74 9ea3a6",
        "checkered checkered e6e4de 4c5257 a4a5a3",
        friction=0.65,
    ),
}
"""The six floor materials, by name."""

WALLS: dict[str, Material] = {
    "Brick": _material(
        "red bricks a5593f 8f4a34 cfc1b3",
        "whitewashed bricks e3ded5 d6d0c6 bdb6ab",
        "brown bricks 8c6650 785543 c3b6a5",
    ),
    "Concrete": _material(
        "grey formwork b3b4b2 a7a8a6 8b8c8a",
        "warm formwork bdb5aa b0a89d 938b81",
    ),
    "Stone": _material(
        "limestone stones c3b8a5 aa9f8d 8d8374",
        "slate stones 8e9091 787b7d 5f6263",
        "sandstone stones c09f77 ab8a64 8a6d4d",
    ),
    "Tiles": _material(
        "white-metro metro eef0ef e4e7e6 bcc2c2",
        "sea tiles b5d0d2 a4c3c6 e2eaea",
        "sage-metro metro a9bca9 9bb09c d9e0d8",
        "sand tiles dccfba d2c4ae b5a890",
    ),
    "WoodPanels": _material(
        "oak panels c29a6c b38a5d 83603b",
        "walnut panels 84593c 744c32 4d321f",
        "white panels ebe7de e4dfd5 bfb9ad",
    ),
    "WallPaint": _material(
        "cream plain ece4d6 ece4d6 ddd3c3",
        "white plain efeeea efeeea dfded9",
        "sky plain cbd9e2 cbd9e2 b9c9d3",
        "sage plain cdd6c6 cdd6c6 bbc5b3",
        "blush plain e6d1c6 e6d1c6 d6bfb3",
    ),
    "Wallpaper": _material(
        "green-stripes stripes d3ddd3 bccbbd a3b8a6",
        "blue-trellis trellis d5dee4 bccad4 93a8b7",
        "garden sprigs ece6d8 8ba585 c98d75",
        "rose-stripes stripes ead9d2 dcc4bb c7a69b",
    ),
}
"""The seven wall materials, by name."""

OUTSIDE = _finish("outside plain e6dfd3 e6dfd3 d2c9ba")
"""Finish of the outer faces of exterior walls."""

USUAL_FLOORS: dict[RoomType, tuple[str, ...]] = {
    "Bedroom": ("Carpet", "Floorboards", "Parquetry"),
    "Bathroom": ("Tiles", "Tiles", "Linoleum"),
    "Living": ("Floorboards", "Parquetry", "Carpet"),
    "Dining": ("Floorboards", "Parquetry"),
    "Kitchen": ("Tiles", "Linoleum", "Floorboards"),
    "Hallway": ("Floorboards", "Tiles", "Concrete"),
    "Closet": ("Carpet", "Linoleum", "Concrete"),
    "Office": ("Parquetry", "Carpet", "Floorboards"),
    "Storage": ("Concrete", "Linoleum", "Tiles"),
    "Balcony": ("Concrete", "Tiles", "Floorboards"),
}
USUAL_WALLS: dict[RoomType, tuple[str, ...]] = {
    "Bedroom": ("WallPaint", "Wallpaper", "WoodPanels"),
    "Bathroom": ("Tiles", "Tiles", "WallPaint"),
    "Living": ("WallPaint", "Wallpaper", "Brick", "Stone"),
    "Dining": ("WallPaint", "Wallpaper", "WoodPanels"),
    "Kitchen": ("WallPaint", "Tiles", "Brick"),
    "Hallway": ("WallPaint", "Concrete"),
    "Closet": ("WallPaint", "WoodPanels"),
    "Office": ("WallPaint", "WoodPanels", "Wallpaper"),
    "Storage": ("WallPaint", "Concrete", "Brick"),
    "Balcony": ("Concrete", "Stone", "Brick"),
}

assert set(FLOORS) == set(FLOOR_MATERIALS)
assert set(WALLS) == set(WALL_MATERIALS)


def finish_named(surface: Surface, material: str, name: str) -> Finish:
    """Returns a finish by surface, material and name; an empty name means the first one.

    Raises:
        ValueError: No finish has this name; the world was written by another generator version or changed by hand.
    """
    known = (FLOORS if surface == "floor" else WALLS)[material].finishes
    for finish in known:
        if name in ("", finish.name):
            return finish
    names = ", ".join(finish.name for finish in known)
    raise ValueError(f"{surface}_finish {name!r} of {material}: not known; one of {names} would be right")


def surface_name(surface: Surface, room: Room) -> str:
    """Returns the name of a room's floor or wall material in the MJCF: `floor_Carpet_sand`.

    Raises ValueError if the material has no finish of that name.
    """
    material, finish = (
        (room.floor_material, room.floor_finish) if surface == "floor" else (room.wall_material, room.wall_finish)
    )
    return f"{surface}_{material}_{finish_named(surface, material, finish).name}"


def surface_finish(name: str) -> Finish:
    """Returns the finish that a material name of the MJCF means.

    Raises:
        ValueError: No finish has this material name.
    """
    if name == "wall_outside":
        return OUTSIDE
    surface, material, finish = name.split("_")
    return finish_named("floor" if surface == "floor" else "wall", material, finish)


MaterialSets = Sequence[FloorMaterialSet] | Sequence[WallMaterialSet]

_SAME_FINISH_SHARE = 0.7


def choose_surfaces(
    body: WorldTemplateBody, rooms: Sequence[Room], rng: np.random.Generator
) -> tuple[list[Room], list[Preference]]:
    """Chooses floor and wall materials with finishes for every room.

    Args:
        body: The template.
        rooms: The plan's rooms.
        rng: The source of chance.

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
    """Chooses one finish per material for the whole building, mostly.

    Homes do not have a different oak in every room.
    """
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
