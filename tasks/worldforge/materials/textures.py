"""Textures of floor and wall materials and of the sky: small, seamless, and the same on every machine.

Only sums, products, comparisons and roundings make the pixels, from a seed that is the texture's own name.
"""

import io
import zlib
from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from . import texture_patterns as patterns
from .materials import Finish, Pattern, surface_finish
from .texture_patterns import Array, Grid

Pixels = NDArray[np.uint8]

_PALETTE_COLORS = 64

# Size of one repetition: pixels to the right and up, metres to the right and up.
_PATTERNS: dict[Pattern, tuple[Callable[[Grid, Finish], NDArray[np.floating[Any]]], Grid]] = {
    "pile": (patterns.pile, Grid(256, 256, 1.0, 1.0)),
    "mottled": (patterns.mottled, Grid(256, 256, 2.4, 2.4)),
    "boards": (patterns.boards, Grid(384, 256, 2.4, 1.12)),
    "marbled": (patterns.marbled, Grid(256, 256, 1.5, 1.5)),
    "checkered": (patterns.checkered, Grid(256, 256, 1.2, 1.2)),
    "parquet": (patterns.parquet, Grid(240, 240, 1.2, 1.2)),
    "herringbone": (patterns.herringbone, Grid(320, 320, 1.6, 1.6)),
    "tiles": (patterns.tiles, Grid(256, 256, 1.2, 1.2)),
    "metro": (patterns.metro, Grid(240, 240, 0.8, 0.8)),
    "bricks": (patterns.bricks, Grid(256, 256, 0.96, 0.96)),
    "stones": (patterns.stones, Grid(256, 256, 1.6, 1.6)),
    "formwork": (patterns.formwork, Grid(256, 256, 2.4, 2.4)),
    "panels": (patterns.panels, Grid(256, 256, 0.84, 2.0)),
    "stripes": (patterns.stripes, Grid(128, 128, 0.36, 0.36)),
    "trellis": (patterns.trellis, Grid(160, 160, 0.4, 0.4)),
    "sprigs": (patterns.sprigs, Grid(192, 192, 0.6, 0.6)),
}


def texture_size_m(name: str) -> tuple[float, float] | None:
    """Returns width and height of a texture tile in metres; `None` for a plain colour.

    Args:
        name: A surface, as in `floor_Tiles_white`.

    Raises:
        ValueError: There is no finish of this name.
    """
    pattern = surface_finish(name).pattern
    if pattern == "plain":
        return None
    grid = _PATTERNS[pattern][1]
    return grid.width_m, grid.height_m


@lru_cache(maxsize=64)
def texture(name: str) -> Pixels:
    """Returns a surface's texture image: rows from top to bottom, RGB; one pixel for a plain colour.

    Raises ValueError if there is no finish of this name. The image must not be changed: later calls return it again.
    """
    finish = surface_finish(name)
    if finish.pattern == "plain":
        return _bytes(np.array([[finish.color[:3]]]))
    paint, grid = _PATTERNS[finish.pattern]
    pixels = _bytes(paint(grid.seeded(zlib.crc32(name.encode())), finish))
    pixels.flags.writeable = False
    return pixels


def painted_png(name: str) -> bytes:
    """Paints a surface's texture, or the sky, as PNG; `texture_files.texture_png` has what it makes.

    Args:
        name: A surface whose finish is not plain, or `SKY`.

    Raises:
        ValueError: There is no finish of this name.
    """
    # Of few colours, a third of the size; the eye does not see it.
    pixels, colors = (_sky_pixels(), _SKY_COLORS) if name == SKY else (texture(name), _PALETTE_COLORS)
    picture = Image.fromarray(pixels).quantize(colors, method=Image.Quantize.MEDIANCUT, dither=Image.Dither.NONE)
    buffer = io.BytesIO()
    picture.save(buffer, format="PNG", compress_level=6)
    return buffer.getvalue()


@lru_cache(maxsize=64)
def mean_color(name: str) -> tuple[float, float, float]:
    """Returns the average colour of a surface: red, green, blue, 0 to 1.

    Raises ValueError if there is no finish of this name.
    """
    red, green, blue = texture(name).reshape(-1, 3).mean(axis=0) / 255
    return round(float(red), 3), round(float(green), 3), round(float(blue), 3)


def sample(name: str, right_m: NDArray[np.floating[Any]], up_m: NDArray[np.floating[Any]]) -> Pixels:
    """Samples a surface's texture colours at given positions.

    Args:
        name: The surface.
        right_m: Places to the right of any fixed line, metres.
        up_m: Places above any fixed line, metres.

    Returns:
        Red, green, blue; the places' shape and a last axis.
    """
    pixels = texture(name)
    size_m = texture_size_m(name)
    if size_m is None:
        return np.broadcast_to(pixels[0, 0], (*right_m.shape, 3))
    height, width, _ = pixels.shape
    column = _wrapped(np.floor(right_m * (width / size_m[0])).astype(np.int32), width)
    row = height - 1 - _wrapped(np.floor(up_m * (height / size_m[1])).astype(np.int32), height)
    return np.take(pixels.reshape(-1, 3), row * width + column, axis=0)


def _wrapped(numbers: NDArray[np.int32], size: int) -> NDArray[np.int32]:
    # Of powers of two, remainders cost next to nothing.
    return numbers & (size - 1) if size & (size - 1) == 0 else numbers % size


def _bytes(colors: NDArray[np.floating[Any]]) -> Pixels:
    return np.rint(np.clip(colors, 0, 1) * 255).astype(np.uint8)


SKY = "sky"
"""Name of the sky's texture."""

LAYOUT = 'gridsize="3 4" gridlayout=".U..LFRB.D.."'
"""MJCF attributes for the layout of the six cube map squares in the sky's picture."""

_SIDE_PIXELS = 160
_SKY_COLORS = 96
_ZENITH, _HORIZON = np.array([0.55, 0.71, 0.88]), np.array([0.88, 0.92, 0.95])
_NEAR, _FAR = np.array([0.46, 0.58, 0.34]), np.array([0.64, 0.72, 0.55])
_TREES, _TREES_FAR = np.array([0.33, 0.46, 0.30]), np.array([0.55, 0.66, 0.58])


def _sky_pixels() -> Pixels:
    """Paints the cube map of the sky: three squares high, four wide."""
    side = _SIDE_PIXELS
    # Every side is the same, so that trees go on from one to the next.
    picture = np.zeros((3 * side, 4 * side, 3))
    picture[side : 2 * side] = np.tile(_horizon(side), (1, 4, 1))
    picture[:side, side : 2 * side] = _above(side)
    picture[2 * side :, side : 2 * side] = _NEAR
    return _bytes(picture)


def _horizon(side: int) -> Array:
    """Paints one of the four side squares of the sky's cube map."""
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
    """Paints the upper square of the sky's cube map; its edges have the colours of the sides' top edges."""
    x = (np.arange(side) + 0.5) / side * 2 - 1
    return _sky(1 / np.maximum(np.sqrt(x[:, None] ** 2 + x**2), 1e-3))


def _sky(rise: Array) -> Array:
    share = np.clip(rise / 1.2, 0, 1)
    share = share * (2 - share)
    return _HORIZON + (_ZENITH - _HORIZON) * share[..., None]
