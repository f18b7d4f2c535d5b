"""Arrangement rules for each kind of furniture, and default furniture of rooms."""

from dataclasses import dataclass
from typing import Literal

from ....schemas.worlds.world import RoomType

Relation = Literal["beside", "before", "around", "desk", "facing", "gathered", "run", ""]
Spot = Literal["wall", "corner", "open"]
Density = Literal["Sparse", "Moderate", "Dense"]


@dataclass(frozen=True, slots=True)
class Rule:
    """How one kind of furniture is placed.

    Clearances are what people need, from the usual handbooks of ergonomics and kitchen design, metres:
    0.6 to stand and turn before a piece, 0.75 to pull out a drawer or open a wardrobe and stand before it,
    0.9 to work at an appliance with its door open or to push a chair back from a desk, 0.75 around a dining
    table to sit down, 0.5 beside a bed to get up, 0.4 between a sofa and its table for the legs.
    """

    spot: Spot = "wall"
    """Where it stands on its own."""
    prefer: Literal["middle", "corner", "any"] = "any"
    """Which part of a wall suits it best."""
    front_m: float = 0.0
    """What stays free before it: to get up, to open it, to stand at it."""
    beside_m: float = 0.0
    """What stays free on both sides; on one side of a bed for one."""
    around_m: float = 0.0
    """What stays free on every side of a piece that stands in the open."""
    relation: Relation = ""
    """How it stands to the kinds in `near`, tried before `spot`."""
    near: tuple[str, ...] = ()
    """Kinds it belongs to."""
    bound: bool = False
    """Whether it makes no sense away from those kinds where the room has one."""
    seat_m: float = 0.0
    """How far a chair will stand before it, so that the place must not be at a door."""
    gap_m: float = 0.0
    """Distance for `before` and `gathered`."""
    hides_window: bool = False
    """Whether it never stands before a window, however low it is."""
    counts: tuple[int, int, int] = (1, 1, 1)
    """Pieces wanted at first in sparse, moderate and dense rooms."""
    limit: int = 1
    """At most so many per 30 m2."""


KITCHEN_RUN = ("Fridges", "Ovens", "DishWashers", "Storage", "WashingMachinesAndDryers")
"""What stands in a kitchen's line."""

HALLWAY_WAY_M = 0.9
"""What stays free before everything that stands in a hallway."""

_SEATS = ("Sofas", "LivingRoomChairs")

# In the order of placing: what rooms are arranged around comes first.
RULES: dict[str, Rule] = {
    "Beds": Rule(prefer="middle", front_m=0.6, beside_m=0.5),
    "MediaStorage": Rule(prefer="middle", front_m=0.75, hides_window=True),
    "Sofas": Rule(prefer="middle", front_m=0.5, relation="facing", near=("MediaStorage",), gap_m=0.5, limit=2),
    "DiningTables": Rule(spot="open", around_m=0.75),
    "Fridges": Rule(prefer="corner", front_m=0.9, relation="run", near=KITCHEN_RUN),
    "Ovens": Rule(front_m=0.9, relation="run", near=KITCHEN_RUN),
    "DishWashers": Rule(front_m=0.9, relation="run", near=KITCHEN_RUN),
    "Storage": Rule(prefer="corner", front_m=0.75, relation="run", near=KITCHEN_RUN, counts=(1, 1, 2), limit=3),
    "Toilets": Rule(prefer="corner", front_m=0.6, beside_m=0.15),
    "VanityCounters": Rule(front_m=0.7, hides_window=True),
    "Showers": Rule(prefer="corner", front_m=0.6),
    "Baths": Rule(prefer="corner", front_m=0.6),
    "WashingMachinesAndDryers": Rule(prefer="corner", front_m=0.75, relation="run", near=KITCHEN_RUN),
    "Desks": Rule(front_m=0.9, seat_m=0.5, limit=2),
    "Dressers": Rule(front_m=0.75, limit=2),
    "Bookcases": Rule(prefer="corner", front_m=0.6, limit=4),
    "SideboardsAndBuffets": Rule(prefer="middle", front_m=0.75, limit=2),
    "BarCabinets": Rule(front_m=0.75),
    "CornerCabinets": Rule(spot="corner", front_m=0.6, limit=2),
    "KitchenIslandsAndCarts": Rule(spot="open", around_m=0.9),
    "ConsoleTables": Rule(prefer="middle", front_m=0.5, limit=2),
    "StorageBenches": Rule(front_m=0.6, limit=2),
    "Nightstands": Rule(relation="beside", near=("Beds",), bound=True, counts=(1, 2, 2), limit=4),
    "CoffeeTables": Rule(spot="open", relation="before", near=_SEATS, bound=True, gap_m=0.4),
    "DiningChairs": Rule(relation="around", near=("DiningTables",), bound=True, counts=(2, 4, 6), limit=8),
    "DeskChairs": Rule(relation="desk", near=("Desks",), bound=True, limit=2),
    "LivingRoomChairs": Rule(
        prefer="corner",
        front_m=0.45,
        relation="gathered",
        near=("CoffeeTables",),
        gap_m=0.46,
        counts=(1, 1, 2),
        limit=3,
    ),
    "EndAndSideTables": Rule(relation="beside", near=_SEATS, bound=True, limit=3),
    "Ottomans": Rule(relation="before", near=("LivingRoomChairs", "Sofas"), gap_m=0.3, limit=2),
    "FloorLamps": Rule(prefer="corner", relation="beside", near=_SEATS, limit=2),
    "ServingCarts": Rule(prefer="corner", front_m=0.3),
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
    "Bedroom": ("Dressers", "Desks", "DeskChairs"),
    "Bathroom": ("Baths",),
    "Living": ("LivingRoomChairs", "EndAndSideTables", "FloorLamps"),
    "Dining": ("SideboardsAndBuffets", "FloorLamps"),
    "Kitchen": ("DishWashers", "KitchenIslandsAndCarts"),
    "Hallway": ("StorageBenches", "CornerCabinets"),
    "Closet": ("Dressers", "StorageBenches"),
}
_LAVISH: dict[RoomType, tuple[str, ...]] = {
    "Bedroom": ("LivingRoomChairs", "Bookcases", "StorageBenches", "Ottomans", "FloorLamps"),
    "Bathroom": ("WashingMachinesAndDryers", "Storage", "StorageBenches"),
    "Living": ("Bookcases", "SideboardsAndBuffets", "ConsoleTables", "Ottomans", "BarCabinets", "CornerCabinets"),
    "Dining": ("BarCabinets", "CornerCabinets", "ServingCarts", "ConsoleTables", "Bookcases"),
    "Kitchen": ("WashingMachinesAndDryers", "ServingCarts", "CornerCabinets"),
    "Hallway": ("Storage", "Bookcases"),
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


def front_of(model_type: str, room_type: RoomType) -> float:
    """What stays free before a piece in a room of this type."""
    front = RULES[model_type].front_m
    return max(front, HALLWAY_WAY_M) if room_type == "Hallway" else front


def forms_for(model_type: str, room_type: RoomType, forms: list[str]) -> list[str]:
    """Which forms of a kind suit a room: a kitchen's storage is a counter, a bathroom's is shelves.

    All forms where the catalogue has none of the suiting ones.
    """
    if model_type != "Storage":
        return forms
    counters = [form for form in forms if form.startswith("counter")]
    if room_type == "Kitchen":
        return counters or forms
    suiting: dict[str, list[str]] = {
        "Bathroom": ["shelves", "cupboard"],
        "Hallway": ["cupboard", "wardrobe"],
        "Bedroom": ["wardrobe", "cupboard"],
        "Closet": ["wardrobe", "shelves", "cupboard"],
    }
    wanted = suiting.get(room_type, ["cupboard", "shelves"])
    return [form for form in forms if form in wanted] or [form for form in forms if form not in counters] or forms
