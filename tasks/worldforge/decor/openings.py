"""Visible windows in walls: the drawn wall has openings, with frames and curtains in them.

The wall that collides stays whole and is not drawn (group 3). There is no pane: even a nearly clear one would keep the
sun out of MuJoCo's pictures.
"""

from collections.abc import Iterator, Sequence
from itertools import pairwise
from math import pi
from random import Random

import numpy as np

from ....schemas.worlds.world import Wall, World
from ..geometry.parts import Color, Span, Vector, rgb
from ..materials.textures import texture_size_m
from ..ornaments.ornament_shapes import Shapes
from ..ornaments.ornaments import ALONG_X, ALONG_Y, Floats, Mesh, Ornament, joined, sheet
from .faces import Face, covered, free_height, wall_span, window_heights, windows_in

Rectangle = tuple[float, float, float, float]
"""Rectangle on a wall, in metres: low end along the wall, bottom height, high end along the wall, top height."""

LAID = "_laid"
"""Suffix of the names of materials for meshes that have texture coordinates of their own."""

_FRAME = rgb("f7f7f3")
_SILL = rgb("efeee9")
_PROFILE_M = 0.055
_FRAME_DEPTH_M = 0.07
_MULLION_FROM_M = 1.1
_SILL_OUT_M = 0.035
_SILL_THICK_M = 0.025
_CELL_M = 0.7


def wall_halves(wall: Wall, sides: tuple[str, str]) -> Iterator[tuple[str, float, float, str]]:
    """Yields a wall as one box, or as two halves if its sides have different surfaces.

    Args:
        wall: The wall.
        sides: Surfaces of its right and left face, looking from its start to its end.

    Yields:
        Suffix of the box's name, offset of its middle across the wall, half its thickness (metres), and surface.
    """
    right, left = sides
    if (wall.end[0] - wall.start[0]) + (wall.end[1] - wall.start[1]) < 0:
        right, left = left, right
    if right == left:
        yield "", 0.0, wall.thickness_m / 2, right
        return
    quarter = wall.thickness_m / 4
    yield "_right", -quarter, quarter, right
    yield "_left", quarter, quarter, left


def pierced_wall(
    number: int, wall: Wall, sides: tuple[str, str], world: World
) -> Iterator[tuple[Ornament, Mesh | None]]:
    """Yields the visible parts of a wall with windows: a mesh for each patterned side, and boxes for each plain one.

    Meshes are needed because a pattern has to continue from part to part, which boxes with textures of their own do not
    do. For boxes the second value is `None`.
    """
    along_x, at, span = wall_span(wall)
    pieces = _around(span, world.floorplan.ceiling_height_m, windows_in(wall, world), window_heights(world))
    quat = ALONG_X if along_x else ALONG_Y
    for suffix, shift, half, surface in wall_halves(wall, sides):
        size_m = texture_size_m(surface)
        look = f'material="{surface}{LAID if size_m else ""}"'
        name = f"wall_{number}{suffix}_seen"
        # Along y, the axes along and through of the wall's frame are y and x.
        across = at + shift if along_x else at - shift
        if size_m is not None:
            place = (0.0, across, 0.0) if along_x else (across, 0.0, 0.0)
            yield Ornament(name, "mesh", place, (), look, quat, name), _patterned(pieces, half, size_m)
            continue
        for index, (low, bottom, high, top) in enumerate(pieces):
            middle, z = (low + high) / 2, (bottom + top) / 2
            center = (middle, across, z) if along_x else (across, middle, z)
            size = ((high - low) / 2, (top - bottom) / 2, half)
            yield Ornament(f"{name}_{index}", "box", center, size, look, quat), None


def _around(span: Span, height: float, windows: Sequence[tuple[int, Span]], up: Span) -> list[Rectangle]:
    """Returns the rectangles of a wall's face that remain around its windows."""
    ends = [span[0], *(end for _, sides in windows for end in sides), span[1]]
    pieces = [(low, 0.0, high, height) for low, high in list(pairwise(ends))[::2] if high > low]
    for _, (low, high) in windows:
        pieces += [(low, 0.0, high, up[0]), (low, up[1], high, height)]
    return pieces


def _patterned(pieces: Sequence[Rectangle], half: float, size_m: tuple[float, float]) -> Mesh:
    """Makes one mesh of boxes whose texture continues from one box to the next.

    The mesh's axes point along, up, and through the wall.
    """
    vertices, triangles = joined(part for piece in pieces for part in _box(piece, half))
    normals = _normals(vertices, triangles)
    sideways, level = np.abs(normals[:, 0]) > 0.5, np.abs(normals[:, 1]) > 0.5
    right = np.where(sideways, vertices[:, 2], vertices[:, 0]) / size_m[0]
    # MuJoCo counts rows of pictures from the top.
    up = -np.where(level, vertices[:, 2], vertices[:, 1]) / size_m[1]
    return Mesh(vertices, triangles, np.stack([right, up], axis=1))


def _box(piece: Rectangle, half: float) -> Iterator[tuple[Floats, np.ndarray]]:
    low, bottom, high, top = piece
    wide, tall, deep = high - low, top - bottom, 2 * half
    cells = max(1, round(wide / _CELL_M)), max(1, round(tall / _CELL_M))
    x, y, z = (wide, 0.0, 0.0), (0.0, tall, 0.0), (0.0, 0.0, deep)
    back: Vector = (-wide, 0.0, 0.0)
    yield sheet((low, bottom, half), x, y, cells)
    yield sheet((high, bottom, -half), back, y, cells)
    yield sheet((low, bottom, -half), z, y, (1, 1))
    yield sheet((high, bottom, half), (0.0, 0.0, -deep), y, (1, 1))
    yield sheet((low, top, half), x, (0.0, 0.0, -deep), (1, 1))
    yield sheet((low, bottom, -half), x, z, (1, 1))


def _normals(vertices: Floats, triangles: np.ndarray) -> Floats:
    """Computes the normals of flat faces that share no vertices: one normal per vertex."""
    a, b, c = (vertices[triangles[:, index]] for index in range(3))
    across = np.cross(b - a, c - a)
    normals = np.zeros_like(vertices)
    normals[triangles.ravel()] = np.repeat(across / np.linalg.norm(across, axis=1, keepdims=True), 3, axis=0)
    return normals


def window_frames(world: World, faces: Sequence[Face]) -> Iterator[Ornament]:
    """Yields frames, crossbars and sills of the windows."""
    up = window_heights(world)
    for face in faces:
        for number, span in face.windows:
            for name, along, off, high, color in _bars(face, span, up):
                yield face.bar(f"window_{number}_{name}", along, off, high, color)


def _bars(face: Face, span: Span, up: Span) -> Iterator[tuple[str, Span, Span, Span, Color]]:
    low, high = span
    middle = -0.6 * face.wall.thickness_m
    depth = (middle - _FRAME_DEPTH_M / 2, middle + _FRAME_DEPTH_M / 2)
    inner = (up[0] + _PROFILE_M, up[1] - _PROFILE_M)
    yield "frame_left", (low, low + _PROFILE_M), depth, up, _FRAME
    yield "frame_right", (high - _PROFILE_M, high), depth, up, _FRAME
    yield "frame_foot", (low + _PROFILE_M, high - _PROFILE_M), depth, (up[0], inner[0]), _FRAME
    yield "frame_head", (low + _PROFILE_M, high - _PROFILE_M), depth, (inner[1], up[1]), _FRAME
    sashes = 1 if high - low < _MULLION_FROM_M else 2
    for index in range(1, sashes):
        at = low + index * (high - low) / sashes
        yield f"frame_bar_{index}", (at - _PROFILE_M / 2, at + _PROFILE_M / 2), depth, inner, _FRAME
    yield (
        "sill", (low - 0.03, high + 0.03), (depth[1], _SILL_OUT_M), (up[0] - 0.003, up[0] + _SILL_THICK_M), _SILL,
    )  # fmt: skip


_CURTAINED = ("Bedroom", "Dining", "Living")
_CLOTHS: tuple[Color, ...] = tuple(
    rgb(color) for color in ("b9a98c", "8f9aa3", "a8b3a0", "c9b9a6", "7f8ea0", "b08d7e", "d8d2c4")
)
_ROD = rgb("4a423b")
_BLIND = rgb("e4dfd3")

_OFF_M = 0.1
"""Distance of the curtain rod's axis from the wall, in metres."""
_DEEP_M = 0.056
"""Depth of the curtain's folds, in metres."""
_OVER_M = 0.13
"""Height of the curtain rod above the window, in metres."""


def curtains(world: World, faces: Sequence[Face], shapes: Shapes, dice: Random) -> Iterator[Ornament]:
    """Yields curtains or blinds at windows.

    Curtains hang in rooms that usually have them, where furniture leaves space; three of five other windows have a
    blind.
    """
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
    """Makes two curtains on a rod, as long as the furniture below allows; none if that is too high."""
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
    """Yields a roller blind: a roll above the window's frame, and cloth that hangs some way down."""
    sill, head = window_heights(world)
    off = -0.3 * face.wall.thickness_m
    down = dice.choice((0.12, 0.2, 0.32)) * (head - sill)
    sides = (span[0] + 0.01, span[1] - 0.01)
    cloth, bar = (off - 0.003, off + 0.003), (off - 0.008, off + 0.008)
    yield face.rod(f"blind_{number}_roll", sides, off, head - 0.03, 0.028, _BLIND)
    yield face.bar(f"blind_{number}_cloth", sides, cloth, (head - down, head - 0.03), _BLIND)
    yield face.bar(f"blind_{number}_bar", sides, bar, (head - down - 0.02, head - down), _BLIND)
