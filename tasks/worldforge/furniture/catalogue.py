"""Furniture catalogue: every kind with its styles, parts, placement rule and floor plan symbol.

Sizes are those of real furniture. A piece is fully described by its kind and the name of its style, so that readers of
`world.json` can rebuild it part by part.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

from ....schemas.worlds.world import Furniture
from ..geometry.parts import Part, Style, styles
from . import cabinets, fixtures, soft, tables

Relation = Literal["beside", "before", "around", "desk", "facing", "gathered", "run", ""]
Spot = Literal["wall", "corner", "open"]


@dataclass(frozen=True, slots=True)
class Rule:
    """Placement rule of a furniture type: where it may be, and how much free space people need around it.

    Clearances are what people need, from the usual handbooks of ergonomics and kitchen design, metres:
    0.6 to stand and turn before a piece, 0.75 to pull out a drawer or open a wardrobe and stand before it,
    0.9 to work at an appliance with its door open or to push a chair back from a desk, 0.75 around a dining
    table to sit down, 0.5 beside a bed to get up, 0.4 between a sofa and its table for the legs.
    """

    spot: Spot = "wall"
    """Usual place in a room (at a wall, in the open, ...) of a piece that is placed on its own."""
    prefer: Literal["middle", "corner", "any"] = "any"
    """Part of a wall where a piece of furniture is preferred: middle, corner or any."""
    front_m: float = 0.0
    """Free space in front of a piece of furniture, in metres: to get up, to open it, to work at it."""
    beside_m: float = 0.0
    """Free space on both sides of a piece of furniture, in metres; on one side of a single bed."""
    around_m: float = 0.0
    """Free space on every side of a piece in the open, in metres."""
    relation: Relation = ""
    """Position relative to the kinds in `near` (beside, before, around, ...), tried before `spot`."""
    near: tuple[str, ...] = ()
    """Kinds of furniture that a piece belongs to, such as the bed of a nightstand."""
    bound: bool = False
    """Whether it may not be placed away from the kinds in `near` if the room has one of them."""
    seat_m: float = 0.0
    """Depth that a chair in front of it takes, in metres; this area must not be at a door."""
    gap_m: float = 0.0
    """Distance of a piece of furniture to its partner for the relations `before` and `gathered`, in metres."""
    hides_window: bool = False
    """Whether a piece of furniture is never placed before a window, however low it is."""
    counts: tuple[int, int, int] = (1, 1, 1)
    """Number of pieces of a furniture kind placed at first in sparse, moderate and dense rooms."""
    limit: int = 1
    """Limit of the pieces of one kind per 30 m2 of floor."""
    one_a_room: bool = False
    """Whether larger rooms get no more than one piece of a kind, such as a television."""


KITCHEN_RUN = ("Fridges", "Ovens", "DishWashers", "Storage", "WashingMachinesAndDryers")
"""Kinds of furniture that are placed in a kitchen's row."""

SEATS = ("Sofas", "LivingRoomChairs")
"""Kinds of furniture for sitting in living rooms."""


Builder = Callable[[Style], list[Part]]

COMPACT = " compact"
"""Suffix of form names that only rooms below 10 m2 get; usual pieces would block the paths that robots need there."""

LOOSE_TYPES = ("Ball", "Book", "Carton", "Clothes", "Cup", "Plate", "Shoe", "ToyBlock")
"""Kinds of loose objects, which templates cannot list as furniture."""


@dataclass(frozen=True, slots=True)
class Kind:
    """A furniture type of the catalogue: its styles, builder and placement rule."""

    build: Builder
    """Function that builds the parts of one style of a furniture kind."""
    styles: tuple[Style, ...]
    rule: Rule | None = None
    """Placement rule of a furniture kind; `None` for loose objects."""
    symbol: str = "plain"
    """Floor plan symbol of a furniture kind: a name in `pictures/plan_symbols.py`."""


# In the order of placing: what rooms are arranged around comes first.
CATALOGUE: dict[str, Kind] = {
    "Beds": Kind(
        soft.bed,
        styles("king", (1.8, 2.08, 1.05), "walnut", "sage")
        + styles("king padded", (1.84, 2.1, 1.15), "navy", "grey")
        + styles("double", (1.5, 2.05, 1.0), "oak", "navy")
        + styles("double padded", (1.52, 2.08, 1.1), "sage", "terracotta")
        + styles("single", (0.98, 2.02, 0.9), "white", "terracotta"),
        Rule(prefer="middle", front_m=0.6, beside_m=0.5),
        "bed",
    ),
    "MediaStorage": Kind(
        cabinets.media_storage,
        styles("wide", (1.7, 0.42, 1.22), "oak", "walnut", "white") + styles("narrow", (1.2, 0.42, 1.05), "oak"),
        Rule(prefer="middle", front_m=0.75, hides_window=True, one_a_room=True),
        "drawers",
    ),
    "Sofas": Kind(
        soft.sofa,
        styles("three-seat", (2.2, 0.92, 0.82), "grey", "sage", "navy", "mustard")
        + styles("two-seat", (1.65, 0.9, 0.82), "grey", "sage", "navy", "mustard")
        + styles("scandi three-seat", (2.06, 0.86, 0.8), "grey", "terracotta", "sage")
        + styles("scandi two-seat", (1.5, 0.84, 0.8), "grey", "navy", "mustard"),
        Rule(prefer="middle", front_m=0.5, relation="facing", near=("MediaStorage",), gap_m=0.5, limit=2),
        "sofa",
    ),
    "DiningTables": Kind(
        tables.dining_table,
        styles("six", (1.7, 0.9, 0.75), "oak", "walnut")
        + styles("four", (1.25, 0.8, 0.75), "oak", "white")
        + styles("round", (1.1, 1.1, 0.75), "walnut", "white"),
        Rule(spot="open", around_m=0.75),
        "table",
    ),
    "Fridges": Kind(
        fixtures.fridge,
        styles("tall", (0.6, 0.66, 1.85), "steel", "white")
        + styles("wide", (0.75, 0.7, 1.8), "steel")
        + styles("side-by-side", (0.9, 0.7, 1.78), "steel", "black"),
        Rule(prefer="corner", front_m=0.9, relation="run", near=KITCHEN_RUN, one_a_room=True),
        "fridge",
    ),
    "Ovens": Kind(
        fixtures.oven,
        styles("cooker", (0.6, 0.62, 0.9), "steel", "white", "black") + styles("range", (0.9, 0.62, 0.9), "steel"),
        Rule(front_m=0.9, relation="run", near=KITCHEN_RUN, one_a_room=True),
        "hob",
    ),
    "DishWashers": Kind(
        fixtures.dishwasher,
        styles("built-in", (0.6, 0.62, 0.88), "steel", "white", "black"),
        Rule(front_m=0.9, relation="run", near=KITCHEN_RUN, one_a_room=True),
        "dish_washer",
    ),
    "Storage": Kind(
        cabinets.storage,
        styles("wardrobe", (1.5, 0.6, 2.05), "white", "oak", "walnut")
        + styles("cupboard", (0.9, 0.5, 1.9), "white", "oak")
        + styles("shelves", (0.9, 0.42, 1.5), "oak", "grey")
        + styles("counter-sink", (1.0, 0.62, 0.9), "white", "sage", "navy")
        + styles("counter-sink-small", (0.8, 0.62, 0.9), "white", "sage", "navy")
        + styles("counter", (0.8, 0.62, 0.9), "white", "sage", "navy")
        + styles("counter-drawers", (0.6, 0.62, 0.9), "white", "sage", "navy")
        + styles("counter-corner", (0.62, 0.62, 0.9), "white", "sage", "navy")
        + styles("pantry", (0.6, 0.62, 2.05), "white", "sage", "navy")
        + styles("shelves compact", (0.6, 0.32, 1.8), "oak", "grey"),
        Rule(prefer="corner", front_m=0.75, relation="run", near=KITCHEN_RUN, counts=(1, 1, 2), limit=3),
        "cupboard",
    ),
    "Toilets": Kind(
        fixtures.toilet,
        styles("close-coupled", (0.38, 0.68, 0.8), "ceramic") + styles("wall-hung", (0.4, 0.66, 1.1), "ceramic"),
        Rule(prefer="corner", front_m=0.6, beside_m=0.15),
        "toilet",
    ),
    "VanityCounters": Kind(
        fixtures.vanity,
        styles("single", (0.85, 0.52, 1.75), "oak", "white", "navy")
        + styles("double", (1.3, 0.52, 1.75), "walnut")
        + styles("single compact", (0.6, 0.46, 1.75), "white", "oak"),
        Rule(front_m=0.7, hides_window=True),
        "basin",
    ),
    "Showers": Kind(
        fixtures.shower,
        styles("cabin", (0.9, 0.9, 2.0), "ceramic")
        + styles("walk-in", (1.2, 0.9, 2.0), "ceramic")
        + styles("cabin compact", (0.75, 0.75, 2.0), "ceramic"),
        Rule(prefer="corner", front_m=0.6),
        "shower",
    ),
    "Baths": Kind(
        fixtures.bath,
        styles("long", (1.7, 0.75, 0.58), "ceramic") + styles("short", (1.5, 0.7, 0.58), "ceramic"),
        Rule(prefer="corner", front_m=0.6),
        "bath",
    ),
    "WashingMachinesAndDryers": Kind(
        fixtures.washing_machine,
        styles("single", (0.6, 0.6, 0.86), "white", "steel") + styles("stacked", (0.6, 0.6, 1.7), "white", "steel"),
        Rule(prefer="corner", front_m=0.75, relation="run", near=KITCHEN_RUN),
        "washer",
    ),
    "Desks": Kind(
        tables.desk,
        styles("wide", (1.4, 0.7, 0.74), "oak", "walnut")
        + styles("narrow", (1.1, 0.6, 0.74), "white")
        + styles("legs", (1.2, 0.6, 0.74), "oak", "white"),
        Rule(front_m=0.9, seat_m=0.5, limit=2),
        "table",
    ),
    "Dressers": Kind(
        cabinets.dresser,
        styles("wide", (1.3, 0.48, 0.82), "oak", "white", "walnut") + styles("tall", (0.8, 0.46, 1.1), "white", "sage"),
        Rule(front_m=0.75, limit=2),
        "drawers",
    ),
    "Bookcases": Kind(
        cabinets.bookcase,
        styles("tall", (0.9, 0.32, 1.9), "oak", "white", "walnut") + styles("low", (1.1, 0.32, 0.9), "oak", "white"),
        Rule(prefer="corner", front_m=0.6, limit=4),
        "shelf",
    ),
    "SideboardsAndBuffets": Kind(
        cabinets.sideboard,
        styles("wide", (1.6, 0.45, 0.85), "oak", "walnut", "sage") + styles("narrow", (1.2, 0.42, 0.85), "white"),
        Rule(prefer="middle", front_m=0.75, limit=2),
        "drawers",
    ),
    "BarCabinets": Kind(
        cabinets.bar_cabinet,
        styles("wide", (1.0, 0.42, 0.95), "walnut", "black") + styles("narrow", (0.75, 0.4, 0.95), "oak"),
        Rule(front_m=0.75),
        "drawers",
    ),
    "CornerCabinets": Kind(
        cabinets.corner_cabinet,
        styles("tall", (0.6, 0.6, 1.8), "white", "walnut", "oak") + styles("low", (0.6, 0.6, 0.85), "sage", "oak"),
        Rule(spot="corner", front_m=0.6, limit=2),
        "corner_cabinet",
    ),
    "KitchenIslandsAndCarts": Kind(
        tables.kitchen_island,
        styles("island", (1.4, 0.8, 0.92), "navy", "sage", "white") + styles("cart", (0.95, 0.55, 0.9), "white", "oak"),
        Rule(spot="open", around_m=0.9, one_a_room=True),
        "island",
    ),
    "ConsoleTables": Kind(
        tables.console_table,
        styles("plain", (1.1, 0.34, 0.8), "oak", "black", "white")
        + styles("drawers", (1.2, 0.38, 0.82), "walnut", "sage"),
        Rule(prefer="middle", front_m=0.5, limit=2),
        "table",
    ),
    "StorageBenches": Kind(
        soft.storage_bench,
        styles("bench", (1.1, 0.42, 0.48), "oak", "white", "walnut"),
        Rule(front_m=0.6, limit=2),
        "ottoman",
    ),
    "Nightstands": Kind(
        tables.nightstand,
        styles("drawers", (0.46, 0.42, 0.52), "oak", "walnut", "white")
        + styles("open", (0.44, 0.4, 0.54), "oak", "walnut", "sage"),
        Rule(relation="beside", near=("Beds",), bound=True, counts=(1, 2, 2), limit=4),
        "drawers",
    ),
    "CoffeeTables": Kind(
        tables.coffee_table,
        styles("long", (1.1, 0.6, 0.42), "oak", "walnut")
        + styles("round", (0.8, 0.8, 0.4), "walnut", "white")
        + styles("chest", (1.0, 0.6, 0.42), "oak", "white"),
        Rule(spot="open", relation="before", near=SEATS, bound=True, gap_m=0.4),
        "table",
    ),
    "DiningChairs": Kind(
        soft.dining_chair,
        styles("upright", (0.44, 0.47, 0.88), "oak", "walnut", "white", "mustard")
        + styles("ladder", (0.43, 0.46, 0.94), "oak", "walnut", "white")
        + styles("shell", (0.46, 0.48, 0.82), "sage", "navy", "mustard"),
        Rule(relation="around", near=("DiningTables",), bound=True, counts=(2, 4, 6), limit=8),
        "chair",
    ),
    "DeskChairs": Kind(
        soft.desk_chair,
        styles("swivel", (0.6, 0.6, 1.0), "black", "grey", "terracotta")
        + styles("task", (0.54, 0.56, 0.92), "navy", "sage"),
        Rule(relation="desk", near=("Desks",), bound=True, limit=2),
        "desk_chair",
    ),
    "LivingRoomChairs": Kind(
        soft.armchair,
        styles("armchair", (0.86, 0.85, 0.84), "grey", "sage", "navy", "mustard", "terracotta")
        + styles("scandi", (0.74, 0.8, 0.82), "grey", "sage", "mustard")
        + styles("tub", (0.76, 0.76, 0.78), "navy", "terracotta", "sage"),
        Rule(
            prefer="corner",
            front_m=0.45,
            relation="gathered",
            near=("CoffeeTables",),
            gap_m=0.46,
            counts=(1, 1, 2),
            limit=3,
        ),
        "sofa",
    ),
    "EndAndSideTables": Kind(
        tables.side_table,
        styles("square", (0.48, 0.48, 0.52), "oak", "walnut") + styles("round", (0.45, 0.45, 0.54), "black", "oak"),
        Rule(relation="beside", near=SEATS, bound=True, limit=3),
        "table",
    ),
    "Ottomans": Kind(
        soft.ottoman,
        styles("square", (0.62, 0.52, 0.42), "sage", "terracotta")
        + styles("round", (0.55, 0.55, 0.42), "mustard", "navy"),
        Rule(relation="before", near=("LivingRoomChairs", "Sofas"), gap_m=0.3, limit=2),
        "ottoman",
    ),
    "FloorLamps": Kind(
        cabinets.floor_lamp,
        styles("shade", (0.38, 0.38, 1.6), "black", "steel") + styles("globe", (0.38, 0.38, 1.55), "black", "mustard"),
        Rule(prefer="corner", relation="beside", near=SEATS, limit=2),
        "lamp",
    ),
    "ServingCarts": Kind(
        tables.serving_cart,
        styles("trolley", (0.72, 0.42, 0.86), "mustard", "oak", "black"),
        Rule(prefer="corner", front_m=0.3),
        "island",
    ),
    # Of more than one size, since grippers open 60 to 120 mm.
    "Ball": Kind(
        soft.ball,
        styles("ball", (0.18, 0.18, 0.18), "terracotta", "navy", "mustard")
        + styles("small-ball", (0.066, 0.066, 0.066), "terracotta", "mustard"),
    ),
    "Book": Kind(soft.book, styles("book", (0.16, 0.23, 0.035), "terracotta", "navy", "sage", "mustard")),
    "Carton": Kind(soft.carton, styles("carton", (0.4, 0.3, 0.26), "oak")),
    "Clothes": Kind(soft.clothes, styles("pullover", (0.3, 0.36, 0.07), "navy", "terracotta", "sage", "mustard")),
    "Cup": Kind(
        soft.cup,
        styles("mug", (0.085, 0.085, 0.095), "white", "navy", "terracotta")
        + styles("tumbler", (0.072, 0.072, 0.12), "white", "sage")
        + styles("espresso", (0.062, 0.062, 0.06), "white", "walnut"),
    ),
    "Plate": Kind(soft.plate, styles("dinner", (0.26, 0.26, 0.022), "white", "sage")),
    "Shoe": Kind(soft.shoe, styles("trainer", (0.1, 0.28, 0.11), "white", "navy", "walnut")),
    "ToyBlock": Kind(
        soft.toy_block,
        styles("block", (0.09, 0.09, 0.09), "terracotta", "mustard", "navy", "sage")
        + styles("small-block", (0.05, 0.05, 0.05), "terracotta", "mustard", "navy", "sage"),
    ),
}

RULES: dict[str, Rule] = {name: kind.rule for name, kind in CATALOGUE.items() if kind.rule}
"""Placement rule of each kind of furniture, in the order in which kinds are placed."""


def styles_of(model_type: str) -> tuple[Style, ...]:
    """Returns all styles (form, size, colours) of a furniture type.

    Raises:
        KeyError: For a kind that is not in the catalogue.
    """
    return CATALOGUE[model_type].styles


IMPORTED = "imported"
"""Style name of a piece that is not from the catalogue.

The form of an imported piece is in its world's MuJoCo model; plans and pictures show its extent.
"""
_IMPORTED_COLOR = (0.62, 0.6, 0.57, 1.0)


def parts_of(item: Furniture) -> tuple[Part, ...]:
    """Returns the parts of a piece of furniture, in its own frame.

    Raises:
        ValueError: When kind or style are not in the catalogue, which means that the piece was written
            by another version of the generator.
    """
    if item.style == IMPORTED:
        center, size = (0.0, 0.0, item.height_m / 2), (item.depth_m, item.width_m, item.height_m)
        return (Part("all", "box", center, size, _IMPORTED_COLOR, solid=True),)
    return _build(item.model_type, item.style)


@lru_cache(maxsize=256)
def _build(model_type: str, style_name: str) -> tuple[Part, ...]:
    if model_type not in CATALOGUE:
        raise ValueError(
            f"model_type {model_type!r}: not in the catalogue; one of {', '.join(sorted(CATALOGUE))} would be right"
        )
    kind = CATALOGUE[model_type]
    for style in kind.styles:
        if style.name == style_name:
            return tuple(kind.build(style))
    names = ", ".join(style.name for style in kind.styles)
    raise ValueError(f"style {style_name!r} of {model_type}: not in the catalogue; one of {names} would be right")
