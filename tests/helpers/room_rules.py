"""Rules that an architect holds rooms to, and the places of a world that break them.

Each rule reads the world alone and measures with its own rectangles: none asks the code that places furniture.
`tests/endurance/room_rules.py` counts over many worlds.
"""

import math
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from prefect_robomaker.schemas.templates.body import WorldTemplateBody
from prefect_robomaker.schemas.worlds.world import Furniture, Passage, Point, Room, Wall, World
from prefect_robomaker.tasks.worldforge.model.mjcf import world_mjcf

Box = tuple[float, float, float, float]

WINDOW_WALL_M = 1.4
"""Length of outer wall, between the middles of the walls at its ends, that has place for a small window."""
DOUBLE_BED_M, DOUBLE_BED_FROM_M2 = 1.4, 12.0
BESIDE_BED_M, ALONG_BED_M = 0.5, 0.45
FRONT_M = 0.6
TILT_DEG = 15.0
TABLE_TO_KITCHEN_M = 4.0
TABLE_HALF_M = 1.3
"""Distance from a table's middle to chairs that are pushed back."""
ZONED_FROM_M2 = 30.0
DOOR_M = 0.8
"""Nothing stands nearer before a door."""
OPENING_M = 0.5
"""The same before an opening."""
ALMOST = 0.9
DENSE_SHARES = {
    "Bathroom": (0.30, 14.0),
    "Bedroom": (0.34, 30.0),
    "Closet": (0.27, 12.0),
    "Dining": (0.30, 16.0),
    "Hallway": (0.23, 10.0),
    "Kitchen": (0.29, 14.0),
    "Living": (0.31, 24.0),
    "Office": (0.28, 14.0),
    "Storage": (0.29, 12.0),
    "Balcony": (0.18, 8.0),
}
"""Share of the floor under furniture in dense rooms of up to so many square metres; larger ones have less."""
TOUCHING_M = 0.02

OPENED = (
    "BarCabinets", "CornerCabinets", "DishWashers", "Dressers", "Fridges", "MediaStorage", "Ovens",
    "SideboardsAndBuffets", "Storage", "WashingMachinesAndDryers",
)  # fmt: skip
"""Kinds with doors or drawers at their front."""
NO_FRONT = "counter-corner"
"""A counter in the corner of a kitchen that is worktop only."""
LINE = ("Fridges", "Ovens", "DishWashers", "Storage", "WashingMachinesAndDryers")
ZONES: Mapping[str, tuple[str, ...]] = {
    "seats": ("CoffeeTables",),
    "table": ("DiningTables",),
    "work": ("Desks",),
    "sleep": ("Beds",),
}
FORMS = ("line", "L", "U", "island")


@dataclass(frozen=True)
class Case:
    """A world with the template that it was made from."""

    body: WorldTemplateBody
    world: World

    def of(self, kind: str, room: str | None = None) -> list[Furniture]:
        """Furniture of a kind, in one room or all."""
        return [one for one in self.fixed if one.model_type == kind and room in (None, one.room)]

    @cached_property
    def fixed(self) -> list[Furniture]:
        """Furniture, without loose objects."""
        return [one for one in self.world.furniture if not one.movable]

    @cached_property
    def walls(self) -> list[Box]:
        """Floor under walls."""
        return [_wall_box(wall) for wall in self.world.floorplan.walls if not wall.lintel]

    def free_rooms(self, kind: str) -> list[Room]:
        """Rooms of a type whose furniture the template leaves open."""
        named = {
            name
            for one in self.body.interior.Furniture.FurnitureArrangements
            if one.SampleSet is not None
            for name in getattr(one.TargetSet, "RoomNames", None) or ()
        }
        return [room for room in self.world.floorplan.rooms if room.type == kind and room.name not in named]


def _wall_box(wall: Wall) -> Box:
    half = wall.thickness_m / 2
    return _strip(wall.start, wall.end, half, 0.0)


def _strip(start: Point, end: Point, aside: float, beyond: float) -> Box:
    """A line's surroundings."""
    (x0, x1), (y0, y1) = sorted((start[0], end[0])), sorted((start[1], end[1]))
    along_x = x1 - x0 > y1 - y0
    wide, tall = (beyond, aside) if along_x else (aside, beyond)
    return x0 - wide, y0 - tall, x1 + wide, y1 + tall


def _at(item: Furniture, forward: tuple[float, float], left: tuple[float, float]) -> Box:
    """A rectangle given in the frame of a piece that stands square."""
    c, s = round(math.cos(item.yaw)), round(math.sin(item.yaw))
    corners = [(item.x + c * f - s * k, item.y + s * f + c * k) for f in forward for k in left]
    xs, ys = zip(*corners, strict=True)
    return min(xs), min(ys), max(xs), max(ys)


def box_of(item: Furniture) -> Box:
    """The floor that a piece covers."""
    return _at(item, (-item.depth_m / 2, item.depth_m / 2), (-item.width_m / 2, item.width_m / 2))


def _hit(one: Box, other: Box) -> bool:
    return min(one[2], other[2]) - max(one[0], other[0]) > TOUCHING_M and (
        min(one[3], other[3]) - max(one[1], other[1]) > TOUCHING_M
    )


def bath_windows(case: Case) -> Iterator[str]:
    """Each bathroom with place for a window in an outer wall has one."""
    lit = {window.room for window in case.world.floorplan.windows}
    for room in case.world.floorplan.rooms:
        walls = [wall for wall in case.world.floorplan.walls if wall.exterior and wall.rooms == [room.name]]
        if (
            room.type == "Bathroom"
            and room.name not in lit
            and any(math.dist(w.start, w.end) >= WINDOW_WALL_M for w in walls)
        ):
            yield f"{room.name} has an outer wall and no window"


def double_beds(case: Case) -> Iterator[str]:
    """Each bedroom of 12 m2 has a bed for two."""
    for room in case.free_rooms("Bedroom"):
        beds = case.of("Beds", room.name)
        if room.floor_m2 >= DOUBLE_BED_FROM_M2 and not any(bed.width_m >= DOUBLE_BED_M for bed in beds):
            yield f"{room.name} of {room.floor_m2:.1f} m2 has {[bed.style for bed in beds]}"


def nightstands(case: Case) -> Iterator[str]:
    """Each bed has a nightstand if 0.5 m are free at one side of its head."""
    rooms = {room.name for room in case.free_rooms("Bedroom")}
    for bed in case.of("Beds"):
        if bed.room not in rooms:
            continue
        back, half = -bed.depth_m / 2, bed.width_m / 2
        sides = [
            _at(bed, (back, back + ALONG_BED_M), span)
            for span in ((half, half + BESIDE_BED_M), (-half - BESIDE_BED_M, -half))
        ]
        stands = [box_of(stand) for stand in case.of("Nightstands", bed.room)]
        if any(_hit(side, stand) for side in sides for stand in stands):
            continue
        if any(_is_free(case, side, bed) for side in sides):
            yield f"{bed.id} in {bed.room} has no nightstand"


def _is_free(case: Case, box: Box, *owners: Furniture) -> bool:
    """Whether neither walls, furniture nor doors need a rectangle."""
    passages = case.world.floorplan.passages
    taken = [*case.walls, *(box_of(one) for one in case.fixed if one not in owners)]
    taken += [_strip(one.start, one.end, DOOR_M, 0.0) for one in passages]
    taken += [box for passage in passages for box in _swept(passage)]
    taken.append((-0.56, -0.56, 0.56, 0.56))  # where robots start
    return not any(_hit(box, other) for other in taken)


def _swept(passage: Passage) -> Iterator[Box]:
    if passage.door:
        (x, y), reach = passage.door.hinge, passage.door.leaf_width_m
        yield x - reach, y - reach, x + reach, y + reach


def fronts(case: Case) -> Iterator[str]:
    """Before doors and drawers 0.6 m are free."""
    for item in case.fixed:
        if item.model_type not in OPENED or item.style.startswith(NO_FRONT):
            continue
        half = item.width_m / 2
        before = _at(item, (item.depth_m / 2, item.depth_m / 2 + FRONT_M), (-half, half))
        found = [one.id for one in case.fixed if one is not item and _hit(before, box_of(one))]
        if found or any(_hit(before, wall) for wall in case.walls):
            yield f"{item.id} ({item.style}) in {item.room} is blocked by {' and '.join(found) or 'a wall'}"


def desk_chairs(case: Case) -> Iterator[str]:
    """Each desk has a chair at it."""
    rooms = {room.name for kind in ("Bedroom", "Living") for room in case.free_rooms(kind)}
    for desk in case.of("Desks"):
        before = _at(desk, (desk.depth_m / 2 - 0.3, desk.depth_m / 2 + 0.6), (-desk.width_m / 2, desk.width_m / 2))
        if desk.room in rooms and not any(_hit(before, box_of(chair)) for chair in case.of("DeskChairs", desk.room)):
            yield f"{desk.id} in {desk.room} has no chair"


def screens(case: Case) -> Iterator[str]:
    """Each television has a sofa opposite, within 15 degrees of its axis."""
    rooms = {room.name for room in case.free_rooms("Living")}
    for screen in case.of("MediaStorage"):
        found = [abs(_tilt_deg(screen, sofa)) for sofa in case.of("Sofas", screen.room)]
        if screen.room in rooms and min(found, default=math.inf) > TILT_DEG:
            yield f"{screen.id} in {screen.room} has no sofa opposite: {[f'{one:.0f}' for one in found]} degrees off"
    for room in rooms:
        if not case.of("MediaStorage", room):
            yield f"{room} has no television"


def _tilt_deg(screen: Furniture, sofa: Furniture) -> float:
    """Angle between a screen's axis and the way to a sofa that faces it."""
    if math.cos(screen.yaw - sofa.yaw) > -0.9:
        return math.inf
    x, y = sofa.x - screen.x, sofa.y - screen.y
    return math.degrees(math.remainder(math.atan2(y, x) - screen.yaw, 2 * math.pi))


def kitchens(case: Case) -> Iterator[str]:
    """Each kitchen has more than five pieces, a sink and a stove, and worktop between them."""
    for room in case.free_rooms("Kitchen"):
        line = [one for kind in LINE for one in case.of(kind, room.name)]
        pieces = len(line) + len(case.of("KitchenIslandsAndCarts", room.name))
        sinks = [one for one in line if one.style.startswith("counter-sink")]
        stoves = case.of("Ovens", room.name)
        if pieces <= 5:
            yield f"{room.name} of {room.floor_m2:.0f} m2 has {pieces} pieces"
        if not sinks or not stoves:
            yield f"{room.name} has no {'sink' if stoves else 'stove'}"
        elif not _worktop_between(line, sinks[0], stoves[0]):
            yield f"{room.name} has no worktop between sink and stove"


def _worktop_between(line: Sequence[Furniture], sink: Furniture, stove: Furniture) -> bool:
    """Whether the way from sink to stove, piece by piece that touch, is through worktop."""
    tops = [one for one in line if one.height_m < 1.0 and one.model_type != "Ovens" and one is not sink]
    reached: list[Furniture] = [sink]
    plain = {one.id for one in tops if one.style.startswith("counter") and not one.style.startswith("counter-sink")}
    seen = {sink.id: False}
    while reached:
        here = reached.pop()
        near = _grown(box_of(here))
        if _hit(near, box_of(stove)) and seen[here.id]:
            return True
        for one in tops:
            has_top = seen[here.id] or one.id in plain
            if _hit(near, box_of(one)) and (one.id not in seen or (has_top and not seen[one.id])):
                seen[one.id] = has_top
                reached.append(one)
    return False


def _grown(box: Box) -> Box:
    return box[0] - 0.05, box[1] - 0.05, box[2] + 0.05, box[3] + 0.05


def kitchen_form(case: Case, room: Room) -> str:
    """Form of a kitchen: line, L, U, in two lines, or any of them with an island; empty without one."""
    line = [one for kind in LINE for one in case.of(kind, room.name) if one.model_type != "WashingMachinesAndDryers"]
    turns = {round(one.yaw / (math.pi / 2)) % 4 for one in line}
    if len(turns) == 2:
        one, other = turns
        form = "two lines" if (one - other) % 2 == 0 else "L"
    else:
        form = {0: "", 1: "line", 3: "U"}.get(len(turns), "around")
    return form + (" with island" if case.of("KitchenIslandsAndCarts", room.name) else "")


def dining(case: Case) -> Iterator[str]:
    """Each dining table is within 4 m of the kitchen where its room has place there; each dwelling has a table."""
    rooms = case.world.floorplan.rooms
    found = [room for room in rooms if room.type == "Kitchen"]
    if not found:
        return
    tables = case.of("DiningTables")
    if not tables and not any(
        one.DesiredSpatialDensity == "Sparse" for one in case.body.interior.Furniture.FurnitureArrangements
    ):
        yield "no room has a dining table"
    for room in rooms:
        here = [table for table in tables if table.room == room.name]
        nearest = min((_to_room((x, y), kitchen) for kitchen in found for x, y in _spots(room)), default=math.inf)
        for table in here[:1] if nearest <= TABLE_TO_KITCHEN_M - 0.5 else []:
            away = min(_to_room((one.x, one.y), kitchen) for one in here for kitchen in found)
            if away > TABLE_TO_KITCHEN_M:
                yield f"{table.id} in {room.name} is {away:.1f} m from the kitchen, {nearest:.1f} m were possible"


def _spots(room: Room) -> Iterator[Point]:
    """Points of a room at which a table would not touch the walls of its bounding box."""
    x0, y0, x1, y1 = _bounds(room)
    for x in (x0 + TABLE_HALF_M, (x0 + x1) / 2, x1 - TABLE_HALF_M):
        for y in (y0 + TABLE_HALF_M, (y0 + y1) / 2, y1 - TABLE_HALF_M):
            yield x, y


def _bounds(room: Room) -> Box:
    xs, ys = zip(*room.polygon, strict=True)
    return min(xs), min(ys), max(xs), max(ys)


def _to_room(point: Point, room: Room) -> float:
    x0, y0, x1, y1 = _bounds(room)
    return math.hypot(max(x0 - point[0], point[0] - x1, 0.0), max(y0 - point[1], point[1] - y1, 0.0))


def zones(case: Case) -> Iterator[str]:
    """Living rooms and bedrooms over 30 m2 have at least two groups of furniture, and a rug for each seating group."""
    rugs = None
    for room in (room for kind in ("Living", "Bedroom", "Dining") for room in case.free_rooms(kind)):
        if room.floor_m2 <= ZONED_FROM_M2:
            continue
        groups = [name for name, kinds in ZONES.items() for kind in kinds for _ in case.of(kind, room.name)]
        if len(groups) < 2:
            yield f"{room.name} of {room.floor_m2:.0f} m2 has {groups}"
        rugs = world_mjcf(case.world, textured=True) if rugs is None else rugs
        for item in (*case.of("CoffeeTables", room.name), *case.of("Beds", room.name)):
            if f'"rug_{item.id}"' not in rugs:
                yield f"{item.id} in {room.name} of {room.floor_m2:.0f} m2 has no rug"


def density(case: Case) -> Iterator[str]:
    """Rooms for which `Dense` is wished are as full as the documentation says, but for the floor before doors."""
    wished = {
        name
        for one in case.body.interior.Furniture.FurnitureArrangements
        if one.DesiredSpatialDensity == "Dense"
        for name in getattr(one.TargetSet, "RoomNames", None) or ()
    }
    for room in case.world.floorplan.rooms:
        if room.name not in wished:
            continue
        ways = [one for one in case.world.floorplan.passages if room.name in one.rooms]
        kept_m2 = sum(one.width_m * (DOOR_M if one.kind == "Doorway" else OPENING_M) for one in ways)
        covered_m2 = sum(one.width_m * one.depth_m for one in case.fixed if one.room == room.name)
        share, full_m2 = DENSE_SHARES[room.type]
        share *= min(1.0, (full_m2 / room.floor_m2) ** (1 / 3))
        needed_m2 = ALMOST * share * (room.floor_m2 - kept_m2)
        if covered_m2 < needed_m2 - 0.05:
            yield f"{room.name} of {room.floor_m2:.1f} m2 has {covered_m2:.1f} m2 under furniture, not {needed_m2:.1f}"


def loose_objects(case: Case) -> Iterator[str]:
    """Rooms for which `LooseObjects` is wished have as many."""
    lying = Counter(one.room for one in case.world.furniture if one.movable)
    for arrangement in case.body.interior.Furniture.FurnitureArrangements:
        for name in getattr(arrangement.TargetSet, "RoomNames", None) or ():
            if lying[name] < (arrangement.LooseObjects or 0):
                yield f"{name} has {lying[name]} loose objects, not {arrangement.LooseObjects}"


def bathrooms(case: Case) -> Iterator[str]:
    """Each bathroom has a toilet, a basin, and a shower or a bath."""
    for room in case.free_rooms("Bathroom"):
        for kinds in (("Toilets",), ("VanityCounters",), ("Showers", "Baths")):
            if not any(case.of(kind, room.name) for kind in kinds):
                yield f"{room.name} of {room.floor_m2:.1f} m2 has no {' or '.join(kinds)}"


Rule = Callable[[Case], Iterator[str]]
RULES: dict[str, Rule] = {
    rule.__name__: rule
    for rule in (
        bath_windows, double_beds, nightstands, fronts, desk_chairs, screens, kitchens, dining, zones, density,
        loose_objects, bathrooms,
    )
}  # fmt: skip


def is_fine(found: Mapping[str, Sequence[str]], most: int) -> bool:
    """Whether at most so many rules are broken, and every proof holds."""
    return sum(map(len, found.values())) <= most and not found["proofs"]


def broken(case: Case) -> dict[str, list[str]]:
    """Places of a world that break each rule."""
    return {name: list(rule(case)) for name, rule in RULES.items()}


def few_forms(forms: Mapping[str, int]) -> Iterator[str]:
    """Forms of kitchens that fewer than one kitchen in twenty has."""
    total = sum(forms.values())
    for wanted in FORMS:
        count = sum(number for form, number in forms.items() if wanted in form.split())
        if count < total / 20:
            yield f"{count} of {total} kitchens have the form {wanted}"


def same_pieces(kitchens: Mapping[tuple[str, ...], int]) -> Iterator[str]:
    """Whether more than half of the kitchens have the same pieces."""
    total = sum(kitchens.values())
    for pieces, count in Counter(kitchens).most_common(1):
        if count > total / 2:
            yield f"{count} of {total} kitchens have the same pieces: {', '.join(pieces)}"


def kitchens_of(case: Case) -> Iterator[tuple[str, tuple[str, ...]]]:
    """Form of each kitchen, and its pieces in the order of their names."""
    for room in case.free_rooms("Kitchen"):
        line = [one for kind in (*LINE, "KitchenIslandsAndCarts") for one in case.of(kind, room.name)]
        yield (
            kitchen_form(case, room),
            tuple(
                sorted(
                    f"{one.model_type} {one.style.split()[0]}" if one.model_type == "Storage" else one.model_type
                    for one in line
                )
            ),
        )


def template(
    rooms: Sequence[tuple[str, str, float]], *furniture: dict[str, Any], version: str = "2"
) -> WorldTemplateBody:
    """A template of rooms given as name, type and area, 4:3 each, with furniture arrangements."""
    wished = [
        {"Name": name, "Type": kind, "DesiredShape": {"Area": area, "AspectRatio": {"x": 4.0, "y": 3.0}}}
        for name, kind, area in rooms
    ]
    doors = {"Name": "all", "TargetSet": "Target.All", "Door": {"InitialState": {"OpenPosition": {"Percent": 50}}}}
    interior: dict[str, Any] = {"Furniture": {"FurnitureArrangements": list(furniture)}}
    if version == "2":
        interior["Doorways"] = {"DoorwaySets": [doors]}
    plan = {"Footprint": {"DesiredAspectRatio": {"x": 4.0, "y": 3.0}}, "Rooms": wished}
    return WorldTemplateBody.model_validate(
        {"Version": version, "Buildings": [{"Floors": [{"Floorplan": plan, "Interior": interior}]}]}
    )


def dense(*names: str, loose: int | None = None) -> dict[str, Any]:
    """A wish for dense furniture in rooms, and for loose objects."""
    made: dict[str, Any] = {"Name": "dense", "TargetSet": {"RoomNames": list(names)}, "DesiredSpatialDensity": "Dense"}
    return made if loose is None else made | {"LooseObjects": loose}


FLAT = (
    ("Living", "Living", 24.0),
    ("Kitchen", "Kitchen", 12.0),
    ("Bedroom", "Bedroom", 14.0),
    ("Bath", "Bathroom", 10.0),
)
HOUSE = (
    ("Living", "Living", 32.0), ("Kitchen", "Kitchen", 16.0), ("Dining", "Dining", 16.0),
    ("Bedroom", "Bedroom", 18.0), ("Guests", "Bedroom", 13.0), ("Bath", "Bathroom", 10.0),
)  # fmt: skip
LOFT = (
    ("Loft", "Living", 52.0),
    ("Kitchen", "Kitchen", 22.0),
    ("Bedroom", "Bedroom", 20.0),
    ("Bath", "Bathroom", 12.0),
)
TEMPLATES: dict[str, WorldTemplateBody] = {
    "flat": template(FLAT),
    "flat, dense, without doors": template(FLAT, dense(*(name for name, _, _ in FLAT)), version="1"),
    "house": template(HOUSE),
    "house, dense": template(HOUSE, dense(*(name for name, _, _ in HOUSE))),
    "loft, 40 loose objects": template(LOFT, dense("Loft", "Bedroom", loose=40)),
}
"""Templates whose worlds are counted."""
