"""The view from a window: sky with clouds, hills, trees, a neighbour's house, a hedge and a lawn.

It depends on the direction of view alone, and on the height of the eyes: a garden that goes all round the building.
"""

from math import pi
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.floating[Any]]

_EYE_M = 1.5
"""Height from which the garden is seen, in metres; rooms are on the ground floor."""
_HEDGE_M = (11.0, 1.25)
"""Distance of the hedge from the eyes, and its height, in metres: below the horizon, so that one looks over it."""
_SIDE = 64
"""Cells of the noise table each way; a power of two, so that remainders are cheap."""

_ZENITH, _HORIZON, _CLOUD = np.array([0.50, 0.66, 0.88]), np.array([0.86, 0.91, 0.95]), np.array([0.99, 0.99, 0.99])
_HILLS, _WOODS, _WOODS_LIT = np.array([0.62, 0.69, 0.72]), np.array([0.30, 0.37, 0.28]), np.array([0.54, 0.60, 0.42])
_LEAF, _LEAF_LIT, _BARK = np.array([0.13, 0.19, 0.10]), np.array([0.56, 0.62, 0.34]), np.array([0.30, 0.26, 0.22])
_GRASS, _GRASS_LIT, _HAZE = np.array([0.36, 0.45, 0.24]), np.array([0.55, 0.61, 0.38]), np.array([0.74, 0.80, 0.76])
_PLASTER, _ROOF, _PANE = np.array([0.88, 0.86, 0.82]), np.array([0.47, 0.36, 0.32]), np.array([0.34, 0.40, 0.44])


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
    colors = _over(colors, _HILLS, _soft(0.045 + 0.035 * _ridge(azimuth, 2.2) - rise, 0.004))
    colors = _woods(colors, azimuth, rise)
    colors = _lawn(colors, rays, rise)
    for number, azimuth_of_house in enumerate((0.55, 2.3, 3.9, 5.4)):
        colors = _house(colors, _turned(azimuth - azimuth_of_house), rise, 26.0 + 5 * number)
    colors = _hedge(colors, azimuth, rise)
    for tree in _trees():
        colors = _tree(colors, _turned(azimuth - tree.azimuth), rise, tree)
    return colors


def _sky(rays: Array, rise: Array) -> Array:
    share = np.sqrt(np.clip(rise / 1.4, 0, 1))[:, None]
    sky = _HORIZON + (_ZENITH - _HORIZON) * share
    high = np.maximum(rays[:, 2], 0.02)
    u, v = rays[:, 0] / high, rays[:, 1] / high
    clouds = 0.5 * noise(u * 0.9, v * 0.9) + 0.3 * noise(u * 2.1 + 9, v * 2.1) + 0.2 * noise(u * 4.7, v * 4.7 + 5)
    return _over(sky, _CLOUD, 0.75 * np.clip((clouds - 0.5) / 0.22, 0, 1) * np.clip(rise / 0.15, 0, 1))


def _woods(colors: Array, azimuth: Array, rise: Array) -> Array:
    """Adds the edge of a far wood to the colours of rays, and returns them."""
    line = 0.07 + 0.05 * _ridge(azimuth, 5) + 0.025 * _ridge(azimuth, 24)
    leaves = _WOODS + (_WOODS_LIT - _WOODS) * _leaves(azimuth * 22, rise * 26)[:, None]
    hazy = leaves + (_HAZE - leaves) * 0.3
    return _over(colors, hazy, _soft(line - rise, 0.006))


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


def _house(colors: Array, turned: Array, rise: Array, away_m: float) -> Array:
    """Adds a house with a gable roof and two windows to the colours of rays, and returns them.

    `turned` is each ray's direction aside from the house, in radians, and `rise` the tangent of its angle upwards.
    """
    across, up = turned * away_m, rise * away_m + _EYE_M
    wall = (np.abs(across) < 4.5) & (up > 0) & (up < 3.0)
    roof = (up >= 3.0) & (up < 3.0 + 2.6 * (1 - np.abs(across) / 5.1))
    pane = wall & (np.abs(np.abs(across) - 2.1) < 0.75) & (np.abs(up - 1.6) < 0.6)
    colors = _over(colors, _PLASTER * (0.93 + 0.07 * noise(across, up))[:, None], wall.astype(float))
    colors = _over(colors, _ROOF * (0.85 + 0.3 * noise(across * 2, up * 9))[:, None], roof.astype(float))
    return _over(colors, _PANE, pane.astype(float))


def _hedge(colors: Array, azimuth: Array, rise: Array) -> Array:
    """Adds shrubs of different heights, at the end of the lawn, to the colours of rays, and returns them."""
    away, tall = _HEDGE_M
    across, up = azimuth * away, rise * away + _EYE_M
    edge = tall * (0.55 + 0.9 * _ridge(azimuth, 0.45 * away)) + 0.35 * (_ridge(azimuth, 2.5 * away) - 0.5)
    edge = edge + 0.3 * (_leaves(across * 2.2, up * 2.2) - 0.5)
    light = 0.12 + 0.75 * _leaves(across * 1.6, up * 1.6) * np.clip(0.25 + up / tall, 0, 1)
    leaves = _LEAF + (_LEAF_LIT - _LEAF) * np.clip(light, 0, 1)[:, None]
    hazy = leaves + (_HAZE - leaves) * 0.08
    return _over(colors, hazy, _soft(edge - up, 0.08) * (up > 0))


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
    trunk = np.abs(x - sway) < 0.11 + 0.05 * np.clip(1 - z, 0, 1)
    middle, half = tree.tall_m * 0.6, tree.tall_m * 0.42
    shift = tree.azimuth * 7
    lumps = 0.6 * noise(x * 0.8 + shift, z * 0.8) + 0.4 * noise(x * 2.1 + shift, z * 2.1)
    leaves = _leaves(x * 2.6 + shift, z * 2.6)
    crown = np.hypot(x / (tree.wide_m * 0.5), (z - middle) / half) + 0.95 * (lumps - 0.45) + 0.5 * (leaves - 0.5)
    lit = 0.34 * (z - middle) / half + 0.16 * x / tree.wide_m
    light = np.clip(0.28 + lit + 0.9 * (leaves - 0.5) + 0.5 * (lumps - 0.5), 0, 1)
    seen = _over(colors[near], _BARK, (trunk & (z < middle)).astype(float))
    hue = _LEAF_LIT * (0.85 + 0.3 * noise(np.full(1, tree.azimuth * 5), np.zeros(1)))
    paint = _LEAF + (hue - _LEAF) * light[:, None]
    hazy = paint + (_HAZE - paint) * min(0.3, tree.away_m / 110)
    holes = np.clip((leaves - 0.26) / 0.12, 0, 1) * 0.6 + 0.4
    seen = _over(seen, hazy, _soft(1 - crown, 0.12) * holes)
    colors = colors.copy()
    colors[near] = seen
    return colors


def _leaves(u: Array, v: Array) -> Array:
    """Returns noise of leaves and of the branches that they are on, 0 to 1."""
    total = 0.4 * noise(u, v) + 0.27 * noise(u * 2.3 + 5, v * 2.3) + 0.19 * noise(u * 5.1, v * 5.1 + 3)
    return total + 0.14 * noise(u * 11.7 + 9, v * 11.7)


def _trees() -> list[_Tree]:
    """Makes trees all round, further ones first: a nearer one is painted over them. They are the same at every call."""
    rng = np.random.default_rng(21)
    made = [
        _Tree(
            (number + 0.75 * float(rng.random())) * 2 * pi / 17,
            float(rng.uniform(13, 32)),
            float(rng.uniform(5, 10)),
            float(rng.uniform(4.5, 8.5)),
        )
        for number in range(17)
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
