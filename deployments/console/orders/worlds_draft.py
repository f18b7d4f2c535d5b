"""Form for ordering worlds, and the template body that it makes."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from ....schemas.wire.errors import InvalidParameterException

MOST_ROOMS, MOST_WAYS = 6, 6
RATIOS = {"1:1": (1, 1), "4:3": (4, 3), "3:2": (3, 2), "2:1": (2, 1)}
BY_TYPE = "by type"
"""Choice of a material by the type of the room."""

WAYS = {"doorway": "Doorway", "no wall": "Opening"}
DOORS: Mapping[str, float | str | None] = {"none": None, "open": 100, "half open": 50, "closed": 0, "any": "Random"}
"""How far doors are open; `None`: doorways are gaps."""


@dataclass(frozen=True)
class RoomFields:
    """One room as the form has it."""

    type: str
    name: str
    area: str
    ratio: str = "4:3"
    floor: str = BY_TYPE
    walls: str = BY_TYPE


@dataclass(frozen=True)
class WayFields:
    """A wish for a way between two rooms, which are numbers from 0 of the form's."""

    first: str
    second: str
    kind: str = "doorway"


_FIRST_ROOMS = (
    RoomFields("Living", "Living room", "26", "3:2"),
    RoomFields("Kitchen", "Kitchen", "14"),
    RoomFields("Bedroom", "Bedroom", "16", "1:1"),
)


@dataclass(frozen=True)
class WorldsDraft:
    """Content of the form for ordering worlds."""

    template: str = ""
    """Id of a template that exists; empty: one is made."""

    name: str = "my flat"
    outline: str = "4:3"
    height: str = "2.6"
    plans: str = "2"
    interiors: str = "2"
    seed: str = "7"
    tags: str = ""
    doors: str = "none"
    rooms: tuple[RoomFields, ...] = _FIRST_ROOMS
    ways: tuple[WayFields, ...] = ()
    problems: tuple[str, ...] = ()
    plan: str = ""
    """The drawn plan as an address that holds it; empty: there is none."""

    @property
    def total(self) -> str:
        """How many worlds that makes; empty: no numbers."""
        is_known = self.plans.isdecimal() and self.interiors.isdecimal()
        return str(int(self.plans) * int(self.interiors)) if is_known and len(self.plans + self.interiors) < 8 else ""

    def with_room(self) -> "WorldsDraft":
        """A draft with one room more, if there may be one."""
        more = RoomFields("Bathroom", _free_name(self), "10")
        return replace(self, rooms=(*self.rooms, more)[:MOST_ROOMS])

    def without_room(self, index: int) -> "WorldsDraft":
        """A draft without a room and its ways; the last room stays."""
        if len(self.rooms) < 2 or not 0 <= index < len(self.rooms):
            return self
        kept = [number for number in range(len(self.rooms)) if number != index]
        now = {str(number): str(place) for place, number in enumerate(kept)}
        ways = (way for way in self.ways if way.first in now and way.second in now)
        moved = tuple(replace(way, first=now[way.first], second=now[way.second]) for way in ways)
        return replace(self, rooms=tuple(self.rooms[number] for number in kept), ways=moved)

    def with_way(self) -> "WorldsDraft":
        """A draft with one way more, if there may be one."""
        return replace(self, ways=(*self.ways, WayFields("0", str(min(1, len(self.rooms) - 1))))[:MOST_WAYS])

    def without_way(self, index: int) -> "WorldsDraft":
        """A draft without a way."""
        return replace(self, ways=tuple(way for number, way in enumerate(self.ways) if number != index))


def body_of(draft: WorldsDraft) -> str:
    """The template's body, as JSON text.

    Raises:
        InvalidParameterException: a field holds no number where there has to be one.
    """
    rooms = [
        {
            "Type": room.type,
            "Name": room.name,
            "DesiredShape": {"Area": _number(room.area, f"area of {room.name}"), "AspectRatio": _ratio(room.ratio)},
        }
        for room in draft.rooms
    ]
    plan = {
        "Footprint": {"DesiredAspectRatio": _ratio(draft.outline)},
        "Ceiling": {"Height": _number(draft.height, "ceiling height")},
        "Rooms": rooms,
        "DesiredConnections": [_connection(way, draft.rooms) for way in draft.ways],
    }
    interior: dict[str, Any] = {
        "Flooring": {"MaterialSets": _materials(draft, "floor")},
        "Walls": {"MaterialSets": _materials(draft, "walls")},
    }
    if draft.doors not in DOORS:
        raise InvalidParameterException(f"doors: is {draft.doors!r}; one of {', '.join(DOORS)} would be right")
    if (opening := DOORS[draft.doors]) is not None:
        door = {"InitialState": {"OpenPosition": {"Percent": opening}}}
        interior["Doorways"] = {"DoorwaySets": [{"Name": "all", "TargetSet": "Target.All", "Door": door}]}
    version = "1" if opening is None else "2"  # the first has no doors
    return json.dumps({"Version": version, "Buildings": [{"Floors": [{"Floorplan": plan, "Interior": interior}]}]})


def draft_of(form: Mapping[str, str]) -> WorldsDraft:
    """A draft as a form has it."""
    given = {
        name: form[name][:300]
        for name in ("template", "name", "outline", "height", "doors", "plans", "interiors", "seed", "tags")
        if name in form
    }
    rooms = tuple(RoomFields(**each) for each in _of_list(form, "room", MOST_ROOMS, "type name area ratio floor walls"))
    ways = tuple(WayFields(**each) for each in _of_list(form, "way", MOST_WAYS, "first second kind"))
    return replace(WorldsDraft(rooms=rooms or _FIRST_ROOMS, ways=ways), **given)


def _of_list(form: Mapping[str, str], what: str, most: int, members: str) -> list[dict[str, str]]:
    """Each of some rooms or ways of a form; members that it does not have are left out."""
    first, *others = members.split()
    return [
        {first: form[name][:300]}
        | {each: form[field][:300] for each in others if (field := f"{what}-{index}-{each}") in form}
        for index in range(most)
        if (name := f"{what}-{index}-{first}") in form
    ]


def _connection(way: WayFields, rooms: tuple[RoomFields, ...]) -> dict[str, Any]:
    numbers = [whole(each, "rooms of a way") for each in (way.first, way.second)]
    if max(numbers) >= len(rooms):
        raise InvalidParameterException(f"rooms of a way: there is no room {max(numbers) + 1}")
    return {"Location": [rooms[number].name for number in numbers], "ConnectionType": WAYS.get(way.kind, way.kind)}


def _materials(draft: WorldsDraft, what: str) -> list[dict[str, Any]]:
    """A set for each room whose material is chosen."""
    chosen = [str(getattr(room, what)) for room in draft.rooms]
    return [
        {
            "Name": f"Room {number}",
            "TargetSet": {"RoomNames": [room.name]},
            "SampleSet": {"MaterialTypes": [material]},
        }
        for number, (room, material) in enumerate(zip(draft.rooms, chosen, strict=True), start=1)
        if material != BY_TYPE
    ]


def _free_name(draft: WorldsDraft) -> str:
    taken = {room.name for room in draft.rooms}
    first = len(taken) + 1
    return next(name for number in range(first, first + 9) if (name := f"Room {number}") not in taken)


def _ratio(text: str) -> dict[str, float]:
    x, y = RATIOS.get(text, (1, 1))
    return {"x": float(x), "y": float(y)}


def _number(text: str, what: str) -> float:
    try:
        return float(text.strip().replace(",", "."))
    except ValueError:
        raise InvalidParameterException(f"{what}: is {text!r}; it has to be a number") from None


def whole(text: str, what: str) -> int:
    """A whole number of a field.

    Raises:
        InvalidParameterException: it is none.
    """
    if not (text.strip().isascii() and text.strip().isdecimal() and len(text) <= 12):
        raise InvalidParameterException(f"{what}: is {text!r}; it has to be a whole number from 0")
    return int(text)
