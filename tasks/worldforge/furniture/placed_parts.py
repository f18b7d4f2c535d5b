"""Furniture parts in the world's frame, and the height of their tops, as both the MJCF and the preview need them."""

from collections.abc import Iterator, Sequence
from math import cos, hypot, pi, sin
from typing import NamedTuple

from ....schemas.worlds.world import Furniture
from ..geometry.boxes import Box
from ..geometry.parts import Axis, Color, Part, Shape, Vector
from .catalogue import parts_of

_EXACT_TURNS = {0: (1.0, 0.0), 1: (0.0, 1.0), 2: (-1.0, 0.0), 3: (0.0, -1.0)}


class Solid(NamedTuple):
    """A geometric primitive (box, cylinder, ellipsoid) in the world."""

    name: str
    """Name of the part: furniture id, a dot, the part's name."""
    shape: Shape
    center: Vector
    size: Vector
    """Full extents of a furniture part along its own x, y and z, in metres."""
    axis: Axis
    """Direction of a cylindrical furniture part in its own frame."""
    yaw: float
    """Rotation of the part's own frame about z, in radians; 0 for everything parallel to the walls."""
    color: Color
    solid: bool
    drawn: bool = True


def turn(yaw: float) -> tuple[float, float]:
    """Returns cosine and sine of a yaw angle, exact for quarter turns."""
    quarters = yaw / (pi / 2)
    if abs(quarters - round(quarters)) < 1e-9:
        return _EXACT_TURNS[round(quarters) % 4]
    return cos(yaw), sin(yaw)


def solids_of(item: Furniture) -> Iterator[Solid]:
    """Yields the parts of a piece of furniture as primitives in the world."""
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


_MARGIN_M = 0.008


def height_at(parts: Sequence[Part], spot: Box) -> float | None:
    """Returns the height of the surface that could carry an object at a position of the piece.

    Args:
        parts: Parts of the piece, in its own frame.
        spot: Area of the object in that frame: back, right, front, left.

    Returns:
        Metres above the piece's base; `None` where nothing solid carries the whole spot, or something else stands on
            it.
    """
    x0, y0, x1, y1 = spot[0] - _MARGIN_M, spot[1] - _MARGIN_M, spot[2] + _MARGIN_M, spot[3] + _MARGIN_M
    under = [part for part in parts if _over(part, x0, y0, x1, y1)]
    if not under:
        return None
    height = max(part.top_m for part in under)
    # A drawn top and the box below it that carries are as high, but for the last digit.
    highest = [part for part in under if part.top_m > height - 1e-6]
    return height if any(part.solid and _carries(part, x0, y0, x1, y1) for part in highest) else None


def _over(part: Part, x0: float, y0: float, x1: float, y1: float) -> bool:
    (x, y, _), (width, depth, _) = part.center, part.size
    return x - width / 2 < x1 and x0 < x + width / 2 and y - depth / 2 < y1 and y0 < y + depth / 2


def _carries(part: Part, x0: float, y0: float, x1: float, y1: float) -> bool:
    (x, y, _), (width, depth, _) = part.center, part.size
    if part.shape == "box":
        return x - width / 2 <= x0 and x1 <= x + width / 2 and y - depth / 2 <= y0 and y1 <= y + depth / 2
    if part.shape == "cylinder" and part.axis == "z":
        return max(hypot(u - x, v - y) for u in (x0, x1) for v in (y0, y1)) <= width / 2
    return False
