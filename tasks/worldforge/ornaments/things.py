"""Small decorative objects on furniture, books among them, and their shapes."""

from collections.abc import Iterator
from dataclasses import dataclass
from math import cos, sin
from random import Random

from ....schemas.worlds.world import Furniture
from ..furniture.catalogue import parts_of
from ..furniture.placed_parts import Solid, solids_of, turn
from ..geometry.parts import CERAMIC, CHROME, STEEL, WHITE, Color, Part, Vector, rgb
from .ornament_shapes import Shapes, form_of
from .ornaments import Ornament

_LEAF, _DARK_LEAF, _CLAY = rgb("5f8a56"), rgb("47714a"), rgb("b5694a")
_CLOTH = (rgb("d8d2c4"), rgb("7f9aa8"), rgb("b98a7a"), rgb("8fa58b"), rgb("c9b079"))
_GLAZE = (WHITE, rgb("3f5f7f"), rgb("9c4a3c"), rgb("c79a4b"), rgb("55705a"), rgb("b9aa94"))
_GLASS = (rgb("3f6b4f"), rgb("8c4a2f"), rgb("b8c9c4"), rgb("d9b25a"))
_WOOD = (rgb("b98a54"), rgb("7a5436"), rgb("d2b48c"))
_PAPER = (rgb("e8e2d4"), rgb("9c4a3c"), rgb("3f5f7f"), rgb("c79a4b"), rgb("55705a"))
SPINES = (*_PAPER, rgb("6b4a63"), rgb("2f3b4a"), rgb("a9b7a0"))
"""Colours of book spines."""


@dataclass(frozen=True, slots=True)
class Piece:
    """A shape of a decorative object."""

    form: str
    size: Vector
    colors: tuple[Color, ...]
    up: float = 0.0
    """Height of a shape's lower end above that of its decorative object, in metres."""
    turn: float = 0.0


def _one(form: str, size: Vector, *colors: Color) -> tuple[Piece, ...]:
    return (Piece(form, size, colors),)


def _stack(*thicknesses: float) -> tuple[Piece, ...]:
    """Makes a stack of books or papers, each slightly turned."""
    bottoms = [sum(thicknesses[:index]) for index in range(len(thicknesses))]
    return tuple(
        Piece("block", (0.15 + 0.02 * (index % 2), 0.21, thick), SPINES, up, 0.25 * (-1) ** index)
        for index, (thick, up) in enumerate(zip(thicknesses, bottoms, strict=True))
    )


THINGS: dict[str, tuple[Piece, ...]] = {
    "board": _one("bevel", (0.05, 0.26, 0.36), *_WOOD),
    "book_stack": _stack(0.03, 0.024, 0.035),
    "books_two": _stack(0.028, 0.022),
    "bottle": _one("bottle", (0.075, 0.075, 0.29), *_GLASS),
    "bottles_small": (Piece("bottle", (0.05, 0.05, 0.16), (WHITE, *_GLAZE[1:3])),),
    "bowl": _one("bowl", (0.22, 0.22, 0.09), *_GLAZE),
    "box": _one("bevel", (0.2, 0.26, 0.14), *_CLOTH, *_WOOD),
    "candle": (Piece("plate", (0.1, 0.1, 0.012), (STEEL,)), Piece("glass", (0.055, 0.055, 0.1), (WHITE,), 0.008)),
    "clock": (Piece("bevel", (0.05, 0.1, 0.1), (rgb("2f3b4a"),)), Piece("block", (0.002, 0.08, 0.08), (WHITE,), 0.01)),
    "folded": tuple(Piece("soft", (0.22, 0.3, 0.055), _CLOTH, 0.05 * index) for index in range(3)),
    "frame": (
        Piece("block", (0.018, 0.16, 0.21), _WOOD), Piece("block", (0.022, 0.12, 0.16), _CLOTH, 0.025),
    ),
    "fruit": (
        Piece("bowl", (0.26, 0.26, 0.08), _GLAZE),
        Piece("fruit", (0.19, 0.19, 0.12), (rgb("c9573d"), rgb("d9a441"), rgb("8fae4a")), 0.03),
    ),
    "glass": _one("glass", (0.07, 0.07, 0.11), rgb("c5d8de"), rgb("a9c4cf")),
    "herb": (Piece("pot", (0.11, 0.11, 0.1), (_CLAY, WHITE)), Piece("bush", (0.2, 0.2, 0.17), (_LEAF,), 0.08)),
    "jar": _one("jar", (0.1, 0.1, 0.16), *_GLAZE),
    "jar_small": _one("jar", (0.07, 0.07, 0.1), rgb("c79a4b"), rgb("9c4a3c"), rgb("d8d2c4")),
    "kettle": _one("kettle", (0.25, 0.17, 0.23), CHROME, STEEL, rgb("9c4a3c")),
    "knives": (Piece("bevel", (0.1, 0.1, 0.2), _WOOD), Piece("block", (0.06, 0.07, 0.06), (rgb("2f3236"),), 0.2)),
    "mug": _one("mug", (0.082, 0.082, 0.09), *_GLAZE),
    "pan": _one("pan", (0.42, 0.24, 0.05), rgb("3a3d41")),
    "papers": (Piece("block", (0.21, 0.297, 0.012), (rgb("f4f2ed"),)),),
    "pens": (Piece("glass", (0.075, 0.075, 0.1), _GLAZE), Piece("sprigs", (0.06, 0.06, 0.06), (rgb("2f3b4a"),), 0.09)),
    "plant": (
        Piece("pot", (0.15, 0.15, 0.14), (_CLAY, *_GLAZE)), Piece("sprigs", (0.3, 0.3, 0.3), (_DARK_LEAF,), 0.11),
    ),
    "plant_bushy": (Piece("pot", (0.14, 0.14, 0.13), _GLAZE), Piece("bush", (0.28, 0.28, 0.24), (_LEAF,), 0.1)),
    "plates": tuple(Piece("plate", (0.24, 0.24, 0.022), (CERAMIC,), 0.012 * index) for index in range(5)),
    "pot": (
        Piece("jar", (0.24, 0.24, 0.17), (STEEL, rgb("9c4a3c"))),
        Piece("ball", (0.03, 0.03, 0.025), (rgb("2f3236"),), 0.17),
    ),
    "remote": (Piece("bevel", (0.17, 0.045, 0.018), (rgb("2f3236"),)),),
    "roll": _one("jar", (0.11, 0.11, 0.22), WHITE),
    "soap": _one("bottle", (0.07, 0.07, 0.18), *_GLAZE),
    "vase": (Piece("vase", (0.11, 0.11, 0.2), _GLAZE), Piece("sprigs", (0.22, 0.22, 0.18), (_LEAF,), 0.17),
             Piece("flowers", (0.2, 0.2, 0.1), (rgb("d98b8b"), rgb("e3c15a"), rgb("b59ac9"), WHITE), 0.28)),
}  # fmt: skip
"""Shapes of each small object, with their possible colours."""


def footprint_m(thing: str) -> tuple[float, float]:
    """Returns depth and width of a decorative object, in metres."""
    sizes = [(piece.size[0], piece.size[1], abs(cos(piece.turn)), abs(sin(piece.turn))) for piece in THINGS[thing]]
    return max(c * x + s * y for x, y, c, s in sizes), max(s * x + c * y for x, y, c, s in sizes)


def placed(
    name: str, thing: str, spot: Vector, yaw: float, shapes: Shapes, dice: Random
) -> Iterator[Ornament]:  # fmt: skip
    """Yields the geoms of a decorative object at a position."""
    for index, piece in enumerate(THINGS[thing]):
        center = (spot[0], spot[1], spot[2] + piece.up + piece.size[2] / 2)
        numbered, color = name if index == 0 else f"{name}_{index}", dice.choice(piece.colors)
        yield shapes.drawn(numbered, piece.form, piece.size, center, color, yaw + piece.turn)


_THICK_M = (0.026, 0.034, 0.042)
_HEIGHTS = (0.8, 0.9, 1.0)
_STEP_M = 0.02
"""Step between heights of books, in metres: with few sizes there are few meshes."""
_DEEP_M = 0.12


def book_row(
    name: str, foot: Vector, yaw: float, size: Vector, shapes: Shapes, dice: Random
) -> Iterator[Ornament]:  # fmt: skip
    """Yields the geoms of a row of books.

    Args:
        name: Name of the row; books are numbered.
        foot: Middle of the box's lower side.
        yaw: Direction that the books' spines face, in radians.
        size: Depth, width and height of the box; all books are as deep.
        shapes: Gathers their meshes.
        dice: Random source for thickness, height and colour of the books.
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


def shaped(item: Furniture, shapes: Shapes) -> Iterator[tuple[Solid, list[Ornament]]]:
    """Yields a piece of furniture's parts, each with the decorative meshes that replace it.

    The list is empty for a part that is drawn as it is.
    """
    for part, solid in zip(parts_of(item), solids_of(item), strict=True):
        if item.model_type == "Bookcases" and part.name.startswith("books-"):
            yield solid, list(_books(item, part, solid, shapes))
            continue
        form = form_of(item.model_type, part)
        name = f"{solid.name}_seen" if part.solid else solid.name
        yield solid, [shapes.drawn(name, form, part.size, solid.center, part.color, item.yaw)] if form else []


def _books(item: Furniture, part: Part, solid: Solid, shapes: Shapes) -> Iterator[Ornament]:
    dice = Random(f"{item.id} {item.style} {part.name}")  # noqa: S311 (chance, not secrecy)
    x, y, z = solid.center
    name = f"book_{item.id}_{part.name.removeprefix('books-').replace('-', '_')}"
    return book_row(name, (x, y, z - part.size[2] / 2), item.yaw, part.size, shapes, dice)
