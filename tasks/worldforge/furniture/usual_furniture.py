"""Furniture of rooms for which a template names none: the types that a room of a type and size gets, and forms."""

from collections.abc import Sequence
from typing import Literal

from ....schemas.worlds.world import Room, RoomType
from .catalogue import COMPACT, SEATS
from .catalogue import KITCHEN_RUN as KITCHEN_RUN
from .catalogue import RULES as RULES
from .catalogue import Rule as Rule

Density = Literal["Sparse", "Moderate", "Dense"]


HALLWAY_WAY_M = 0.9
"""Free space before every piece in a hallway, in metres."""

BALCONY_SET = ("EndAndSideTables", "DiningChairs")
"""Kinds of furniture of a balcony: a small table between two chairs, which look alike inside and outside."""

_ESSENTIAL: dict[RoomType, tuple[str, ...]] = {
    "Bedroom": ("Beds", "Nightstands", "Storage"),
    "Bathroom": ("Toilets", "VanityCounters", "Showers"),
    "Living": ("MediaStorage", "Sofas", "CoffeeTables"),
    "Dining": ("DiningTables", "DiningChairs"),
    "Kitchen": ("Fridges", "Ovens", "Storage"),
    "Hallway": ("ConsoleTables",),
    "Closet": ("Storage",),
    "Office": ("Desks", "DeskChairs", "Bookcases"),
    "Storage": ("Storage", "Bookcases"),
    "Balcony": BALCONY_SET,
}
_USUAL: dict[RoomType, tuple[str, ...]] = {
    "Bedroom": ("Dressers", "Desks", "DeskChairs"),
    "Bathroom": ("Baths",),
    "Living": ("LivingRoomChairs", "EndAndSideTables", "FloorLamps"),
    "Dining": ("SideboardsAndBuffets", "FloorLamps"),
    "Kitchen": ("DishWashers", "KitchenIslandsAndCarts"),
    "Hallway": ("StorageBenches", "CornerCabinets"),
    "Closet": ("Dressers", "StorageBenches"),
    "Office": ("SideboardsAndBuffets", "FloorLamps"),
    "Storage": ("WashingMachinesAndDryers",),
    "Balcony": ("StorageBenches",),
}
_LAVISH: dict[RoomType, tuple[str, ...]] = {
    "Bedroom": ("LivingRoomChairs", "Bookcases", "StorageBenches", "Ottomans", "FloorLamps"),
    "Bathroom": ("WashingMachinesAndDryers", "Storage", "StorageBenches"),
    "Living": ("Bookcases", "SideboardsAndBuffets", "ConsoleTables", "Ottomans", "BarCabinets", "CornerCabinets"),
    "Dining": ("BarCabinets", "CornerCabinets", "ServingCarts", "ConsoleTables", "Bookcases"),
    "Kitchen": ("WashingMachinesAndDryers", "ServingCarts", "CornerCabinets"),
    "Hallway": ("Storage", "Bookcases"),
    "Closet": ("Bookcases", "Ottomans"),
    "Office": ("LivingRoomChairs", "EndAndSideTables", "Storage"),
    "Storage": ("Dressers", "StorageBenches"),
    "Balcony": ("Ottomans",),
}

_DINING = ("DiningTables", "DiningChairs")
_LARGE: dict[RoomType, tuple[tuple[float, tuple[str, ...]], ...]] = {
    "Living": ((30.0, ("Desks", "DeskChairs", "Bookcases")), (45.0, _DINING)),
    "Kitchen": ((20.0, _DINING),),
}
"""Smallest floor area (m2) from which a room also gets a work corner, a reading corner or a dining table."""

_DINES_FROM_M2 = 16.0
"""Smallest floor area of a living room with a dining table beside sofa and television, in square metres."""

FIRST: dict[RoomType, tuple[str, ...]] = {"Bathroom": ("Showers", "VanityCounters", "Toilets", "Baths")}
"""Furniture that is placed before all other, by room type: otherwise a bathroom might get only cupboards."""

SPARE: dict[RoomType, tuple[str, ...]] = {
    "Bathroom": ("Bookcases", "Dressers"),
    "Dining": ("StorageBenches", "LivingRoomChairs", "Storage"),
    "Kitchen": ("SideboardsAndBuffets", "StorageBenches", "ConsoleTables"),
    "Living": ("StorageBenches", "Storage", "ServingCarts", "Dressers"),
}
"""Additional furniture of dense rooms that the usual pieces leave too empty, mostly shallow, for short walls."""

INDISPENSABLE: dict[RoomType, tuple[str, ...]] = {
    "Bathroom": ("Toilets",),
    "Bedroom": ("Beds",),
    "Kitchen": ("Ovens",),
    "Living": SEATS,
    "Office": ("Desks",),
    "Storage": ("Storage", "Bookcases"),
}
"""Essential furniture by room type; one of several listed kinds is enough."""

SMALL_ROOM_NEEDS: dict[RoomType, tuple[tuple[str, ...], ...]] = {
    "Bathroom": (("Toilets",), ("Showers", "Baths"), ("VanityCounters",)),
    "Bedroom": (("Beds",),),
    "Closet": (("Storage", "Bookcases", "Dressers"),),
    "Dining": (("DiningTables",),),
    "Kitchen": (("Ovens",), ("Storage",), ("Fridges",)),
    "Living": (SEATS,),
    "Office": (("Desks",), ("DeskChairs",), ("Bookcases", "Storage")),
    "Storage": (("Storage", "Bookcases"),),
    "Balcony": (("EndAndSideTables",), ("DiningChairs",)),
}
"""Essential furniture of small rooms by room type; a room needs one kind of each group."""


DENSITIES: tuple[Density, ...] = ("Sparse", "Moderate", "Dense")


def dining_room(rooms: Sequence[Room]) -> str | None:
    """Returns the name of the largest living room, which then has the dining table; `None` if none has to have it.

    It is `None` if there is a dining room or a large kitchen, no kitchen, or no living room that is large enough.
    """
    kitchens = [room.floor_m2 for room in rooms if room.type == "Kitchen"]
    living = [room for room in rooms if room.type == "Living" and room.floor_m2 >= _DINES_FROM_M2]
    if not kitchens or not living or max(kitchens) >= _LARGE["Kitchen"][0][0] or "Dining" in {r.type for r in rooms}:
        return None
    return max(living, key=lambda room: room.floor_m2).name


def usual_types(
    room_type: RoomType, density: Density, floor_m2: float = 0.0, *, dines: bool = False
) -> tuple[str, ...]:
    """Returns the usual furniture types for a room.

    Args:
        room_type: Type of the room.
        density: Preferred density of furniture.
        floor_m2: Floor area in square metres.
        dines: Whether people dine in it for want of a dining room.
    """
    essential = _ESSENTIAL[room_type]
    if density == "Sparse":
        return essential
    usual = essential + _USUAL[room_type]
    for from_m2, more in _LARGE.get(room_type, ()):
        if floor_m2 >= from_m2:
            usual += more
    usual += _DINING if dines else ()
    return usual if density == "Moderate" else usual + _LAVISH[room_type]


def first_count(model_type: str, density: Density) -> int:
    """Returns how many pieces of one furniture type a room gets in the first round of placing."""
    return RULES[model_type].counts[DENSITIES.index(density)]


def front_of(model_type: str, room_type: RoomType) -> float:
    """Returns the free space that a piece of furniture needs in front of it, in metres."""
    front = RULES[model_type].front_m
    return max(front, HALLWAY_WAY_M) if room_type == "Hallway" else front


def forms_for(model_type: str, room_type: RoomType, forms: list[str]) -> list[str]:
    """Returns the forms of a furniture type that suit a room, of those given; all forms if none does."""
    if model_type != "Storage":
        return forms
    counters = [form for form in forms if form.startswith("counter")]
    if room_type == "Kitchen":
        # Corners and tall cupboards have their places in the line.
        return [form for form in counters if form != "counter-corner"] or forms
    suiting: dict[str, list[str]] = {
        "Bathroom": ["shelves", "cupboard"],
        "Hallway": ["cupboard", "wardrobe"],
        "Bedroom": ["wardrobe", "cupboard"],
        "Closet": ["wardrobe", "shelves", "cupboard"],
        "Storage": ["shelves", "cupboard"],
    }
    wanted = suiting.get(room_type, ["cupboard", "shelves"])
    return (
        [form for form in forms if form.removesuffix(COMPACT) in wanted]
        or [form for form in forms if form not in counters]
        or forms
    )
