"""Floor patterns of the preview as small tiles that repeat."""

from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .materials import FLOORS, Material

PIXELS_PER_M = 100
TILE_M = 7.2
"""A whole number of every pattern's cells."""

_SIDE = round(TILE_M * PIXELS_PER_M)
_SEED = 20
_LINE_M = 0.012

Pixels = NDArray[np.uint8]


@lru_cache(maxsize=16)
def floor_tile(name: str) -> Pixels:
    """A floor material as pixels of shape (side * side, 3), row by row from the south."""
    material = FLOORS[name]
    rng = np.random.default_rng(_SEED)
    x, y = np.meshgrid(*[(np.arange(_SIDE) + 0.5) / PIXELS_PER_M] * 2)
    first, second, line = (np.array(color[:3]) for color in (material.color, material.second, material.line))
    if material.pattern == "speckles":
        grain = rng.normal(0.0, 0.35, (_SIDE // 2, _SIDE // 2)).repeat(2, axis=0).repeat(2, axis=1)
        share = np.clip(0.5 + grain, 0, 1)[..., None]
        return _bytes(first * (1 - share) + second * share)
    row, column, joint = _cells(material, x, y)
    tones = rng.random((64, 64))[row % 64, column % 64]
    if material.pattern == "blocks":
        checked = ((row + column) % 2)[..., None]
        base = first * (1 - checked) + second * checked
        colors = base * (0.98 + 0.04 * tones[..., None])
        if name == "Parquetry":
            colors = colors * _slats(x, y, row, column)[..., None]
    else:
        colors = first * (1 - tones[..., None]) + second * tones[..., None]
    colors = np.where(joint[..., None], line, colors)
    return _bytes(colors)


def sample(name: str, x: NDArray[np.floating[Any]], y: NDArray[np.floating[Any]]) -> Pixels:
    """Colours of a floor at places, shape (n, 3)."""
    columns = ((x + 40 * TILE_M) * PIXELS_PER_M).astype(np.int32) % _SIDE
    rows = ((y + 40 * TILE_M) * PIXELS_PER_M).astype(np.int32) % _SIDE
    return floor_tile(name)[rows * _SIDE + columns]


def _cells(
    material: Material, x: NDArray[np.float64], y: NDArray[np.float64]
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.bool_]]:
    """Row and column of the board or tile at every pixel, and where the joints are."""
    length, height = material.cell_m
    row = np.floor(y / height).astype(np.int64)
    # Boards of neighbouring rows do not end at the same place.
    shift = (row * 5 % 12) / 12 * length if material.pattern == "boards" else 0.0
    column = np.floor((x + shift) / length).astype(np.int64) % round(TILE_M / length)
    along, across = (x + shift) / length % 1 * length, y / height % 1 * height
    return row, column, (along < _LINE_M) | (across < _LINE_M)


def _slats(
    x: NDArray[np.float64], y: NDArray[np.float64], row: NDArray[np.int64], column: NDArray[np.int64]
) -> NDArray[np.float64]:
    """Parquetry blocks are made of slats that turn from block to block."""
    position = np.where((row + column) % 2 == 0, x, y)
    return np.where(position / 0.1 % 1 < 0.1, 0.88, 1.0)


def _bytes(colors: NDArray[np.float64]) -> Pixels:
    return np.rint(np.clip(colors, 0, 1) * 255).astype(np.uint8).reshape(-1, 3)
