"""Decorations on walls: pictures, shelves with things on them, mirrors, clocks, coats and towels."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from math import cos, pi, sin
from random import Random

from ....schemas.worlds.world import Room, RoomType, World
from ..geometry.boxes import hits
from ..geometry.parts import CHROME, MIRROR, WHITE, Color, Span, Vector, rgb
from ..ornaments.ornament_shapes import Shapes
from ..ornaments.ornaments import Ornament, color_look
from ..ornaments.things import book_row, footprint_m, placed
from .faces import Face, Standing, covered

_FRAMES = (rgb("3a332d"), rgb("c89f6d"), rgb("f2efe8"))
_MOUNT = rgb("f6f3ec")
_SCENES: tuple[tuple[Color, Color], ...] = tuple(
    (rgb(above), rgb(below))
    for above, below in (
        ("a9c3d1", "6f8f7a"), ("e3c9a0", "b0674a"), ("d9d4c7", "46566b"), ("c7d4c2", "d19a55"), ("e8dcd0", "8b5e63"),
    )
)  # fmt: skip
_CLOTH = (rgb("7f9aa8"), rgb("b98a7a"), rgb("d8d2c4"), rgb("4f5f6f"), rgb("8fa58b"), rgb("6d4a3c"))
_BOARDS = (rgb("c89f6d"), rgb("f2efe8"), rgb("7a5436"))
_PICTURE_SIZES = ((0.5, 0.66), (0.72, 0.5), (0.9, 0.62))
_EYES_M = 1.55
_BESIDE_WINDOW_M = 0.35
_APART_M = 0.15
_STRIP_M = 0.5
_SHELF_M, _SHELF_DEEP_M, _SHELF_WIDE_M = 1.5, 0.24, 0.9
_FROM_CORNER_M = 0.1

_ON_SHELVES: dict[RoomType, tuple[str, ...]] = {
    "Bathroom": ("folded", "bottles_small", "soap", "herb", "candle"),
    "Closet": ("box", "box", "folded"),
    "Kitchen": ("jar", "jar", "jar_small", "herb", "plates", "jar_small"),
    "Storage": ("box", "jar", "box"),
}
_USUALLY_ON_SHELVES = ("books", "plant", "frame", "vase")


@dataclass(slots=True)
class _Wall:
    """Side of a wall in a room, with the stretches of it that decoration already covers."""

    face: Face
    standing: Sequence[Standing]
    taken: list[Span] = field(default_factory=list)

    def free_middle(self, wide: float, below: float) -> float | None:
        """Finds a free stretch on the wall that is wide enough, and returns its middle.

        Args:
            wide: Width of the decoration, in metres.
            below: Largest height of furniture below it, in metres.

        Returns:
            The coordinate along the wall in metres; `None` if there is no such stretch.
        """
        low, high = self.face.inner
        reach = wide / 2 + _FROM_CORNER_M
        in_the_way = [box for box, height in self.standing if height > below]
        for spot in ((low + high) / 2 + side * 0.1 * count for count in range(40) for side in (1, -1)):
            span = (spot - reach, spot + reach)
            if span[0] < low or span[1] > high or any(span[0] < end and start < span[1] for start, end in self.taken):
                continue
            if not hits(self.face.strip(span, 0.0, _STRIP_M), in_the_way):
                return spot
        return None

    @property
    def yaw(self) -> float:
        """Direction that decorations on this wall face, in radians."""
        return self.face.inward * pi / 2 if self.face.along_x else (0.0 if self.face.inward > 0 else pi)

    def spot(self, along: float, off: float, up: float) -> Vector:
        """Returns a 3D point by its distances along, off and up a wall."""
        return self.face.box((along, along), (off, off), (up, up))[0]


Hang = Callable[[str, _Wall, float, Shapes, Random], Iterator[Ornament]]


def _picture(name: str, wall: _Wall, at: float, _: Shapes, dice: Random) -> Iterator[Ornament]:
    wide, tall = dice.choice(_PICTURE_SIZES)
    frame, scene, share = dice.choice(_FRAMES), dice.choice(_SCENES), dice.choice((0.35, 0.45, 0.6))
    along, up = (at - wide / 2, at + wide / 2), (_EYES_M - tall / 2, _EYES_M + tall / 2)
    yield wall.face.bar(f"{name}_frame", along, (0.0, 0.022), up, frame)
    yield wall.face.bar(f"{name}_mount", _within(along, 0.025), (0.02, 0.024), _within(up, 0.025), _MOUNT)
    along, up = _within(along, 0.075), _within(up, 0.075)
    line = up[0] + share * (up[1] - up[0])
    yield wall.face.bar(f"{name}_above", along, (0.022, 0.026), (line, up[1]), scene[0])
    yield wall.face.bar(f"{name}_below", along, (0.022, 0.026), (up[0], line), scene[1])


def _mirror(name: str, wall: _Wall, at: float, _: Shapes, dice: Random) -> Iterator[Ornament]:
    along, up = (at - 0.25, at + 0.25), (0.95, 1.95)
    yield wall.face.bar(f"{name}_frame", along, (0.0, 0.025), up, dice.choice(_FRAMES))
    yield wall.face.bar(f"{name}_glass", _within(along, 0.03), (0.022, 0.028), _within(up, 0.03), MIRROR)


def _clock(name: str, wall: _Wall, at: float, _: Shapes, dice: Random) -> Iterator[Ornament]:
    quat, middle = wall.face.quat, 1.9
    for part, radius, off, color in (("rim", 0.15, 0.018, dice.choice(_FRAMES)), ("face", 0.132, 0.022, WHITE)):
        center = wall.spot(at, off / 2, middle)
        yield Ornament(f"{name}_{part}", "cylinder", center, (radius, off / 2), color_look(color), quat)
    dark = rgb("25282c")
    yield wall.face.bar(f"{name}_minutes", (at - 0.004, at + 0.004), (0.02, 0.025), (middle, middle + 0.1), dark)
    yield wall.face.bar(f"{name}_hours", (at, at + 0.07), (0.02, 0.025), (middle - 0.005, middle + 0.005), dark)


def _shelf(name: str, wall: _Wall, at: float, shapes: Shapes, dice: Random) -> Iterator[Ornament]:
    """Makes a shelf board with objects side by side."""
    along = (at - _SHELF_WIDE_M / 2, at + _SHELF_WIDE_M / 2)
    board, bracket = (_SHELF_M - 0.028, _SHELF_M), (_SHELF_M - 0.05, _SHELF_M - 0.028)
    yield wall.face.bar(f"{name}_board", along, (0.0, _SHELF_DEEP_M), board, dice.choice(_BOARDS))
    for end, side in enumerate((along[0] + 0.1, along[1] - 0.1)):
        yield wall.face.bar(f"{name}_bracket_{end}", (side - 0.01, side + 0.01), (0.0, 0.16), bracket, CHROME)
    left = along[0] + 0.03
    for number, thing in enumerate(_ON_SHELVES.get(wall.face.room.type, _USUALLY_ON_SHELVES)):
        deep, wide = (0.15, 0.32) if thing == "books" else footprint_m(thing)
        if left + wide > along[1]:
            break
        spot = wall.spot(left + wide / 2, max(_SHELF_DEEP_M, deep) / 2 + 0.005, _SHELF_M)
        if thing == "books":
            yield from book_row(f"book_{name}", spot, wall.yaw, (0.15, wide, 0.23), shapes, dice)
        else:
            yield from placed(f"thing_{name}_{number}_{thing}", thing, spot, wall.yaw, shapes, dice)
        left += wide + 0.03


def _coats(name: str, wall: _Wall, at: float, shapes: Shapes, dice: Random) -> Iterator[Ornament]:
    """Yields a board with coat hooks, most of them with a coat."""
    yield wall.face.bar(f"{name}_board", (at - 0.45, at + 0.45), (0.0, 0.02), (1.62, 1.74), dice.choice(_BOARDS))
    for hook in range(4):
        place = at - 0.36 + 0.24 * hook
        yield wall.face.bar(f"{name}_hook_{hook}", (place - 0.008, place + 0.008), (0.02, 0.07), (1.65, 1.67), CHROME)
        if hook != 2:
            tall = dice.choice((0.7, 0.85))
            yield _hung(f"thing_{name}_coat_{hook}", wall, place, 1.67, (0.1, 0.23, tall), shapes, dice)


def _towels(name: str, wall: _Wall, at: float, shapes: Shapes, dice: Random) -> Iterator[Ornament]:
    """Yields two towels that hang over a rail."""
    yield wall.face.rod(f"{name}_rail", (at - 0.45, at + 0.45), 0.06, 1.25, 0.009, CHROME)
    for end, side in enumerate((at - 0.44, at + 0.44)):
        yield wall.face.bar(f"{name}_end_{end}", (side - 0.01, side + 0.01), (0.0, 0.065), (1.24, 1.26), CHROME)
        place = at + (0.5 - end) * 0.42
        yield _hung(f"thing_{name}_towel_{end}", wall, place, 1.265, (0.07, 0.36, 0.55), shapes, dice)


def _hung(
    name: str, wall: _Wall, at: float, top: float, size: Vector, shapes: Shapes, dice: Random
) -> Ornament:  # fmt: skip
    return shapes.drawn(name, "draped", size, wall.spot(at, 0.06, top - size[2] / 2), dice.choice(_CLOTH), wall.yaw)


_HANGINGS: dict[str, tuple[Hang, float, float]] = {
    "clock": (_clock, 0.3, 1.6),
    "coats": (_coats, 0.95, 0.1),
    "mirror": (_mirror, 0.5, 0.85),
    "picture": (_picture, 0.9, 1.15),
    "shelf": (_shelf, _SHELF_WIDE_M, 1.15),
    "towels": (_towels, 0.95, 0.5),
}
"""Builder of each decoration, its width and the largest height of furniture below it, in metres."""

_IN_ROOMS: dict[RoomType, tuple[str, ...]] = {
    "Balcony": (),
    "Bathroom": ("towels", "shelf", "towels", "shelf"),
    "Bedroom": ("picture", "shelf", "mirror", "picture"),
    "Closet": ("mirror", "coats", "shelf"),
    "Dining": ("picture", "clock", "shelf", "picture"),
    "Hallway": ("coats", "mirror", "picture", "picture"),
    "Kitchen": ("shelf", "clock", "shelf"),
    "Living": ("picture", "shelf", "picture", "clock"),
    "Office": ("shelf", "picture", "clock"),
    "Storage": ("shelf",),
}
"""Decorations on the walls of each type of room, the most important first."""

_OVER_COUNTERS = ("Kitchen",)
"""Types of rooms in which wall cabinets hang above furniture at walls."""


def things_on_walls(world: World, faces: Sequence[Face], shapes: Shapes, dice: Random) -> Iterator[Ornament]:
    """Yields decorations on walls, such as pictures, clocks and shelves."""
    for index, room in enumerate(world.floorplan.rooms):
        standing = [*covered(world, room.name), *_swept(world, room)]
        own = [_Wall(face, standing, _windows(face)) for face in faces if face.room.name == room.name]
        for number, kind in enumerate(_IN_ROOMS[room.type]):
            hang, wide, below = _HANGINGS[kind]
            limit = min(below, 0.5) if room.type in _OVER_COUNTERS else below
            for wall in sorted(own, key=lambda wall: len(wall.taken)):
                spot = wall.free_middle(wide, limit)
                if spot is not None:
                    wall.taken.append((spot - wide / 2 - _APART_M, spot + wide / 2 + _APART_M))
                    yield from hang(f"{kind}_{index}_{number}", wall, spot, shapes, dice)
                    break


def _windows(face: Face) -> list[Span]:
    return [(low - _BESIDE_WINDOW_M, high + _BESIDE_WINDOW_M) for _, (low, high) in face.windows]


def _swept(world: World, room: Room) -> Iterator[Standing]:
    """Yields the boxes that door leaves sweep in a room, with the leaves' heights in metres."""
    for passage in world.floorplan.passages:
        door = passage.door
        if door is None or room.name not in passage.rooms:
            continue
        yaws = (door.yaw_at(0.0), door.yaw_at(door.max_angle_rad / 2), door.yaw_at(door.max_angle_rad))
        xs = [door.hinge[0] + door.leaf_width_m * cos(yaw) for yaw in yaws]
        ys = [door.hinge[1] + door.leaf_width_m * sin(yaw) for yaw in yaws]
        xs, ys = [*xs, door.hinge[0]], [*ys, door.hinge[1]]
        yield (min(xs) - 0.05, min(ys) - 0.05, max(xs) + 0.05, max(ys) + 0.05), door.leaf_height_m


def _within(span: Span, by: float) -> Span:
    return span[0] + by, span[1] - by
