"""The view from a window: sky over a hazy horizon, woods, neighbours' houses, trees, a hedge and a lawn.

It depends on the direction of view alone, and on the height of the eyes: a garden that goes all round the building.
"""

from math import pi
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.floating[Any]]

_EYE_M = 1.5
"""Height from which the garden is seen, in metres; rooms are on the ground floor."""
_HEDGE_M = (11.0, 1.05)
"""Distance of the hedge from the eyes, and its height, in metres: below the horizon, so that one looks over it."""
_SIDE = 64
"""Cells of the noise table each way; a power of two, so that remainders are cheap."""
_HAZE_RISE = 0.22
"""Tangent of the height up to which haze makes the sky pale."""
_TREES = 13
"""Trees all round."""
_HOUSES = 7
"""Houses all round: most windows show a part of one."""
_FLOOR_M, _FLOORS, _GABLE_M, _HALF_M = 2.7, 2, 2.9, 4.6
"""Height of a storey, storeys, height of a gable and half the width of a house, in metres."""
_BAY_M, _PANE_M, _FRAME_M = 2.3, (0.95, 1.3), 0.09
"""Width of a part of a facade with one window, the window's width and height, and the width of its frame."""

_ZENITH, _BLUE, _HORIZON = np.array([0.42, 0.60, 0.87]), np.array([0.64, 0.78, 0.94]), np.array([0.98, 0.96, 0.92])
_CLOUD = np.array([1.0, 0.99, 0.97])
_HILLS, _WOODS, _WOODS_LIT = np.array([0.74, 0.79, 0.83]), np.array([0.38, 0.45, 0.36]), np.array([0.60, 0.65, 0.46])
_LEAF, _LEAF_LIT, _BARK = np.array([0.16, 0.23, 0.10]), np.array([0.66, 0.71, 0.36]), np.array([0.36, 0.31, 0.26])
_GRASS, _GRASS_LIT, _HAZE = np.array([0.38, 0.49, 0.22]), np.array([0.60, 0.67, 0.36]), np.array([0.86, 0.88, 0.86])
_WALLS = np.array([[0.93, 0.90, 0.84], [0.86, 0.72, 0.58], [0.90, 0.84, 0.72], [0.72, 0.47, 0.38], [0.84, 0.86, 0.86]])
_ROOFS = np.array([[0.60, 0.36, 0.28], [0.42, 0.40, 0.42], [0.52, 0.40, 0.33]])
_PANE, _PANE_LIT, _FRAME = np.array([0.28, 0.34, 0.40]), np.array([0.66, 0.76, 0.86]), np.array([0.96, 0.95, 0.93])


class _Tree(NamedTuple):
    """A tree in the garden."""

    azimuth: float
    away_m: float
    tall_m: float
    wide_m: float


def outside(rays: Array) -> Array:
    """Returns what is seen of the surroundings in directions, as colours from 0 to 1.

    Args:
        rays: Directions, shape (n, 3).
    """
    if len(rays) == 0:
        return np.zeros((0, 3))
    flat = np.maximum(np.hypot(rays[:, 0], rays[:, 1]), 1e-6)
    rise, azimuth = rays[:, 2] / flat, np.arctan2(rays[:, 1], rays[:, 0])
    colors = _sky(rays, rise)
    colors = _over(colors, _HILLS, 0.8 * _soft(0.035 + 0.03 * _ridge(azimuth, 2.2) - rise, 0.006))
    colors = _woods(colors, azimuth, rise)
    colors = _lawn(colors, rays, rise)
    for number in range(_HOUSES):
        middle = (number + 0.3 * noise(np.full(1, number * 3.7), np.zeros(1))[0]) * 2 * pi / _HOUSES
        colors = _house(colors, _turned(azimuth - middle), rise, 20.0 + 5.0 * (number % 3), number)
    colors = _hedge(colors, azimuth, rise)
    for tree in _trees():
        colors = _tree(colors, _turned(azimuth - tree.azimuth), rise, tree)
    return colors


def _sky(rays: Array, rise: Array) -> Array:
    """Blue above and pale over the horizon, with thin clouds."""
    high = np.clip(rise / 1.4, 0, 1)[:, None]
    clear = _BLUE + (_ZENITH - _BLUE) * np.sqrt(high)
    sky = clear + (_HORIZON - clear) * np.exp(-np.clip(rise, 0, None) / _HAZE_RISE)[:, None]
    over = np.maximum(rays[:, 2], 0.02)
    u, v = rays[:, 0] / over, rays[:, 1] / over
    clouds = 0.5 * noise(u * 0.7, v * 0.7) + 0.3 * noise(u * 1.7 + 9, v * 1.7) + 0.2 * noise(u * 4.7, v * 4.7 + 5)
    return _over(sky, _CLOUD, 0.6 * np.clip((clouds - 0.5) / 0.25, 0, 1) * np.clip(rise / 0.15, 0, 1))


def _woods(colors: Array, azimuth: Array, rise: Array) -> Array:
    """Adds the edge of a far wood, in haze."""
    line = 0.025 + 0.035 * _ridge(azimuth, 5) + 0.018 * _ridge(azimuth, 30) + 0.008 * _ridge(azimuth, 90)
    leaves = _WOODS + (_WOODS_LIT - _WOODS) * _leaves(azimuth * 40, rise * 46)[:, None]
    hazy = leaves + (_HAZE - leaves) * 0.42
    return _over(colors, hazy, _soft(line - rise, 0.004))


def _lawn(colors: Array, rays: Array, rise: Array) -> Array:
    """Adds grass up to the horizon to the colours of rays, and returns them; blades are told apart near by only."""
    away = np.clip(_EYE_M / np.maximum(-rise, 0.01), 0, 120)
    flat = np.maximum(np.hypot(rays[:, 0], rays[:, 1]), 1e-6)
    x, y = rays[:, 0] / flat * away, rays[:, 1] / flat * away
    near = np.clip(1 - away / 14, 0, 1)
    light = 0.5 + 0.35 * (noise(x * 0.5, y * 0.5) - 0.5) + near * 0.5 * (noise(x * 9, y * 9) - 0.5)
    grass = _GRASS + (_GRASS_LIT - _GRASS) * np.clip(light, 0, 1)[:, None]
    hazy = grass + (_HAZE - grass) * np.clip(away / 160, 0, 0.6)[:, None]
    return _over(colors, hazy, _soft(-rise, 0.003))


def _house(colors: Array, turned: Array, rise: Array, away_m: float, number: int) -> Array:
    """Adds a house: a facade with rows of windows below a gable, or below a roof that faces the eyes."""
    near = np.flatnonzero((np.abs(turned) * away_m < _HALF_M + 0.6) & (rise > -0.1) & (rise < 0.5))
    if len(near) == 0:
        return colors
    across, up = turned[near] * away_m, rise[near] * away_m + _EYE_M
    eaves, edge = _FLOOR_M * _FLOORS, 0.0016 * away_m
    slope = 1 - np.abs(across) / (_HALF_M + 0.3)
    is_gable = number % 2 == 0
    top = eaves + 0.1 + (_GABLE_M * slope if is_gable else 0.0)
    in_width = _soft(_HALF_M - np.abs(across), edge)
    light = 0.95 + 0.05 * noise(across * 3, up * 3) - 0.10 * np.clip((up - top + 0.45) / 0.3, 0, 1)
    wall = _WALLS[number % len(_WALLS)] * light[:, None]
    seen = _over(colors[near], wall, in_width * _soft(up, edge) * _soft(top - up, edge))
    seen = _windows(seen, across, up, edge)
    tiles = _ROOFS[number % len(_ROOFS)] * (0.86 + 0.1 * noise(across * 5, up * 9) + 0.08 * np.sin(up * 20))[:, None]
    if is_gable:
        roof = _soft(up - top, edge) * _soft(top + 0.28 - up, edge) * _soft(slope, 0.01)
    else:
        lean = _HALF_M + 0.4 - 0.25 * np.clip(up - eaves, 0, None)
        roof = _soft(up - eaves + 0.1, edge) * _soft(eaves + 2.4 - up, edge) * _soft(lean - np.abs(across), edge)
    seen = _over(seen, tiles, roof)
    hazy = seen + (_HAZE - seen) * 0.12
    colors = colors.copy()
    colors[near] = hazy
    return colors


def _windows(colors: Array, across: Array, up: Array, edge: float) -> Array:
    """Adds the windows of a facade, in whose panes the sky is mirrored."""
    right = (across + _HALF_M) % _BAY_M - _BAY_M / 2
    high = up % _FLOOR_M - 0.52 * _FLOOR_M
    wide, tall = _PANE_M[0] / 2, _PANE_M[1] / 2
    there = _soft(_FLOOR_M * _FLOORS - up, edge) * (up > 0) * (np.abs(across) < _HALF_M - 0.25)
    frame = there * _soft(wide + _FRAME_M - np.abs(right), edge) * _soft(tall + _FRAME_M - np.abs(high), edge)
    colors = _over(colors, _FRAME, frame)
    pane = there * _soft(wide - np.abs(right), edge) * _soft(tall - np.abs(high), edge)
    pane = pane * _soft(np.abs(right) - 0.03, edge)
    glass = (
        _PANE + (_PANE_LIT - _PANE) * np.clip(0.5 + high + 0.6 * (noise(across * 0.8, up * 0.8) - 0.5), 0, 1)[:, None]
    )
    return _over(colors, glass, pane)


def _hedge(colors: Array, azimuth: Array, rise: Array) -> Array:
    """Adds a trimmed hedge at the end of the lawn: lit from above, dark at its foot."""
    away, tall = _HEDGE_M
    across, up = azimuth * away, rise * away + _EYE_M
    leaves = _leaves(across * 5, up * 5)
    edge = tall + 0.10 * (_ridge(azimuth, 0.8 * away) - 0.5) + 0.12 * (leaves - 0.5)
    light = np.clip(0.05 + 0.5 * up / tall + 1.1 * (leaves - 0.42), 0, 1)
    paint = _LEAF + (_LEAF_LIT - _LEAF) * light[:, None]
    hazy = paint + (_HAZE - paint) * 0.06
    return _over(colors, hazy, _soft(edge - up, 0.05) * _soft(up, 0.05))


def _tree(colors: Array, turned: Array, rise: Array, tree: _Tree) -> Array:
    """Adds a tree: a crown of many leaves, lit from above and aside, with holes and a ragged outline.

    The colours given stay as they are; returns the new ones.
    """
    across, up = turned * tree.away_m, rise * tree.away_m + _EYE_M
    near = (np.abs(across) < tree.wide_m * 0.75) & (up > 0) & (up < tree.tall_m * 1.15)
    if not near.any():
        return colors
    x, z = across[near], up[near]
    sway = 0.25 * (noise(z * 0.8 + tree.azimuth, z * 0.3) - 0.5)
    trunk = _soft(0.10 + 0.06 * np.clip(1 - z, 0, 1) - np.abs(x - sway), 0.03)
    middle, half = tree.tall_m * 0.62, tree.tall_m * 0.40
    shift = tree.azimuth * 7
    lumps = 0.6 * noise(x * 0.9 + shift, z * 0.9) + 0.4 * noise(x * 2.4 + shift, z * 2.4)
    leaves = _leaves(x * 3.4 + shift, z * 3.4)
    crown = np.hypot(x / (tree.wide_m * 0.5), (z - middle) / half) + 0.85 * (lumps - 0.45) + 0.7 * (leaves - 0.5)
    lit = 0.30 * (z - middle) / half + 0.20 * x / tree.wide_m
    light = np.clip(0.36 + lit + 1.5 * (leaves - 0.5) + 0.7 * (lumps - 0.5), 0, 1)
    seen = _over(colors[near], _BARK, trunk * (z < middle))
    hue = _LEAF_LIT * (0.85 + 0.3 * noise(np.full(1, tree.azimuth * 5), np.zeros(1)))
    paint = _LEAF + (hue - _LEAF) * light[:, None]
    hazy = paint + (_HAZE - paint) * min(0.3, tree.away_m / 90)
    holes = np.clip((leaves - 0.34) / 0.08, 0, 1) * 0.75 + 0.25
    seen = _over(seen, hazy, _soft(1 - crown, 0.10) * holes)
    colors = colors.copy()
    colors[near] = seen
    return colors


def _leaves(u: Array, v: Array) -> Array:
    """Returns noise of leaves and of the branches that they are on, 0 to 1."""
    total = 0.30 * noise(u, v) + 0.26 * noise(u * 2.3 + 5, v * 2.3) + 0.24 * noise(u * 5.1, v * 5.1 + 3)
    return total + 0.20 * noise(u * 11.7 + 9, v * 11.7)


def _trees() -> list[_Tree]:
    """Makes trees all round, further ones first: a nearer one is painted over them. They are the same at every call."""
    rng = np.random.default_rng(21)
    made = [
        _Tree(
            (number + 0.75 * float(rng.random())) * 2 * pi / _TREES,
            float(rng.uniform(15, 34)),
            float(rng.uniform(5, 9)),
            float(rng.uniform(3.5, 6.5)),
        )
        for number in range(_TREES)
    ]
    return sorted(made, key=lambda tree: -tree.away_m)


def _turned(angles: Array) -> Array:
    """Returns angles between -pi and pi."""
    return (angles + pi) % (2 * pi) - pi


def _soft(over: Array, width: float) -> Array:
    """Returns 1 where a value is above 0, 0 where it is below, and a short way between."""
    return np.clip(over / width + 0.5, 0, 1)


def _over(colors: Array, paint: Array, share: Array) -> Array:
    return colors + (paint - colors) * share[:, None]


def _ridge(azimuth: Array, bumps: float) -> Array:
    """Returns noise from 0 to 1 all round, without a seam: `bumps` of them in a radian."""
    return noise(np.cos(azimuth) * bumps + 31, np.sin(azimuth) * bumps + 31)


_TABLE = np.random.default_rng(17).random((_SIDE, _SIDE))


def noise(u: Array, v: Array) -> Array:
    """Returns smooth noise from 0 to 1 at places; its bumps are one unit apart."""
    i, j = np.floor(u).astype(np.int64), np.floor(v).astype(np.int64)
    s, t = u - i, v - j
    s, t = s * s * (3 - 2 * s), t * t * (3 - 2 * t)
    i, j, after_i, after_j = i & (_SIDE - 1), j & (_SIDE - 1), (i + 1) & (_SIDE - 1), (j + 1) & (_SIDE - 1)
    low = _TABLE[j, i] * (1 - s) + _TABLE[j, after_i] * s
    high = _TABLE[after_j, i] * (1 - s) + _TABLE[after_j, after_i] * s
    return low * (1 - t) + high * t
