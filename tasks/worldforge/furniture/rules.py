"""Placement rules of furniture, one for each kind."""

from dataclasses import dataclass
from typing import Literal

Relation = Literal["beside", "before", "around", "desk", "facing", "gathered", "run", ""]
Spot = Literal["wall", "corner", "open"]


@dataclass(frozen=True, slots=True)
class Rule:
    """How one kind of furniture is placed.

    Clearances are what people need, from the usual handbooks of ergonomics and kitchen design, metres:
    0.6 to stand and turn before a piece, 0.75 to pull out a drawer or open a wardrobe and stand before it,
    0.9 to work at an appliance with its door open or to push a chair back from a desk, 0.75 around a dining
    table to sit down, 0.5 beside a bed to get up, 0.4 between a sofa and its table for the legs.
    """

    spot: Spot = "wall"
    """Spot for a piece that is placed on its own."""
    prefer: Literal["middle", "corner", "any"] = "any"
    """Preferred part of a wall."""
    front_m: float = 0.0
    """Free space before it, in metres: to get up, to open it, to work at it."""
    beside_m: float = 0.0
    """Free space on both sides, in metres; on one side of a bed for one."""
    around_m: float = 0.0
    """Free space on every side of a piece in the open, in metres."""
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
    one_a_room: bool = False
    """Whether larger rooms get no more of them: a hall is not watched from ten screens."""


KITCHEN_RUN = ("Fridges", "Ovens", "DishWashers", "Storage", "WashingMachinesAndDryers")
"""Kinds of furniture in a kitchen's line."""

SEATS = ("Sofas", "LivingRoomChairs")
"""Seats of a living room."""
