"""View from the windows: sky, distant trees and a lawn, in one picture that MuJoCo folds into a box."""

import io
from functools import lru_cache

import numpy as np
from PIL import Image

from .texture_patterns import Array, Grid

SKY = "sky"
"""Its name."""

LAYOUT = 'gridsize="3 4" gridlayout=".U..LFRB.D.."'
"""How the picture's squares lie, as MJCF says it."""

_SIDE_PIXELS = 160
_COLORS = 96
_ZENITH, _HORIZON = np.array([0.55, 0.71, 0.88]), np.array([0.88, 0.92, 0.95])
_NEAR, _FAR = np.array([0.46, 0.58, 0.34]), np.array([0.64, 0.72, 0.55])
_TREES, _TREES_FAR = np.array([0.33, 0.46, 0.30]), np.array([0.55, 0.66, 0.58])


@lru_cache(maxsize=1)
def sky_png() -> bytes:
    """The picture as PNG: three squares high, four wide."""
    side = _SIDE_PIXELS
    # Every side is the same, so that trees go on from one to the next.
    picture = np.zeros((3 * side, 4 * side, 3))
    picture[side : 2 * side] = np.tile(_horizon(side), (1, 4, 1))
    picture[:side, side : 2 * side] = _above(side)
    picture[2 * side :, side : 2 * side] = _NEAR
    pixels = np.rint(np.clip(picture, 0, 1) * 255).astype(np.uint8)
    buffer = io.BytesIO()
    Image.fromarray(pixels).quantize(
        _COLORS, method=Image.Quantize.MEDIANCUT, dither=Image.Dither.NONE
    ).save(buffer, format="PNG", compress_level=6)  # fmt: skip
    return buffer.getvalue()


def _horizon(side: int) -> Array:
    """One of the four sides."""
    across = (np.arange(side) + 0.5) / side * 2 - 1
    up = -((np.arange(side) + 0.5) / side * 2 - 1)
    # Tangent of the angle above the horizon.
    rise = up[:, None] / np.sqrt(1 + across * across)
    colors = _sky(rise)
    grid = Grid(side, side, 1.0, 1.0, np.random.default_rng(7))
    for color, base, height, bumps in ((_TREES_FAR, 0.03, 0.06, 9), (_TREES, 0.005, 0.1, 6)):
        line = base + height * (0.75 * grid.noise(bumps, 1)[0] + 0.25 * grid.noise(bumps * 4, 1)[0])
        leaves = 0.9 + 0.2 * grid.clouds(24, 24)[..., None]
        share = np.clip((line - rise) / 0.03 + 0.5, 0, 1)[..., None]
        colors = colors + (color * leaves - colors) * share
    lawn = _FAR + (_NEAR - _FAR) * np.clip(-rise / 0.5, 0, 1)[..., None]
    return colors + (lawn - colors) * np.clip(-rise / 0.02 + 0.5, 0, 1)[..., None]


def _above(side: int) -> Array:
    """Sky overhead; its edges have the colours of the sides' top edges."""
    x = (np.arange(side) + 0.5) / side * 2 - 1
    return _sky(1 / np.maximum(np.sqrt(x[:, None] ** 2 + x**2), 1e-3))


def _sky(rise: Array) -> Array:
    share = np.clip(rise / 1.2, 0, 1)
    share = share * (2 - share)
    return _HORIZON + (_ZENITH - _HORIZON) * share[..., None]
