"""Materials of floors and walls: what they look like, how they grip, and which rooms usually have them."""

from dataclasses import dataclass
from typing import Literal

from ...schemas.world import FLOOR_MATERIALS, WALL_MATERIALS, RoomType
from .parts import Color, rgb

Pattern = Literal["plain", "boards", "blocks", "tiles", "bricks", "stones", "panels", "speckles", "stripes"]


@dataclass(frozen=True, slots=True)
class Material:
    """One material of a floor or a wall."""

    color: Color
    """What one sees of it on the whole."""
    second: Color
    """Of the other boards, stripes, stones."""
    line: Color
    """Of joints and specks."""
    pattern: Pattern
    """How the colours are laid out."""
    cell_m: tuple[float, float]
    """Length and height of one board, tile or stripe."""
    friction: float = 0.8
    """Sliding friction of a floor with rubber; walls do not use it."""


FLOORS: dict[str, Material] = {
    "Carpet": Material(rgb("b7aea6"), rgb("aba198"), rgb("9d938a"), "speckles", (0.02, 0.02), 1.1),
    "Concrete": Material(rgb("b4b6b5"), rgb("abadac"), rgb("9b9d9c"), "speckles", (1.6, 1.6), 0.9),
    "Floorboards": Material(rgb("c9a377"), rgb("bd956a"), rgb("9d7850"), "boards", (1.2, 0.16), 0.75),
    "Linoleum": Material(rgb("b9c4b4"), rgb("a9b6a5"), rgb("9aa896"), "blocks", (0.6, 0.6), 0.85),
    "Parquetry": Material(rgb("b4824f"), rgb("9c6c3e"), rgb("7f552e"), "blocks", (0.4, 0.4), 0.7),
    "Tiles": Material(rgb("e3e4e2"), rgb("dadcda"), rgb("b9bcbb"), "tiles", (0.45, 0.45), 0.65),
}
"""The six floor materials."""

WALLS: dict[str, Material] = {
    "Brick": Material(rgb("a5593f"), rgb("b46a4f"), rgb("d2c3b5"), "bricks", (0.24, 0.08)),
    "Concrete": Material(rgb("b3b4b2"), rgb("a9aaa8"), rgb("989997"), "speckles", (1.2, 1.2)),
    "Stone": Material(rgb("a39a8c"), rgb("8f8779"), rgb("75705f"), "stones", (0.5, 0.3)),
    "Tiles": Material(rgb("d9e6e6"), rgb("cfdede"), rgb("b3c3c4"), "tiles", (0.2, 0.2)),
    "WoodPanels": Material(rgb("b58a5c"), rgb("a77c4f"), rgb("83603b"), "panels", (0.14, 3.0)),
    "WallPaint": Material(rgb("ece4d6"), rgb("ece4d6"), rgb("ddd3c3"), "plain", (1.0, 1.0)),
    "Wallpaper": Material(rgb("cdd9d2"), rgb("b9cabf"), rgb("a3b8aa"), "stripes", (0.24, 3.0)),
}
"""The seven wall materials."""

OUTSIDE = Material(rgb("e6dfd3"), rgb("e6dfd3"), rgb("d2c9ba"), "plain", (1.0, 1.0))
"""Outer faces of exterior walls."""

USUAL_FLOORS: dict[RoomType, tuple[str, ...]] = {
    "Bedroom": ("Carpet", "Floorboards", "Parquetry"),
    "Bathroom": ("Tiles", "Tiles", "Linoleum"),
    "Living": ("Floorboards", "Parquetry", "Carpet"),
    "Dining": ("Floorboards", "Parquetry"),
    "Kitchen": ("Tiles", "Linoleum", "Floorboards"),
    "Hallway": ("Floorboards", "Tiles", "Concrete"),
    "Closet": ("Carpet", "Linoleum", "Concrete"),
}
USUAL_WALLS: dict[RoomType, tuple[str, ...]] = {
    "Bedroom": ("WallPaint", "Wallpaper", "WoodPanels"),
    "Bathroom": ("Tiles", "Tiles", "Stone"),
    "Living": ("WallPaint", "Wallpaper", "Brick", "Stone"),
    "Dining": ("WallPaint", "Wallpaper", "WoodPanels"),
    "Kitchen": ("WallPaint", "Tiles", "Brick"),
    "Hallway": ("WallPaint", "Concrete"),
    "Closet": ("WallPaint", "WoodPanels"),
}

assert set(FLOORS) == set(FLOOR_MATERIALS)
assert set(WALLS) == set(WALL_MATERIALS)
