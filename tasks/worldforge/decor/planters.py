"""Railings of balconies as one sees them: a coping on top, and boxes with flowers on it."""

from collections.abc import Iterator
from math import dist
from random import Random

from ....schemas.worlds.world import Wall, World
from ..geometry.parts import Color, Vector, rgb
from ..ornaments.ornament_shapes import Shapes
from ..ornaments.ornaments import Ornament, color_look
from .faces import wall_span

_COPING = rgb("b8b2a6")
_COPING_M, _COPING_OUT_M = 0.03, 0.02
_BOXES = (rgb("9c5a40"), rgb("4d545b"), rgb("e8e4da"))
_LEAVES = (rgb("5f8a56"), rgb("47714a"))
_FLOWERS = (rgb("d98b8b"), rgb("e3c15a"), rgb("b59ac9"), rgb("f4f2ed"))

_BOX_M: Vector = (0.7, 0.18, 0.16)
"""Length, width and height of a flower box in metres: the usual one for railings."""
_APART_M = 0.25
_PLANTED_SHARE = 0.7
"""Share of the places for boxes that have one."""
_PLANTS = 3
_BUSH_M: Vector = (0.24, 0.24, 0.2)
_BLOOM_M: Vector = (0.2, 0.2, 0.1)


def planters(world: World, shapes: Shapes, dice: Random) -> Iterator[Ornament]:
    """Yields copings and flower boxes of all railings; the longest railing of each balcony has the boxes.

    Args:
        world: The world.
        shapes: Gathers the meshes of the plants.
        dice: The source of chance.
    """
    for room in world.floorplan.rooms:
        railings = [
            (number, wall)
            for number, wall in enumerate(world.floorplan.walls)
            if wall.top_m is not None and wall.rooms == [room.name]
        ]
        for number, wall in railings:
            yield _coping(number, wall)
        if railings:
            number, front = max(railings, key=lambda each: dist(each[1].start, each[1].end))
            box = dice.choice(_BOXES)
            for index, spot in enumerate(_spots(front)):
                if dice.random() < _PLANTED_SHARE:
                    yield from _planter(f"thing_railing_{number}_{index}", front, spot, box, shapes, dice)


def _coping(number: int, wall: Wall) -> Ornament:
    low, high = wall_span(wall)[2]
    half = (high - low) / 2, wall.thickness_m / 2 + _COPING_OUT_M, _COPING_M / 2
    return Ornament(f"railing_{number}", "box", *_laid(wall, (low + high) / 2, half), color_look(_COPING))


def _laid(wall: Wall, along: float, half: Vector, up: float = 0.0) -> tuple[Vector, Vector]:
    """Returns the middle and half sizes of a box that lies along a railing, `up` metres above its coping's foot."""
    along_x, at, _ = wall_span(wall)
    z = (wall.top_m or 0.0) + up + half[2]
    if along_x:
        return (along, at, z), half
    return (at, along, z), (half[1], half[0], half[2])


def _spots(wall: Wall) -> list[float]:
    """Returns the middles of the places for flower boxes, as coordinates along a railing."""
    _, _, (low, high) = wall_span(wall)
    count = int((high - low) / (_BOX_M[0] + _APART_M))
    return [low + (high - low) * (index + 0.5) / count for index in range(count)]


def _planter(name: str, wall: Wall, along: float, color: Color, shapes: Shapes, dice: Random) -> Iterator[Ornament]:
    half = _BOX_M[0] / 2, _BOX_M[1] / 2, _BOX_M[2] / 2
    yield Ornament(name, "box", *_laid(wall, along, half, _COPING_M), color_look(color))
    for index in range(_PLANTS):
        at = along + _BOX_M[0] * ((index + 0.5) / _PLANTS - 0.5)
        top = _COPING_M + _BOX_M[2] - 0.03
        for part, form, size, colors, up in (
            ("bush", "bush", _BUSH_M, _LEAVES, top),
            ("bloom", "flowers", _BLOOM_M, _FLOWERS, top + 0.12),
        ):
            center, _ = _laid(wall, at, (size[0] / 2, size[1] / 2, size[2] / 2), up)
            yield shapes.drawn(f"{name}_{part}_{index}", form, size, center, dice.choice(colors), 0.0)
