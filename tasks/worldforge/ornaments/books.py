"""Rows of books, each a thing of its own."""

from collections.abc import Iterator
from random import Random

from ..furniture.solids import turn
from ..geometry.parts import Vector
from .forms import Shapes
from .ornaments import Ornament
from .things import SPINES

_THICK_M = (0.026, 0.034, 0.042)
_HEIGHTS = (0.8, 0.9, 1.0)
_STEP_M = 0.02
"""Step between heights of books, in metres: few sizes are few meshes."""
_DEEP_M = 0.12


def book_row(
    name: str, foot: Vector, yaw: float, size: Vector, shapes: Shapes, dice: Random
) -> Iterator[Ornament]:  # fmt: skip
    """Books that fill a box.

    Args:
        name: of the row; books are numbered.
        foot: middle of the box's lower side.
        yaw: where their backs face.
        size: depth, width and height of the box; all books are as deep.
        shapes: gathers their meshes.
        dice: how thick, how high, and of which colour they are.
    """
    _, wide, tall = size
    c, s = turn(yaw)
    at, number = -wide / 2, 0
    while (thick := dice.choice(_THICK_M)) and at + thick <= wide / 2:
        high = max(_STEP_M, int(tall * dice.choice(_HEIGHTS) / _STEP_M) * _STEP_M)
        x, y = -0.01 * dice.randrange(2), at + thick / 2
        center = (foot[0] + c * x - s * y, foot[1] + s * x + c * y, foot[2] + high / 2)
        size = (_DEEP_M, thick - 0.002, high)
        yield shapes.drawn(f"{name}_{number}", "block", size, center, dice.choice(SPINES), yaw)
        at, number = at + thick, number + 1
