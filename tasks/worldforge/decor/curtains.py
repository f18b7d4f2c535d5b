"""Curtains that hang in folds beside windows, and roller blinds where there is no room for them."""

from collections.abc import Iterator, Sequence
from math import pi
from random import Random

from ....schemas.worlds.world import World
from ..geometry.parts import Color, Span, rgb
from ..ornaments.forms import Shapes
from ..ornaments.ornaments import Ornament
from .boxes import covered, free_height
from .faces import Face, window_heights

_CURTAINED = ("Bedroom", "Dining", "Living")
_CLOTHS: tuple[Color, ...] = tuple(
    rgb(color) for color in ("b9a98c", "8f9aa3", "a8b3a0", "c9b9a6", "7f8ea0", "b08d7e", "d8d2c4")
)
_ROD = rgb("4a423b")
_BLIND = rgb("e4dfd3")

_OFF_M = 0.1
"""Distance of the rod's middle from the wall, in metres."""
_DEEP_M = 0.056
"""Depth of the folds, in metres."""
_OVER_M = 0.13
"""Height of the rod above the window, in metres."""


def curtains(world: World, faces: Sequence[Face], shapes: Shapes, dice: Random) -> Iterator[Ornament]:
    """Curtains at the windows of living rooms, dining rooms and bedrooms; other windows have blinds at times."""
    cloth = {room.name: dice.choice(_CLOTHS) for room in world.floorplan.rooms}
    for face in faces:
        for number, span in face.windows:
            color = cloth[face.room.name]
            hung = face.room.type in _CURTAINED and list(_pair(face, number, span, world, color, shapes))
            if hung:
                yield from hung
            elif dice.random() < 0.6:
                yield from _blind(face, number, span, world, dice)


def _pair(
    face: Face, number: int, span: Span, world: World, color: Color, shapes: Shapes
) -> Iterator[Ornament]:  # fmt: skip
    """Two curtains on a rod, as long as what stands below leaves room for; nothing where it is too high."""
    sill, head = window_heights(world)
    top = min(head + _OVER_M, world.floorplan.ceiling_height_m - 0.05)
    wide = round(0.16 + 0.09 * (span[1] - span[0]), 2)
    spans = ((span[0] - wide + 0.08, span[0] + 0.08), (span[1] - 0.08, span[1] + wide - 0.08))
    if spans[0][0] < face.inner[0] or spans[1][1] > face.inner[1]:
        return
    standing = covered(world, face.room.name)
    over = max(free_height(face.strip(side, 0.0, _OFF_M + 0.06), standing) for side in spans)
    bottom = 0.03 if over == 0.0 else sill - 0.06
    if over > bottom:
        return
    size, yaw = (wide, _DEEP_M, top - bottom), 0.0 if face.along_x else pi / 2
    for index, side in enumerate(spans):
        center, _ = face.box(side, (_OFF_M, _OFF_M), (bottom, top))
        yield shapes.drawn(f"curtain_{number}_{index}", "curtain", size, center, color, yaw)
    yield face.rod(f"curtain_{number}_rod", (spans[0][0] - 0.05, spans[1][1] + 0.05), _OFF_M, top, 0.012, _ROD)


def _blind(face: Face, number: int, span: Span, world: World, dice: Random) -> Iterator[Ornament]:
    """A roll above the window's frame and cloth that comes some way down."""
    sill, head = window_heights(world)
    off = -0.3 * face.wall.thickness_m
    down = dice.choice((0.12, 0.2, 0.32)) * (head - sill)
    sides = (span[0] + 0.01, span[1] - 0.01)
    cloth, bar = (off - 0.003, off + 0.003), (off - 0.008, off + 0.008)
    yield face.rod(f"blind_{number}_roll", sides, off, head - 0.03, 0.028, _BLIND)
    yield face.bar(f"blind_{number}_cloth", sides, cloth, (head - down, head - 0.03), _BLIND)
    yield face.bar(f"blind_{number}_bar", sides, bar, (head - down - 0.02, head - down), _BLIND)
