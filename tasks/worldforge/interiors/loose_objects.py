"""Places small loose objects: free bodies at rest on the floor, on tables, desks and nightstands."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from math import cos, hypot, pi, sin

from ....schemas.worlds.world import Furniture, Point, RoomType, contains
from ..furniture.catalogue import parts_of, styles_of
from ..furniture.placed_parts import height_at
from ..furniture.usual_furniture import Density
from ..geometry.boxes import Box, box_of, pose_of
from ..geometry.parts import Style
from .candidate_poses import against_walls, sits_at
from .room_furnishing import RoomFurnishing

MOST_LOOSE = 12
"""Limit of loose objects per world: moving bodies take most of a simulation's time."""

_ON_TOP: dict[str, tuple[str, ...]] = {
    "CoffeeTables": ("Cup", "Book"),
    "Desks": ("Book", "Cup"),
    "EndAndSideTables": ("Cup",),
    "KitchenIslandsAndCarts": ("Plate", "Cup"),
    "Nightstands": ("Book", "Cup"),
}
_ON_MORE_TOPS: dict[str, tuple[str, ...]] = {
    **_ON_TOP,
    "Bookcases": ("Book", "Cup"),
    "ConsoleTables": ("Book", "Cup"),
    "DishWashers": ("Cup", "Plate"),
    "DiningTables": ("Cup", "Plate", "Book"),
    "Dressers": ("Book", "Cup"),
    "SideboardsAndBuffets": ("Plate", "Cup"),
    "Storage": ("Cup", "Plate"),
    "StorageBenches": ("Book", "Clothes"),
    "VanityCounters": ("Cup",),
}
"""Kinds of graspable objects by the furniture that carries them, where a template requests loose objects."""

_HIGHEST_TOP_M = 1.2
_MOST_MISSES = 6
"""Number of consecutive objects without a place on the floor after which a room counts as full."""

_ON_FLOOR: dict[RoomType, tuple[str, ...]] = {
    "Bedroom": ("Clothes", "Shoe", "ToyBlock", "Clothes"),
    "Bathroom": ("Clothes",),
    "Living": ("Ball", "ToyBlock", "ToyBlock", "Book"),
    "Dining": ("ToyBlock", "Ball"),
    "Kitchen": ("Carton",),
    "Hallway": ("Shoe", "Shoe", "Carton"),
    "Closet": ("Carton", "Shoe", "Clothes"),
    "Office": ("Book", "Carton"),
    "Storage": ("Carton", "Carton", "Ball"),
    "Balcony": ("Shoe", "Ball"),
}
_MORE_ON_FLOOR: dict[RoomType, tuple[str, ...]] = {
    "Bathroom": ("Clothes", "ToyBlock", "Shoe"),
    "Kitchen": ("ToyBlock", "Carton", "Ball"),
    "Hallway": ("Shoe", "ToyBlock", "Carton", "Ball"),
}
"""Kinds of objects on the floor by room type, where a template requests more than fit on furniture."""

_SMALLEST = ("ToyBlock",)
"""Kinds of loose objects that still fit where others do not."""

_ANCHORS: dict[str, tuple[str, ...]] = {
    "Clothes": ("Beds", "Storage", "Dressers"),
    "ToyBlock": ("CoffeeTables", "Beds"),
    "Ball": ("CoffeeTables",),
    "Book": ("Bookcases", "Sofas"),
}
"""Kinds of furniture near which each kind of object is put on the floor."""

_BY_A_WALL = ("Carton", "Shoe")

_ON_FLOOR_COUNTS: dict[Density, int] = {"Sparse": 0, "Moderate": 1, "Dense": 3}
_ON_TOP_CHANCES: dict[Density, float] = {"Sparse": 0.25, "Moderate": 0.5, "Dense": 0.8}
_PLACES_LAID: dict[Density, int] = {"Sparse": 0, "Moderate": 2, "Dense": 4}
_TRIES = 12
_MANY_TRIES = 60
_ANCHOR_REACH_M = 0.9
_SHOE_GAP_M = 0.02
_APART_M = 0.02
"""Smallest gap between loose objects on one table, in metres."""


def scatter(furnished: RoomFurnishing, room_for: int, *, fill: bool = False) -> list[Furniture]:
    """Adds loose objects (cups, books, toys, ...) to a furnished room.

    Args:
        furnished: The room with its furniture; the objects' places are taken in its space.
        room_for: Largest number of objects in the room.
        fill: Whether it gets as many, where there is place for them.

    Returns:
        The objects, all at rest: nothing leans, nothing overhangs.
    """
    objects: list[Furniture] = []
    for table in furnished.placed("DiningTables"):
        objects += _table_setting(table, furnished)[: room_for - len(objects)]
    chance = _ON_TOP_CHANCES[furnished.density]
    for host in [item for item in furnished.items if item.model_type in _ON_TOP]:
        if len(objects) < room_for and furnished.dice.random() < chance:
            kind = furnished.dice.choice(_ON_TOP[host.model_type])
            objects += _object_on_top(host, kind, furnished, objects)
    for _ in range(_ON_FLOOR_COUNTS[furnished.density]):
        if len(objects) < room_for:
            objects += _objects_on_floor(furnished, _ON_FLOOR[furnished.room.type])
    if fill:
        _fill(furnished, room_for, objects)
    return objects[:room_for]


def _fill(furnished: RoomFurnishing, room_for: int, objects: list[Furniture]) -> None:
    """Adds the requested number of loose objects, as far as there is place.

    They are put on furniture in turn, and the rest on the floor.
    """
    hosts = [item for item in furnished.items if item.model_type in _ON_MORE_TOPS]
    while hosts and len(objects) < room_for:
        having: list[Furniture] = []
        for host in hosts:
            kind = furnished.dice.choice(_ON_MORE_TOPS[host.model_type])
            more = _object_on_top(host, kind, furnished, objects) if len(objects) < room_for else []
            objects += more
            having += [host] if more else []
        hosts = having
    corners, misses = furnished.space.beside_ways(), 0
    while len(objects) < room_for and misses < _MOST_MISSES:
        kinds = _MORE_ON_FLOOR.get(furnished.room.type, _ON_FLOOR[furnished.room.type])
        more = _objects_on_floor(furnished, _SMALLEST if misses else kinds, corners)
        objects += more
        misses = 0 if more else misses + 1


def _style(kind: str, furnished: RoomFurnishing) -> Style:
    return furnished.dice.choice(styles_of(kind))


def _table_setting(table: Furniture, furnished: RoomFurnishing) -> list[Furniture]:
    """Returns a plate and a cup in front of each of the first chairs at a table, without those that find no place."""
    laid: list[Furniture] = []
    plate, cup = _style("Plate", furnished), _style("Cup", furnished)
    chairs = [chair for chair in furnished.placed("DiningChairs") if sits_at(chair, table)]
    parts = parts_of(table)
    for chair in chairs[: _PLACES_LAID[furnished.density]]:
        seat = pose_of(chair)
        # The chair's front edge is under the table; the plate lies a little behind the table's edge.
        for kind, style, forward, left in (("Plate", plate, 0.13, 0.0), ("Cup", cup, 0.2, -0.2)):
            spot = seat.moved(chair.depth_m / 2 + forward, left)
            local = _in_frame(table, spot.x, spot.y)
            half = style.width_m / 2
            base = height_at(parts, (local[0] - half, local[1] - half, local[0] + half, local[1] + half))
            if base is not None and not any(
                hypot(spot.x - other.x, spot.y - other.y) < half + other.width_m / 2 + _APART_M for other in laid
            ):
                laid.append(_thing(kind, style, furnished, (spot.x, spot.y, chair.yaw), table.base_m + base))
    return laid


def _in_frame(host: Furniture, x: float, y: float) -> tuple[float, float]:
    """Converts a point to the frame of a piece of furniture: forward, left."""
    c, s = cos(host.yaw), sin(host.yaw)
    return (x - host.x) * c + (y - host.y) * s, (y - host.y) * c - (x - host.x) * s


def _object_on_top(host: Furniture, kind: str, furnished: RoomFurnishing, there: list[Furniture]) -> list[Furniture]:
    """Places an object on a furnishing, beside decoration and objects that are already there.

    Returns a list of that object, or an empty one if no free place was found.
    """
    dice, style, parts = furnished.dice, _style(kind, furnished), parts_of(host)
    for _ in range(_TRIES):
        turn = dice.uniform(-0.3, 0.3)
        reach_x, reach_y = _half_extents(style, turn)
        slack_x, slack_y = host.depth_m / 2 - reach_x - 0.02, host.width_m / 2 - reach_y - 0.02
        if slack_x <= 0 or slack_y <= 0:
            return []
        forward, left = dice.uniform(-slack_x, slack_x), dice.uniform(-slack_y, slack_y)
        base = height_at(parts, (forward - reach_x, left - reach_y, forward + reach_x, left + reach_y))
        # Not on a wardrobe, which would be no place for eyes or hands.
        if base is not None and base < _HIGHEST_TOP_M:
            spot = pose_of(host).moved(forward, left)
            half = hypot(style.width_m, style.depth_m) / 2 + _APART_M
            if any(hypot(o.x - spot.x, o.y - spot.y) < half + hypot(o.width_m, o.depth_m) / 2 for o in there):
                continue
            return [_thing(kind, style, furnished, (spot.x, spot.y, host.yaw + turn), host.base_m + base)]
    return []


def _half_extents(style: Style, turn: float) -> tuple[float, float]:
    c, s = abs(cos(turn)), abs(sin(turn))
    return (style.depth_m * c + style.width_m * s) / 2, (style.depth_m * s + style.width_m * c) / 2


def _objects_on_floor(
    furnished: RoomFurnishing, kinds: Sequence[str], corners: Sequence[Point] = ()
) -> list[Furniture]:
    """Places an object, or a pair of shoes, at a free spot on the floor that does not block robots' paths.

    Args:
        furnished: The room; the spot is taken in it from then on.
        kinds: Kinds of objects, one of which is chosen.
        corners: Spots beside the paths of robots, for one of many objects; absent: anywhere that suits the object.

    Returns:
        The object or the two shoes; empty if no random spot is suitable.
    """
    dice, space = furnished.dice, furnished.space
    kind = dice.choice(kinds)
    style = _style(kind, furnished)
    across = 2 * style.width_m + _SHOE_GAP_M if kind == "Shoe" else style.width_m
    half = hypot(across, style.depth_m) / 2 + 0.03
    owners = [item.id for item in furnished.items] if kind in _ANCHORS or corners else []
    spots = _floor_spots(kind, replace(style, width_m=across), furnished)
    if corners:
        spots = ((*dice.choice(corners), dice.uniform(-pi, pi)) for _ in range(_MANY_TRIES))
    for x, y, yaw in spots:
        box = (x - half, y - half, x + half, y + half)
        if contains(furnished.room.polygon, x, y) and space.admits(box, partners=owners) and space.stays_open(box):
            things = [
                _thing(kind, style, furnished, (x - side * sin(yaw), y + side * cos(yaw), yaw), 0.0)
                for side in ((across - style.width_m) / 2, (style.width_m - across) / 2)[: 2 if kind == "Shoe" else 1]
            ]
            space.add(things[0].id, box, [box])
            return things
    return []


def _floor_spots(kind: str, style: Style, furnished: RoomFurnishing) -> Iterator[tuple[float, float, float]]:
    """Yields candidate spots on the floor: x and y in metres, and the turn about the vertical in radians.

    They are by a wall for objects that are put down, and anywhere for dropped ones.
    """
    dice = furnished.dice
    if kind in _BY_A_WALL:
        reach = hypot(style.width_m, style.depth_m) / 2 + 0.05 - style.depth_m / 2
        wide = replace(style, width_m=style.width_m + 2 * reach)
        poses = against_walls(furnished.space, wide, 0.0, "corner", dice)
        for pose in sorted(poses, key=lambda pose: -pose.score)[:_TRIES]:
            spot = pose.moved(reach, 0.0)
            yield spot.x, spot.y, spot.quarter * pi / 2 + dice.uniform(-0.25, 0.25)
        return
    for _ in range(_TRIES):
        x, y = _dropped(kind, furnished)
        yield x, y, dice.uniform(-pi, pi)


def _dropped(kind: str, furnished: RoomFurnishing) -> tuple[float, float]:
    dice = furnished.dice
    anchors = [item for near in _ANCHORS.get(kind, ()) for item in furnished.placed(near)]
    area: Box = furnished.space.bounds
    if anchors:
        x0, y0, x1, y1 = box_of(dice.choice(anchors))
        area = (x0 - _ANCHOR_REACH_M, y0 - _ANCHOR_REACH_M, x1 + _ANCHOR_REACH_M, y1 + _ANCHOR_REACH_M)
    return dice.uniform(area[0], area[2]), dice.uniform(area[1], area[3])


def _thing(
    kind: str, style: Style, furnished: RoomFurnishing, pose: tuple[float, float, float], base_m: float
) -> Furniture:
    x, y, yaw = pose
    return Furniture(
        id=furnished.new_id(kind),
        model_type=kind,
        style=style.name,
        room=furnished.room.name,
        x=round(x, 3) + 0.0,
        y=round(y, 3) + 0.0,
        yaw=round((yaw + pi) % (2 * pi) - pi, 3),
        width_m=style.width_m,
        depth_m=style.depth_m,
        height_m=style.height_m,
        base_m=round(base_m, 4),
        movable=True,
    )
