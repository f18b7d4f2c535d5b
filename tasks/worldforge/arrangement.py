"""How each kind of furniture is arranged, and what rooms hold when a template does not say."""

from dataclasses import dataclass
from typing import Literal

from ...schemas.world import RoomType

Relation = Literal["beside", "before", "around", "desk", "facing", "run", ""]
Spot = Literal["wall", "corner", "open"]
Density = Literal["Sparse", "Moderate", "Dense"]


@dataclass(frozen=True, slots=True)
class Rule:
    """How one kind of furniture is placed."""

    spot: Spot = "wall"
    """Where it stands on its own."""
    prefer: Literal["middle", "corner", "any"] = "any"
    """Which part of a wall suits it best."""
    front_m: float = 0.0
    """What stays free before it: to get up, to open it, to stand at it."""
    relation: Relation = ""
    """How it stands to the kinds in `near`, tried before `spot`."""
    near: tuple[str, ...] = ()
    """Kinds it belongs to."""
    gap_m: float = 0.0
    """Distance for `before`."""
    counts: tuple[int, int, int] = (1, 1, 1)
    """Pieces wanted at first in sparse, moderate and dense rooms."""
    limit: int = 1
    """At most so many per 30 m2."""


_KITCHEN_RUN = ("Fridges", "Ovens", "DishWashers", "Storage", "WashingMachinesAndDryers")

# In the order of placing: what rooms are arranged around comes first.
RULES: dict[str, Rule] = {
    "Beds": Rule(prefer="middle", front_m=0.6),
    "MediaStorage": Rule(prefer="middle", front_m=0.5),
    "Sofas": Rule(prefer="middle", front_m=0.5, relation="facing", near=("MediaStorage",), limit=2),
    "DiningTables": Rule(spot="open", front_m=0.55),
    "Fridges": Rule(prefer="corner", front_m=0.7, relation="run", near=_KITCHEN_RUN),
    "Ovens": Rule(prefer="any", front_m=0.75, relation="run", near=_KITCHEN_RUN),
    "DishWashers": Rule(prefer="any", front_m=0.65, relation="run", near=_KITCHEN_RUN),
    "Storage": Rule(prefer="corner", front_m=0.6, relation="run", near=_KITCHEN_RUN, counts=(1, 1, 2), limit=4),
    "Baths": Rule(prefer="corner", front_m=0.5),
    "Showers": Rule(prefer="corner", front_m=0.5),
    "Toilets": Rule(prefer="any", front_m=0.55),
    "VanityCounters": Rule(prefer="any", front_m=0.6),
    "WashingMachinesAndDryers": Rule(prefer="corner", front_m=0.6, relation="run", near=_KITCHEN_RUN),
    "Desks": Rule(prefer="any", front_m=0.7, limit=2),
    "Dressers": Rule(prefer="any", front_m=0.6, limit=2),
    "Bookcases": Rule(prefer="corner", front_m=0.4, limit=4),
    "SideboardsAndBuffets": Rule(prefer="middle", front_m=0.5, limit=2),
    "BarCabinets": Rule(prefer="any", front_m=0.5),
    "CornerCabinets": Rule(spot="corner", front_m=0.4, limit=2),
    "KitchenIslandsAndCarts": Rule(spot="open", front_m=0.7),
    "ConsoleTables": Rule(prefer="middle", limit=2),
    "StorageBenches": Rule(prefer="any", front_m=0.4, limit=2),
    "Nightstands": Rule(relation="beside", near=("Beds",), counts=(1, 2, 2), limit=4),
    "CoffeeTables": Rule(spot="open", relation="before", near=("Sofas", "LivingRoomChairs"), gap_m=0.38),
    "DiningChairs": Rule(relation="around", near=("DiningTables",), counts=(2, 4, 6), limit=8),
    "DeskChairs": Rule(relation="desk", near=("Desks",), limit=2),
    "LivingRoomChairs": Rule(prefer="corner", front_m=0.4, counts=(1, 1, 2), limit=3),
    "EndAndSideTables": Rule(relation="beside", near=("Sofas", "LivingRoomChairs"), limit=3),
    "Ottomans": Rule(prefer="any", relation="before", near=("LivingRoomChairs", "Sofas"), gap_m=0.25, limit=2),
    "FloorLamps": Rule(prefer="corner", relation="beside", near=("Sofas", "LivingRoomChairs"), limit=2),
    "ServingCarts": Rule(prefer="corner"),
}

_ESSENTIAL: dict[RoomType, tuple[str, ...]] = {
    "Bedroom": ("Beds", "Nightstands", "Storage"),
    "Bathroom": ("Toilets", "VanityCounters", "Showers"),
    "Living": ("MediaStorage", "Sofas", "CoffeeTables"),
    "Dining": ("DiningTables", "DiningChairs"),
    "Kitchen": ("Fridges", "Ovens", "Storage"),
    "Hallway": ("ConsoleTables",),
    "Closet": ("Storage",),
}
_USUAL: dict[RoomType, tuple[str, ...]] = {
    "Bedroom": ("Dressers", "Desks", "DeskChairs", "FloorLamps"),
    "Bathroom": ("Baths", "WashingMachinesAndDryers"),
    "Living": ("LivingRoomChairs", "EndAndSideTables", "FloorLamps", "Bookcases"),
    "Dining": ("SideboardsAndBuffets", "BarCabinets", "FloorLamps"),
    "Kitchen": ("DishWashers", "KitchenIslandsAndCarts"),
    "Hallway": ("StorageBenches", "CornerCabinets"),
    "Closet": ("Dressers", "StorageBenches"),
}
_LAVISH: dict[RoomType, tuple[str, ...]] = {
    "Bedroom": ("LivingRoomChairs", "Bookcases", "StorageBenches", "Ottomans"),
    "Bathroom": ("Storage", "StorageBenches"),
    "Living": ("SideboardsAndBuffets", "ConsoleTables", "Ottomans", "BarCabinets", "CornerCabinets"),
    "Dining": ("CornerCabinets", "ServingCarts", "ConsoleTables", "Bookcases"),
    "Kitchen": ("WashingMachinesAndDryers", "ServingCarts", "CornerCabinets"),
    "Hallway": ("Bookcases", "FloorLamps", "Storage"),
    "Closet": ("Bookcases", "Ottomans"),
}

COVERAGE: dict[Density, float] = {"Sparse": 0.0, "Moderate": 0.2, "Dense": 0.34}
"""Share of the floor up to which further pieces are added."""

COVERAGE_CAP: dict[Density, float] = {"Sparse": 0.22, "Moderate": 0.34, "Dense": 0.5}
"""Share of the floor after which only kinds still missing are added."""

MOST_PIECES: dict[Density, int] = {"Sparse": 10, "Moderate": 16, "Dense": 26}
"""Pieces in a room of up to 40 m2; larger ones hold more, in proportion to their sides."""

DENSITIES: tuple[Density, ...] = ("Sparse", "Moderate", "Dense")


def usual_types(room_type: RoomType, density: Density) -> tuple[str, ...]:
    """What a room of this type holds when the template leaves it open."""
    essential = _ESSENTIAL[room_type]
    if density == "Sparse":
        return essential
    usual = essential + _USUAL[room_type]
    return usual if density == "Moderate" else usual + _LAVISH[room_type]


def first_count(model_type: str, density: Density) -> int:
    """How many pieces of one kind a room gets before anything is repeated."""
    return RULES[model_type].counts[DENSITIES.index(density)]


def forms_for(model_type: str, room_type: RoomType, forms: list[str]) -> list[str]:
    """Which forms of a kind suit a room: a kitchen's storage is a counter, a bathroom's is shelves."""
    if model_type != "Storage":
        return forms
    suiting: dict[str, list[str]] = {
        "Kitchen": ["counter-sink", "counter"],
        "Bathroom": ["shelves", "cupboard"],
        "Hallway": ["cupboard", "wardrobe"],
        "Bedroom": ["wardrobe", "cupboard"],
        "Closet": ["wardrobe", "shelves", "cupboard"],
    }
    return suiting.get(room_type, ["cupboard", "shelves"])
