"""Curtains that hang in folds beside windows, and roller blinds where there is no room for them."""

from collections.abc import Iterator
from math import cos, pi, sin
from random import Random

import numpy as np

from ....schemas.worlds.world import World
from ..geometry.boxes import Box
from ..geometry.parts import Color, Span, rgb
from ..ornaments.ornaments import Mesh, Ornament, color_look
from .boxes import covered, free_height
from .faces import Face, faces, window_heights, windows_in

_CURTAINED = ("Bedroom", "Dining", "Living")
_CLOTHS: tuple[Color, ...] = tuple(
    rgb(color) for color in ("b9a98c", "8f9aa3", "a8b3a0", "c9b9a6", "7f8ea0", "b08d7e", "d8d2c4")
)
_ROD = rgb("4a423b")
_BLIND = rgb("e4dfd3")

_OFF_M = 0.1
"""Of the rod's middle from the wall."""
_FOLD_M = 0.026
_CLOTH_M = 0.004
_OVER_M = 0.13
"""Of the rod above the window."""
_FOLDS = 5
_STEPS = 6


def curtains(world: World, dice: Random) -> Iterator[tuple[Ornament, Mesh | None]]:
    """What hangs at the windows of living rooms, dining rooms and bedrooms; others have blinds at times."""
    cloth = {room.name: dice.choice(_CLOTHS) for room in world.floorplan.rooms}
    made: set[str] = set()
    for face in faces(world):
        standing = covered(world, face.room.name)
        for number, span in windows_in(face.wall, world):
            hung = None
            if face.room.type in _CURTAINED:
                hung = list(_pair(face, number, span, world, standing, cloth[face.room.name]))
            if hung:
                for ornament, mesh in hung:
                    yield ornament, None if ornament.mesh in made else mesh
                    made.add(ornament.mesh)
            elif dice.random() < 0.6:
                yield from ((ornament, None) for ornament in _blind(face, number, span, world, dice))


def _pair(
    face: Face, number: int, span: Span, world: World, standing: list[tuple[Box, float]], color: Color
) -> Iterator[tuple[Ornament, Mesh | None]]:
    """Two curtains on a rod, as long as what stands below leaves room for; nothing where it is too high."""
    sill, head = window_heights(world)
    top = min(head + _OVER_M, world.floorplan.ceiling_height_m - 0.05)
    wide = round(0.16 + 0.09 * (span[1] - span[0]), 2)
    spans = ((span[0] - wide + 0.08, span[0] + 0.08), (span[1] - 0.08, span[1] + wide - 0.08))
    if spans[0][0] < face.inner[0] or spans[1][1] > face.inner[1]:
        return
    over = max(free_height(face.strip(side, 0.0, _OFF_M + 0.06), standing) for side in spans)
    bottom = 0.03 if over == 0.0 else sill - 0.06
    if over > bottom:
        return
    mesh = f"curtain_{round(100 * wide)}_{round(100 * (top - bottom))}"
    for index, side in enumerate(spans):
        center, _ = face.box(side, (_OFF_M, _OFF_M), (bottom, bottom))
        quat = "" if face.along_x else f"{cos(pi / 4):.6f} 0 0 {sin(pi / 4):.6f}"
        look = color_look(color)
        yield Ornament(f"curtain_{number}_{index}", "mesh", center, (), look, quat, mesh), _drape(wide, top - bottom)
    center, half = face.box((spans[0][0] - 0.05, spans[1][1] + 0.05), (_OFF_M, _OFF_M), (top, top))
    length = half[0] if face.along_x else half[1]
    quat = "0.707107 0 0.707107 0" if face.along_x else "0.707107 0.707107 0 0"
    yield Ornament(f"curtain_{number}_rod", "cylinder", center, (0.012, length), color_look(_ROD), quat), None


def _drape(wide: float, tall: float) -> Mesh:
    """A closed strip of cloth in waves along x, gathered a little at the top."""
    count = _FOLDS * _STEPS + 1
    share = np.arange(count) / (count - 1)
    wave = np.sin(share * (2 * np.pi * _FOLDS))
    rows = []
    for height, depth in ((0.0, 1.0), (0.5 * tall, 0.9), (tall, 0.6)):
        for side in (1.0, -1.0):
            y = wave * _FOLD_M * depth + side * _CLOTH_M / 2
            rows.append(np.stack([(share - 0.5) * wide, y, np.full(count, height)], axis=1))
    triangles = []
    for low in (0, 2):
        # Rows come in pairs: the side towards +y, then the side towards -y.
        triangles += [_band(low * count, (low + 2) * count, count, False)]
        triangles += [_band((low + 1) * count, (low + 3) * count, count, True)]
    triangles += [_band(0, count, count, True), _band(4 * count, 5 * count, count, False)]
    return Mesh(np.concatenate(rows), np.concatenate(triangles))


def _band(first: int, second: int, count: int, facing: bool) -> np.ndarray:
    """Triangles between two rows of vertices; seen from -y, the second above the first, they face the eye or not."""
    a = first + np.arange(count - 1)
    b = second + np.arange(count - 1)
    faces_eye = np.concatenate([np.stack([a, a + 1, b + 1], axis=1), np.stack([a, b + 1, b], axis=1)])
    return faces_eye if facing else faces_eye[:, ::-1]


def _blind(face: Face, number: int, span: Span, world: World, dice: Random) -> Iterator[Ornament]:
    """A roll above the window's frame and cloth that comes some way down."""
    sill, head = window_heights(world)
    off = -0.3 * face.wall.thickness_m
    down = dice.choice((0.12, 0.2, 0.32)) * (head - sill)
    sides = (span[0] + 0.01, span[1] - 0.01)
    center, half = face.box(sides, (off, off), (head - 0.03, head - 0.03))
    length = half[0] if face.along_x else half[1]
    quat = "0.707107 0 0.707107 0" if face.along_x else "0.707107 0.707107 0 0"
    look = color_look(_BLIND)
    yield Ornament(f"blind_{number}_roll", "cylinder", center, (0.028, length), look, quat)
    center, half = face.box(sides, (off - 0.003, off + 0.003), (head - down, head - 0.03))
    yield Ornament(f"blind_{number}_cloth", "box", center, half, look)
    center, half = face.box(sides, (off - 0.008, off + 0.008), (head - down - 0.02, head - down))
    yield Ornament(f"blind_{number}_bar", "box", center, half, look)
