"""Details that only pictures draw on plain surfaces: panels of doors, weave of cloth, drawings in frames.

Worlds keep their plain boxes, which robots touch; their pictures show how such furniture is made.
"""

import re

import numpy as np

from .outside import noise
from .ray_casting import Array

_PANELLED = re.compile(r"\.front-\d|\.door-(front|side)$|^cabinet_\w+_door_\d+$")
"""Names of doors and drawers of cupboards."""
_CLOTH = re.compile(
    r"^(Sofas|LivingRoomChairs|Ottomans|Beds|StorageBenches|DeskChairs)_\d+\.(?!leg|foot|plinth|column|castor|frame)"
    r"|^(Clothes_\d+|DiningChairs_\d+\.pad)|^(rug|curtain|blind)_\d*(?!.*_(rod|bar)$)"
)
"""Names of what is covered with cloth."""
_LEAST_PANEL_M = 0.22
"""Smaller doors and drawers are plain."""
_FRAME_M, _SLOPE_M = 0.055, 0.008
"""Width of a door's frame, and of the slope down to its panel."""
_SLOPE_SHADE, _PANEL_SHADE = 0.8, 0.97
_THREADS_PER_M, _FOLDS_PER_M = 210.0, 14.0
_WEAVE, _CREASE = 0.13, 0.09
"""Differences of brightness between threads of cloth, and between its places, of 1."""


def is_panelled(name: str, half: Array) -> bool:
    """Returns whether a box of half extents `half`, in metres, is a door or drawer with a panel."""
    return bool(_PANELLED.search(name.removesuffix("_seen"))) and float(np.sort(half)[1]) * 2 > _LEAST_PANEL_M


def is_cloth(name: str) -> bool:
    """Returns whether a geom of this name is covered with cloth."""
    return bool(_CLOTH.search(name.removesuffix("_seen")))


def panel(inside: Array, half: Array) -> tuple[Array, Array]:
    """Finds the slopes between frames and panels of doors.

    Args:
        inside: Places on boxes, in metres from their middles, shape (n, 3).
        half: Half extents of the boxes, shape (n, 3).

    Returns:
        Where the surface turns on the slopes, shape (n, 3), and the share of light there, shape (n,).
    """
    rows = np.arange(len(inside))
    thick = np.argmin(half, axis=1)
    from_edge = half - np.abs(inside)
    from_edge[rows, thick] = np.inf
    nearest = np.argmin(from_edge, axis=1)
    away = from_edge[rows, nearest]
    on_face = np.abs(inside[rows, thick]) > 0.9 * half[rows, thick]
    slope = on_face & (away > _FRAME_M) & (away < _FRAME_M + _SLOPE_M)
    turned = np.zeros_like(inside)
    turned[rows, nearest] = -np.sign(inside[rows, nearest]) * slope
    deep = on_face & (away >= _FRAME_M + _SLOPE_M)
    return turned, np.where(slope, _SLOPE_SHADE, np.where(deep, _PANEL_SHADE, 1.0))


def weave(places: Array) -> Array:
    """Returns the brightness of cloth at places, shape (n,): threads, and places where it lies otherwise."""
    x, y, z = places.T
    right, up = x + 0.37 * z, y - 0.61 * z
    threads = 0.5 * noise(right * _THREADS_PER_M, up * 40) + 0.5 * noise(right * 40, up * _THREADS_PER_M)
    folds = noise(right * _FOLDS_PER_M, up * _FOLDS_PER_M)
    return 1 + _WEAVE * (threads - 0.5) + _CREASE * (folds - 0.5)


def drawn(colors: Array, inside: Array, half: Array, seeds: Array) -> Array:
    """Returns the colours of prints in frames: hills in the print's own colours.

    Args:
        colors: The plain colours, shape (n, 3).
        inside: Places on the prints, in metres from their middles, shape (n, 3).
        half: Half extents, shape (n, 3).
        seeds: A number for each print, shape (n,).
    """
    rows = np.arange(len(inside))
    flat = half.copy()
    flat[:, 2] = np.inf
    # Walls run along one axis: the print's width is the longer of the two level ones.
    wide = np.argmax(half[:, :2], axis=1)
    along = inside[rows, wide] / np.maximum(half[rows, wide], 1e-6)
    up = inside[:, 2] / np.maximum(half[:, 2], 1e-6)
    shade = np.ones(len(rows))
    for layer in range(3):
        ridge = 0.75 - 0.62 * layer + 0.5 * (noise(along * (1.3 + layer) + 7.7 * seeds, seeds + 3.1 * layer) - 0.5)
        shade = np.where(up < ridge, 0.93 - 0.13 * layer, shade)
    return colors * shade[:, None]
