"""Support surfaces of furniture: solid, level parts on which objects can lie, clear of what is drawn there."""

from collections.abc import Sequence
from math import hypot

from ..geometry.boxes import Box
from ..geometry.parts import Part

_MARGIN_M = 0.008


def height_at(parts: Sequence[Part], spot: Box) -> float | None:
    """Height of the level that carries everything over a spot.

    Args:
        parts: of the piece, in its own frame.
        spot: what would lie there, in that frame: back, right, front, left.

    Returns:
        None where nothing solid carries the whole spot, or where something else stands on it.
    """
    x0, y0, x1, y1 = spot[0] - _MARGIN_M, spot[1] - _MARGIN_M, spot[2] + _MARGIN_M, spot[3] + _MARGIN_M
    under = [part for part in parts if _over(part, x0, y0, x1, y1)]
    if not under:
        return None
    height = max(map(_top, under))
    # A drawn top and the box below it that carries are as high, but for the last digit.
    highest = [part for part in under if _top(part) > height - 1e-6]
    return height if any(part.solid and _carries(part, x0, y0, x1, y1) for part in highest) else None


def _top(part: Part) -> float:
    return part.center[2] + part.size[2] / 2


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
