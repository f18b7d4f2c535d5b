"""Furniture parts in the world's frame, as both the MJCF and the preview need them."""

from collections.abc import Iterator
from math import cos, pi, sin
from typing import NamedTuple

from ....schemas.worlds.world import Furniture
from ..geometry.parts import Axis, Color, Part, Shape, Vector
from .catalogue import parts_of

_EXACT_TURNS = {0: (1.0, 0.0), 1: (0.0, 1.0), 2: (-1.0, 0.0), 3: (0.0, -1.0)}


class Solid(NamedTuple):
    """One primitive in the world."""

    name: str
    """Furniture id, a dot, the part's name."""
    shape: Shape
    center: Vector
    size: Vector
    """Full extents along its own x, y and z."""
    axis: Axis
    """Direction of a cylinder in its own frame."""
    yaw: float
    """Turn of its own frame; 0 for everything that stands square to the walls."""
    color: Color
    solid: bool
    drawn: bool = True


def turn(yaw: float) -> tuple[float, float]:
    """Cosine and sine, exact for quarter turns."""
    quarters = yaw / (pi / 2)
    if abs(quarters - round(quarters)) < 1e-9:
        return _EXACT_TURNS[round(quarters) % 4]
    return cos(yaw), sin(yaw)


def solids_of(item: Furniture) -> Iterator[Solid]:
    """A piece's parts in the world; quarter turns become swapped extents, so that nothing is rotated."""
    c, s = turn(item.yaw)
    square = 0.0 in (c, s)
    for part in parts_of(item):
        x, y, z = part.center
        center = (item.x + c * x - s * y, item.y + s * x + c * y, item.base_m + z)
        size, axis = _swapped(part) if square and c == 0.0 else (part.size, part.axis)
        name = f"{item.id}.{part.name}"
        yield Solid(
            name, part.shape, center, size, axis, 0.0 if square else item.yaw, part.color, part.solid, part.drawn
        )


def _swapped(part: Part) -> tuple[Vector, Axis]:
    x, y, z = part.size
    axes: dict[Axis, Axis] = {"x": "y", "y": "x", "z": "z"}
    return (y, x, z), axes[part.axis]
