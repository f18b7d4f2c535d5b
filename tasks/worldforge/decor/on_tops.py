"""Decoration on furniture: small things on tables, counters, chests and open shelves."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import cos, hypot, pi, sin
from operator import attrgetter
from random import Random

from ....schemas.worlds.world import OUTDOOR_ROOM_TYPE, Furniture, World
from ..furniture.catalogue import parts_of
from ..furniture.placed_parts import turn
from ..geometry.boxes import Box, box_of, hits
from ..geometry.parts import Part
from ..ornaments.ornament_shapes import Shapes
from ..ornaments.ornaments import Ornament
from ..ornaments.things import THINGS, footprint_m, placed

_KITCHEN = (
    "kettle", "jar", "knives", "fruit", "bottle", "herb", "roll", "mug", "jar", "bowl", "mug", "plates", "jar_small",
)  # fmt: skip
ON_TOP: dict[str, tuple[str, ...]] = {
    "BarCabinets": ("plant", "glass", "glass"),
    "Baths": ("soap", "bottles_small", "bottles_small", "candle"),
    "Bookcases": ("plant_bushy", "box", "frame", "vase"),
    "CoffeeTables": ("vase", "books_two", "candle", "remote", "mug"),
    "ConsoleTables": ("frame", "candle", "bowl", "books_two", "box"),
    "CornerCabinets": ("frame", "candle", "bowl"),
    "Desks": ("pens", "papers", "book_stack", "mug", "herb", "clock"),
    "DiningTables": ("candle", "vase", "glass", "glass", "bottle", "glass", "glass", "jar_small", "jar_small"),
    "DishWashers": ("plates", "bowl", "mug", "mug"),
    "Dressers": ("plant", "frame", "box", "candle", "bottles_small", "book_stack", "frame"),
    "EndAndSideTables": ("books_two", "glass"),
    "KitchenIslandsAndCarts": ("fruit", "bottle", "glass", "glass", "jar", "mug", "plates"),
    "MediaStorage": ("frame", "remote", "plant_bushy", "candle"),
    "Nightstands": ("clock", "glass", "books_two"),
    "Ovens": ("pot", "pan"),
    "SideboardsAndBuffets": ("vase", "bowl", "candle", "frame", "book_stack", "plates"),
    "Toilets": ("roll", "candle"),
    "VanityCounters": ("soap", "glass", "bottles_small", "bottles_small", "folded", "candle", "herb"),
    "WashingMachinesAndDryers": ("bottle", "box", "folded"),
}  # fmt: skip
"""Small things by the kind of furniture that carries them, the most important first."""

_OUTSIDE: dict[str, tuple[str, ...]] = {"EndAndSideTables": ("plant_bushy", "glass"), "StorageBenches": ("herb",)}
"""The same on balconies, where nothing lies that rain would spoil."""

_ON_BOARDS: dict[str, tuple[str, ...]] = {
    "Bathroom": ("folded", "bottles_small", "bottles_small", "soap", "box"),
    "Kitchen": ("jar", "bowl", "plates", "jar_small", "herb"),
}
_STORED = ("box", "book_stack", "folded", "plant", "frame")
_TOPS = ("top", "hob", "ledge")
_TRIES = 14
_EDGE_M = 0.015
_LEAST_SHARE, _FULL_SHARE = 0.4, 0.3
"""Least share of its small things that a room gets, and share of floor under furniture from which it gets all."""


def things_on_tops(world: World, shapes: Shapes, dice: Random) -> Iterator[Ornament]:
    """Yields decorations on furniture, such as books, plates and plants."""
    share = _fullness(world)
    loose = [item for item in world.furniture if item.movable and item.base_m > 0.0]
    types = {room.name: room.type for room in world.floorplan.rooms}
    for item in world.furniture:
        if item.movable:
            continue
        tops = _OUTSIDE if types[item.room] == OUTDOOR_ROOM_TYPE else ON_TOP
        wanted = tops.get(item.model_type, ())
        if item.model_type == "Storage" and item.style.startswith("counter"):
            # Counters stand side by side: each begins elsewhere in the list.
            first = dice.randrange(len(_KITCHEN))
            wanted = (*_KITCHEN[first:], *_KITCHEN[:first])[: max(3, round(9 * item.width_m))]
        count = max(1, round(share[item.room] * len(wanted)))
        top = _Top.of(item, loose)
        if wanted and top is not None:
            yield from _set(f"thing_{item.id}", item, top, wanted[:count], shapes, dice)
        if item.model_type == "Storage" and item.style.startswith("shelves"):
            stored = _ON_BOARDS.get(types[item.room], _STORED)
            for number, board in enumerate(_boards(item)):
                yield from _set(f"thing_{item.id}_{number}", item, board, stored, shapes, dice)


def _fullness(world: World) -> dict[str, float]:
    shares = {}
    for room in world.floorplan.rooms:
        covered = sum(i.width_m * i.depth_m for i in world.furniture if i.room == room.name and not i.movable)
        shares[room.name] = min(1.0, max(_LEAST_SHARE, covered / room.floor_m2 / _FULL_SHARE))
    return shares


@dataclass(frozen=True, slots=True)
class _Top:
    """A surface of a furnishing in the furnishing's frame, and its occupied areas."""

    part: Part
    taken: list[Box]
    headroom: float
    """Free height above a furniture surface, in metres."""

    @classmethod
    def of(cls, item: Furniture, loose: Sequence[Furniture]) -> "_Top | None":
        """Returns the top surface of a piece of furniture, with the areas that are taken; `None` if it has no top."""
        parts = parts_of(item)
        named = [part for part in parts if part.name in _TOPS or part.name.startswith("top")]
        if item.model_type == "Baths":
            named = [part for part in parts if part.name == "left"]
        if not named:
            return None
        top = max(named, key=attrgetter("top_m"))
        above = [_box(part) for part in parts if part.drawn and part.top_m > top.top_m + 1e-4]
        near = [thing for thing in loose if thing.base_m > 0.2 and hits(box_of(item), [_around(thing)])]
        return cls(top, above + [_local(item, thing) for thing in near], 2.0)

    @property
    def up(self) -> float:
        return self.part.top_m

    def free(self, x: float, y: float, deep: float, wide: float) -> Box | None:
        """Returns the area that an object covers at a position, or `None` if it overhangs or collides."""
        box = (x - deep / 2, y - wide / 2, x + deep / 2, y + wide / 2)
        (px, py, _), (pw, pd, _) = self.part.center, self.part.size
        inside = abs(x - px) + deep / 2 <= pw / 2 - _EDGE_M and abs(y - py) + wide / 2 <= pd / 2 - _EDGE_M
        if self.part.shape == "cylinder":
            inside = hypot(abs(x - px) + deep / 2, abs(y - py) + wide / 2) <= pw / 2 - _EDGE_M
        return box if inside and not hits(box, self.taken) else None


def _boards(item: Furniture) -> Iterator[_Top]:
    """Yields the boards of an open shelf as surfaces for decoration."""
    parts = parts_of(item)
    boards = sorted((part for part in parts if part.name.startswith("board")), key=attrgetter("top_m"))
    for board, above in zip(boards, [*(part.top_m for part in boards[1:]), item.height_m + 2.0], strict=True):
        others = (part for part in parts if part is not board and _bottom(part) < above - 0.05)
        standing = [_box(part) for part in others if part.top_m > board.top_m + 1e-4]
        yield _Top(board, standing, above - 0.04 - board.top_m)


def _set(
    name: str, item: Furniture, top: _Top, wanted: Sequence[str], shapes: Shapes, dice: Random
) -> Iterator[Ornament]:
    """Yields small things at free positions on a surface, each turned a little.

    A thing that is too high, or finds no free position after some tries, is left out. The areas that the others
    cover are added to `top.taken`.
    """
    (px, py, _), (pw, pd, _) = top.part.center, top.part.size
    c, s = turn(item.yaw)
    for number, thing in enumerate(wanted):
        if max(piece.up + piece.size[2] for piece in THINGS[thing]) > top.headroom:
            continue
        angle = dice.uniform(-0.25, 0.25) + (pi if thing == "pan" else 0.0)
        deep, wide = _turned_extents(footprint_m(thing), angle)
        for _ in range(_TRIES):
            # What is high stands at the back.
            x = px + dice.uniform(-0.5, 0.5) * max(0.0, pw - deep - 2 * _EDGE_M - 1e-6)
            y = py + dice.uniform(-0.5, 0.5) * max(0.0, pd - wide - 2 * _EDGE_M - 1e-6)
            box = top.free(x, y, deep, wide)
            if box is None:
                continue
            top.taken.append(box)
            spot = (item.x + c * x - s * y, item.y + s * x + c * y, item.base_m + top.up)
            yield from placed(f"{name}_{number}_{thing}", thing, spot, item.yaw + angle, shapes, dice)
            break


def _turned_extents(size: tuple[float, float], angle: float) -> tuple[float, float]:
    c, s = abs(cos(angle)), abs(sin(angle))
    return c * size[0] + s * size[1], s * size[0] + c * size[1]


def _bottom(part: Part) -> float:
    return part.center[2] - part.size[2] / 2


def _box(part: Part) -> Box:
    (x, y, _), (wide, deep, _) = part.center, part.size
    return x - wide / 2, y - deep / 2, x + wide / 2, y + deep / 2


def _around(thing: Furniture) -> Box:
    reach = hypot(thing.width_m, thing.depth_m) / 2 + 0.01
    return thing.x - reach, thing.y - reach, thing.x + reach, thing.y + reach


def _local(item: Furniture, thing: Furniture) -> Box:
    """Returns the box that a loose object covers, in a furnishing's frame."""
    c, s = turn(item.yaw)
    dx, dy = thing.x - item.x, thing.y - item.y
    x, y, reach = c * dx + s * dy, c * dy - s * dx, hypot(thing.width_m, thing.depth_m) / 2 + 0.01
    return x - reach, y - reach, x + reach, y + reach
