"""The catalogue: every kind of furniture with its styles, and how each is built from parts.

Sizes are those of real furniture. A piece is fully described by its kind and the name of its style,
so that readers of `world.json` can rebuild it part by part.
"""

from collections.abc import Callable
from functools import lru_cache

from ....schemas.worlds.world import Furniture
from ..geometry.parts import Part, Style, styles
from . import cabinets, fixtures, loose, soft, tables

Builder = Callable[[Style], list[Part]]

LOOSE_TYPES = ("Ball", "Book", "Carton", "Clothes", "Cup", "Plate", "Shoe", "ToyBlock")
"""Kinds of loose objects, which no template can name."""

_CATALOGUE: dict[str, tuple[Builder, tuple[Style, ...]]] = {
    "Baths": (
        fixtures.bath,
        styles("long", (1.7, 0.75, 0.58), "ceramic") + styles("short", (1.5, 0.7, 0.58), "ceramic"),
    ),
    "BarCabinets": (
        cabinets.bar_cabinet,
        styles("wide", (1.0, 0.42, 0.95), "walnut", "black") + styles("narrow", (0.75, 0.4, 0.95), "oak"),
    ),
    "Beds": (
        soft.bed,
        styles("king", (1.8, 2.08, 1.05), "walnut", "sage")
        + styles("king padded", (1.84, 2.1, 1.15), "navy", "grey")
        + styles("double", (1.5, 2.05, 1.0), "oak", "navy")
        + styles("double padded", (1.52, 2.08, 1.1), "sage", "terracotta")
        + styles("single", (0.98, 2.02, 0.9), "white", "terracotta"),
    ),
    "Bookcases": (
        cabinets.bookcase,
        styles("tall", (0.9, 0.32, 1.9), "oak", "white", "walnut") + styles("low", (1.1, 0.32, 0.9), "oak", "white"),
    ),
    "CoffeeTables": (
        tables.coffee_table,
        styles("long", (1.1, 0.6, 0.42), "oak", "walnut") + styles("round", (0.8, 0.8, 0.4), "walnut", "white")
        + styles("chest", (1.0, 0.6, 0.42), "oak", "white"),
    ),
    "ConsoleTables": (
        tables.console_table,
        styles("plain", (1.1, 0.34, 0.8), "oak", "black", "white")
        + styles("drawers", (1.2, 0.38, 0.82), "walnut", "sage"),
    ),
    "CornerCabinets": (
        cabinets.corner_cabinet,
        styles("tall", (0.6, 0.6, 1.8), "white", "walnut", "oak") + styles("low", (0.6, 0.6, 0.85), "sage", "oak"),
    ),
    "DeskChairs": (
        soft.desk_chair,
        styles("swivel", (0.6, 0.6, 1.0), "black", "grey", "terracotta")
        + styles("task", (0.54, 0.56, 0.92), "navy", "sage"),
    ),
    "Desks": (
        tables.desk,
        styles("wide", (1.4, 0.7, 0.74), "oak", "walnut") + styles("narrow", (1.1, 0.6, 0.74), "white")
        + styles("legs", (1.2, 0.6, 0.74), "oak", "white"),
    ),
    "DiningChairs": (
        soft.dining_chair,
        styles("upright", (0.44, 0.47, 0.88), "oak", "walnut", "white", "mustard")
        + styles("ladder", (0.43, 0.46, 0.94), "oak", "walnut", "white")
        + styles("shell", (0.46, 0.48, 0.82), "sage", "navy", "mustard"),
    ),
    "DiningTables": (
        tables.dining_table,
        styles("six", (1.7, 0.9, 0.75), "oak", "walnut")
        + styles("four", (1.25, 0.8, 0.75), "oak", "white")
        + styles("round", (1.1, 1.1, 0.75), "walnut", "white"),
    ),
    "DishWashers": (fixtures.dishwasher, styles("built-in", (0.6, 0.62, 0.88), "steel", "white", "black")),
    "Dressers": (
        cabinets.dresser,
        styles("wide", (1.3, 0.48, 0.82), "oak", "white", "walnut") + styles("tall", (0.8, 0.46, 1.1), "white", "sage"),
    ),
    "EndAndSideTables": (
        tables.side_table,
        styles("square", (0.48, 0.48, 0.52), "oak", "walnut") + styles("round", (0.45, 0.45, 0.54), "black", "oak"),
    ),
    "FloorLamps": (
        cabinets.floor_lamp,
        styles("shade", (0.38, 0.38, 1.6), "black", "steel") + styles("globe", (0.38, 0.38, 1.55), "black", "mustard"),
    ),
    "Fridges": (
        fixtures.fridge,
        styles("tall", (0.6, 0.66, 1.85), "steel", "white") + styles("wide", (0.75, 0.7, 1.8), "steel")
        + styles("side-by-side", (0.9, 0.7, 1.78), "steel", "black"),
    ),
    "LivingRoomChairs": (
        soft.armchair,
        styles("armchair", (0.86, 0.85, 0.84), "grey", "sage", "navy", "mustard", "terracotta")
        + styles("scandi", (0.74, 0.8, 0.82), "grey", "sage", "mustard")
        + styles("tub", (0.76, 0.76, 0.78), "navy", "terracotta", "sage"),
    ),
    "KitchenIslandsAndCarts": (
        tables.kitchen_island,
        styles("island", (1.4, 0.8, 0.92), "navy", "sage", "white") + styles("cart", (0.95, 0.55, 0.9), "white", "oak"),
    ),
    "MediaStorage": (
        cabinets.media_storage,
        styles("wide", (1.7, 0.42, 1.22), "oak", "walnut", "white") + styles("narrow", (1.2, 0.42, 1.05), "oak"),
    ),
    "Nightstands": (
        tables.nightstand,
        styles("drawers", (0.46, 0.42, 0.52), "oak", "walnut", "white")
        + styles("open", (0.44, 0.4, 0.54), "oak", "walnut", "sage"),
    ),
    "Ottomans": (
        soft.ottoman,
        styles("square", (0.62, 0.52, 0.42), "sage", "terracotta")
        + styles("round", (0.55, 0.55, 0.42), "mustard", "navy"),
    ),
    "Ovens": (
        fixtures.oven,
        styles("cooker", (0.6, 0.62, 0.9), "steel", "white", "black") + styles("range", (0.9, 0.62, 0.9), "steel"),
    ),
    "ServingCarts": (tables.serving_cart, styles("trolley", (0.72, 0.42, 0.86), "mustard", "oak", "black")),
    "Showers": (
        fixtures.shower,
        styles("cabin", (0.9, 0.9, 2.0), "ceramic") + styles("walk-in", (1.2, 0.9, 2.0), "ceramic"),
    ),
    "SideboardsAndBuffets": (
        cabinets.sideboard,
        styles("wide", (1.6, 0.45, 0.85), "oak", "walnut", "sage") + styles("narrow", (1.2, 0.42, 0.85), "white"),
    ),
    "Sofas": (
        soft.seat,
        styles("three-seat", (2.2, 0.92, 0.82), "grey", "sage", "navy", "mustard")
        + styles("two-seat", (1.65, 0.9, 0.82), "grey", "sage", "navy", "mustard")
        + styles("scandi three-seat", (2.06, 0.86, 0.8), "grey", "terracotta", "sage")
        + styles("scandi two-seat", (1.5, 0.84, 0.8), "grey", "navy", "mustard"),
    ),
    "Storage": (
        cabinets.storage,
        styles("wardrobe", (1.5, 0.6, 2.05), "white", "oak", "walnut")
        + styles("cupboard", (0.9, 0.5, 1.9), "white", "oak")
        + styles("shelves", (0.9, 0.42, 1.5), "oak", "grey")
        + styles("counter-sink", (1.0, 0.62, 0.9), "white", "sage", "navy")
        + styles("counter", (0.8, 0.62, 0.9), "white", "sage", "navy"),
    ),
    "StorageBenches": (soft.storage_bench, styles("bench", (1.1, 0.42, 0.48), "oak", "white", "walnut")),
    "Toilets": (
        fixtures.toilet,
        styles("close-coupled", (0.38, 0.68, 0.8), "ceramic") + styles("wall-hung", (0.4, 0.66, 1.1), "ceramic"),
    ),
    "VanityCounters": (
        fixtures.vanity,
        styles("single", (0.85, 0.52, 1.75), "oak", "white", "navy") + styles("double", (1.3, 0.52, 1.75), "walnut"),
    ),
    "WashingMachinesAndDryers": (
        fixtures.washing_machine,
        styles("single", (0.6, 0.6, 0.86), "white", "steel") + styles("stacked", (0.6, 0.6, 1.7), "white", "steel"),
    ),
    "Ball": (loose.ball, styles("ball", (0.18, 0.18, 0.18), "terracotta", "navy", "mustard")),
    "Book": (loose.book, styles("book", (0.16, 0.23, 0.035), "terracotta", "navy", "sage", "mustard")),
    "Carton": (loose.carton, styles("carton", (0.4, 0.3, 0.26), "oak")),
    "Clothes": (loose.clothes, styles("pullover", (0.3, 0.36, 0.07), "navy", "terracotta", "sage", "mustard")),
    "Cup": (loose.cup, styles("mug", (0.085, 0.085, 0.095), "white", "navy", "terracotta")),
    "Plate": (loose.plate, styles("dinner", (0.26, 0.26, 0.022), "white", "sage")),
    "Shoe": (loose.shoe, styles("trainer", (0.1, 0.28, 0.11), "white", "navy", "walnut")),
    "ToyBlock": (loose.toy_block, styles("block", (0.09, 0.09, 0.09), "terracotta", "mustard", "navy", "sage")),
}  # fmt: skip


def styles_of(model_type: str) -> tuple[Style, ...]:
    """All styles of one kind.

    Raises:
      KeyError: for a kind that is not in the catalogue.
    """
    return _CATALOGUE[model_type][1]


def parts_of(item: Furniture) -> tuple[Part, ...]:
    """The parts of one piece, in its own frame, standing on its `base_m`.

    Raises:
      ValueError: when kind or style are not in the catalogue, which means that the piece was written
        by another version of the generator.
    """
    return _build(item.model_type, item.style)


@lru_cache(maxsize=256)
def _build(model_type: str, style_name: str) -> tuple[Part, ...]:
    if model_type not in _CATALOGUE:
        raise ValueError(
            f"model_type {model_type!r}: not in the catalogue; one of {', '.join(_CATALOGUE)} would be right"
        )
    build, known = _CATALOGUE[model_type]
    for style in known:
        if style.name == style_name:
            return tuple(build(style))
    names = ", ".join(style.name for style in known)
    raise ValueError(f"style {style_name!r} of {model_type}: not in the catalogue; one of {names} would be right")
