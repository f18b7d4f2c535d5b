"""Depth-buffered rasteriser for an oblique parallel view from above, with palette and light, in plain NumPy.

Only sums, products, comparisons and square roots touch the pixels: these are exact to the bit on every processor, so
that equal scenes give equal pictures everywhere.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from math import ceil, cos, floor, radians, sin
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from ..geometry.parts import Axis, Color, Vector, rgb
from ..materials.textures import mean_color, texture_size_m

LEVELS = 16
"""Number of shades (colour numbers) of a curved surface, darkest first."""

_STRIP_ROWS = 48
_LARGE = 12_000
_SMALLEST = 1.5
"""Area in square pixels below which a face is not drawn."""

_CURVED = tuple(0.62 + 0.42 * (level + 0.5) / LEVELS for level in range(LEVELS))
"""Brightness of these shades."""
_ASIDE = 0.25
"""Pixels by which rays are moved aside and up."""

Image = NDArray[np.floating[Any]]


@dataclass(frozen=True)
class View:
    """Direction and scale of the parallel-projection camera for a preview, and the picture's pixels."""

    azimuth_deg: float
    """Rotation of the camera about the vertical, in degrees, from looking north."""
    elevation_deg: float
    """Angle of the camera above the horizon, in degrees."""
    scale: float
    """Scale of the preview camera, in pixels per metre."""
    offset: tuple[float, float]
    """Pixel position of the world's origin in the preview."""
    size: tuple[int, int]
    """Width and height of the preview, in pixels."""

    @cached_property
    def axes(self) -> tuple[tuple[float, float], tuple[float, float], float, float]:
        """Ground directions to the right and away, and sine and cosine of the camera's elevation."""
        turn, tilt = radians(self.azimuth_deg), radians(self.elevation_deg)
        # Nine digits: the last bits of cos and sin differ between C libraries.
        c, s, up, flat = (round(value, 9) for value in (cos(turn), sin(turn), sin(tilt), cos(tilt)))
        return (c, s), (-s, c), up, flat

    def vector(self, direction: Vector) -> Vector:
        """Converts a direction to pixels: right, down, and towards the camera."""
        right, away, up, flat = self.axes
        x, y, z = direction
        u, w = x * right[0] + y * right[1], x * away[0] + y * away[1]
        return u * self.scale, -(w * up + z * flat) * self.scale, (z * up - w * flat) * self.scale

    def point(self, place: Vector) -> Vector:
        """Converts a position to pixels: from the left, from the top, and towards the camera."""
        u, v, depth = self.vector(place)
        return u + self.offset[0], v + self.offset[1], depth


class Raster:
    """Colour numbers and depths (z-buffer) of a picture while it is drawn.

    Attributes:
        depth: Pixels towards the camera, minus infinity where nothing is.
        ids: The colour number of what is seen, 0 where nothing is.
        veil: Whether a pane of glass is before what is seen.
    """

    def __init__(self, view: View) -> None:
        width, height = view.size
        self.view = view
        self.depth = np.full((height, width), -np.inf, np.float32)
        self.ids = np.zeros((height, width), np.int32)
        self.veil = np.zeros((height, width), np.uint8)
        self._xs = (np.arange(width) + 0.5).astype(np.float32)
        self._ys = (np.arange(height) + 0.5).astype(np.float32)[:, None]
        # Odd rows look a little to the right and odd columns a little up: no two of four neighbours are in line, so
        # that steep and level edges have five shades instead of three.
        self._aside = np.where(np.arange(height) % 2, _ASIDE, -_ASIDE).astype(np.float32)[:, None]
        self._above = np.where(np.arange(width) % 2, -_ASIDE, _ASIDE).astype(np.float32)

    def parallelogram(self, corner: Vector, along: Vector, across: Vector, color: int) -> None:
        """Draws a flat face from one of its corners and its two edges."""
        for rows, columns, seen, depth in self._face(corner, along, across):
            self._draw(rows, columns, seen, depth, color)

    def pane(self, corner: Vector, along: Vector, across: Vector) -> None:
        """Draws a pane of glass, which is a flat face, before what has been drawn until now."""
        for rows, columns, seen, depth in self._face(corner, along, across):
            self.veil[rows, columns] |= seen & (depth > self.depth[rows, columns])

    def disc(self, center: Vector, along: Vector, across: Vector, color: int) -> None:
        """Draws an ellipse from its centre and two half axes."""
        x, y, z = (middle - one - other for middle, one, other in zip(center, along, across, strict=True))
        for rows, columns, seen, depth in self._face((x, y, z), _twice(along), _twice(across), is_round=True):
            self._draw(rows, columns, seen, depth, color)

    def _face(
        self, corner: Vector, along: Vector, across: Vector, is_round: bool = False
    ) -> Iterator[tuple[slice, slice, NDArray[np.bool_], Image]]:
        """Yields the blocks of pixels around a face: rows, columns, a mask of those that it covers, and its depth."""
        x0, y0, z0 = self.view.point(corner)
        (ax, ay, az), (bx, by, bz) = self.view.vector(along), self.view.vector(across)
        determinant = ax * by - ay * bx
        if abs(determinant) < _SMALLEST:
            return
        # Shares along both edges, from -0.5 to 0.5, and depth, are linear in the pixel's place.
        sx, sy = by / determinant, -bx / determinant
        tx, ty = -ay / determinant, ax / determinant
        s0, t0 = -(x0 * sx + y0 * sy) - 0.5, -(x0 * tx + y0 * ty) - 0.5
        dx, dy = sx * az + tx * bz, sy * az + ty * bz
        d0 = z0 + (s0 + 0.5) * az + (t0 + 0.5) * bz
        corners = [(x0, y0), (x0 + ax, y0 + ay), (x0 + bx, y0 + by), (x0 + ax + bx, y0 + ay + by)]
        for rows, columns in self._windows(corners):
            xs, ys, aside, above = self._xs[columns], self._ys[rows], self._aside[rows], self._above[columns]
            s = (xs * sx + above * sy + s0) + (ys * sy + aside * sx)
            t = (xs * tx + above * ty + t0) + (ys * ty + aside * tx)
            seen = s * s + t * t <= 0.25 if is_round else np.maximum(np.abs(s, out=s), np.abs(t, out=t)) <= 0.5
            yield rows, columns, seen, (xs * dx + above * dy + d0) + (ys * dy + aside * dx)

    def post(self, center: Vector, radius: float, height: float, colors: int) -> None:
        """Draws the side of an upright cylinder; `center` is the middle of its foot."""
        right, away, up, flat = self.view.axes
        x, y, z = self.view.point(center)
        scale = self.view.scale
        reach, rise = radius * scale, height * scale
        corners = [(x - reach, y - rise * flat - reach), (x + reach, y + reach)]
        for rows, columns in self._windows(corners):
            across = self._xs[columns] - np.float32(x) + self._aside[rows]
            front = np.sqrt(np.maximum(reach * reach - across * across, 0)).astype(np.float32)
            above = ((np.float32(y) - self._ys[rows]) - self._above[columns] + front * up) / flat
            seen = (np.abs(across) < reach) & (above >= 0) & (above <= rise)
            level = _levels(
                across / reach * right[0] + front / reach * -away[0],
                across / reach * right[1] - front / reach * away[1],
                0,
            )
            self._draw(
                rows, columns, seen, z + front * flat + above * up, colors + level + np.zeros_like(above, np.int32)
            )

    def ball(self, center: Vector, radii: Vector, colors: int) -> None:
        """Draws an ellipsoid with axes parallel to the world's."""
        right, away, up, flat = self.view.axes
        x, y, z = self.view.point(center)
        rx, ry, rz = (radius * self.view.scale for radius in radii)
        # Rows of the matrix that takes pixels (right, down, near) to the unit sphere.
        rows3 = (
            (right[0] / rx, -away[0] * up / rx, -away[0] * flat / rx),
            (right[1] / ry, -away[1] * up / ry, -away[1] * flat / ry),
            (0.0, -flat / rz, up / rz),
        )
        q = [[sum(row[i] * row[j] for row in rows3) for j in range(3)] for i in range(3)]
        reach = max(rx, ry, rz)
        for rows, columns in self._windows([(x - reach, y - reach), (x + reach, y + reach)]):
            u = self._xs[columns] - np.float32(x) + self._aside[rows]
            v = self._ys[rows] - np.float32(y) + self._above[columns]
            half = u * q[0][2] + v * q[1][2]
            rest = half * half - q[2][2] * (u * u * q[0][0] + 2 * u * v * q[0][1] + v * v * q[1][1] - 1)
            near = (np.sqrt(np.maximum(rest, 0)) - half) / q[2][2]
            unit = [row[0] * u + row[1] * v + row[2] * near for row in rows3]
            level = _levels(unit[0], unit[1], unit[2])
            self._draw(rows, columns, rest > 0, z + near, colors + level)

    def _windows(self, corners: list[tuple[float, float]]) -> list[tuple[slice, slice]]:
        """Returns blocks of pixels that cover a convex face; a large face is cut into strips that follow it closely.

        Each block is its rows and its columns; there is none if the face lies outside the picture.
        """
        width, height = self.view.size
        xs, ys = zip(*corners, strict=True)
        x_low, x_high, y_low, y_high = min(xs), max(xs), min(ys), max(ys)
        top, bottom = max(0, floor(y_low)), min(height, ceil(y_high))
        left, right = max(0, floor(x_low)), min(width, ceil(x_high))
        if top >= bottom or left >= right:
            return []
        if len(corners) < 4 or (bottom - top) * (right - left) < _LARGE:
            return [(slice(top, bottom), slice(left, right))]
        first, second, third, fourth = corners
        edges = [(first, second), (second, fourth), (fourth, third), (third, first)]
        strips: list[tuple[slice, slice]] = []
        for start in range(top, bottom, _STRIP_ROWS):
            end = min(start + _STRIP_ROWS, bottom)
            spans = [x for edge in edges for x in _crossing(edge, start, end)]
            if spans:
                columns = slice(max(0, floor(min(spans)) - 1), min(width, ceil(max(spans)) + 1))
                strips.append((slice(start, end), columns))
        return strips

    def _draw(
        self, rows: slice, columns: slice, seen: NDArray[np.bool_], depth: Image, color: int | NDArray[np.int32]
    ) -> None:
        old = self.depth[rows, columns]
        seen = seen & (depth > old)
        np.copyto(old, depth, where=seen)
        np.copyto(self.ids[rows, columns], color, where=seen)


def _twice(vector: Vector) -> Vector:
    return 2 * vector[0], 2 * vector[1], 2 * vector[2]


def _crossing(edge: tuple[tuple[float, float], tuple[float, float]], top: float, bottom: float) -> list[float]:
    """Returns the columns at which an edge enters and leaves a strip of rows; empty if it does not meet the strip."""
    (x0, y0), (x1, y1) = edge if edge[0][1] <= edge[1][1] else (edge[1], edge[0])
    if y1 < top or y0 > bottom:
        return []
    if y1 - y0 < 1e-9:
        return [x0, x1]
    slope = (x1 - x0) / (y1 - y0)
    return [x0 + slope * (max(y0, top) - y0), x0 + slope * (min(y1, bottom) - y0)]


LIGHT: Vector = (-0.50, -0.25, 0.829)
"""Unit-length direction towards the light: in the south-west, so that the sides that one sees are lit."""


def _levels(x: Image, y: Image, z: Image | float) -> NDArray[np.int32]:
    """Returns the shade numbers of unit normals, from 0 (turned from the light) to `LEVELS - 1`."""
    facing = x * LIGHT[0] + y * LIGHT[1] + z * LIGHT[2]
    return np.clip((facing * 0.5 + 0.5) * LEVELS, 0, LEVELS - 1).astype(np.int32)


GROUND = rgb("e7e5df")[:3]
"""Colour of the ground around the building (colour number 0)."""
CUT = 1
"""Colour number of what the cut through walls shows."""
_CUT_COLOR = rgb("fdfcfa")[:3]
_AWAY_M = 0.05
"""Distance in metres before an upright face at which light is looked up: the face is on the edge of its own shadow."""


class Palette:
    """Colour table of a preview picture, with the shading of each colour.

    Attributes:
        patterned: Surfaces that are to be filled with their patterns, and the share of light on them: `z`
            floors, `x` and `y` walls by the direction in which they run.
    """

    def __init__(self) -> None:
        self._colors: list[tuple[float, float, float]] = [GROUND, _CUT_COLOR]
        self._normals: dict[int, tuple[float, float]] = {}
        self._in_shade: list[int] = []
        self.patterned: list[tuple[str, Axis, float]] = []
        self._patterns: dict[int, int] = {}

    @property
    def count(self) -> int:
        """Number of colours, which is that of the next one."""
        return len(self._colors)

    def add(self, color: Color, shade: float = 1.0) -> int:
        """Adds a colour to the preview's palette, shaded or not; returns its number."""
        red, green, blue, _ = color
        self._colors.append((red * shade, green * shade, blue * shade))
        return len(self._colors) - 1

    def add_side(self, color: Color, normal: tuple[float, float]) -> int:
        """Adds a colour for a vertical face, shaded by its direction; returns its number."""
        facing = normal[0] * LIGHT[0] + normal[1] * LIGHT[1]
        number = self.add(color, _side_share(normal))
        self._normals[number] = normal
        if facing <= 0:
            self._in_shade.append(number)
        return number

    def add_curved(self, color: Color) -> int:
        """Adds shades for a curved surface; returns the number of the first and darkest."""
        first, (red, green, blue, _) = len(self._colors), color
        self._colors += [(red * shade, green * shade, blue * shade) for shade in _CURVED]
        return first

    def add_floor(self, name: str) -> int:
        """Adds a floor surface by its MJCF name; returns its number."""
        number = self.add((*mean_color(name), 1.0))
        self._fill(number, name, "z", 1.0)
        return number

    def add_wall(self, name: str, normal: tuple[float, float]) -> int:
        """Adds a wall surface by its MJCF name; returns its number."""
        number = self.add_side((*mean_color(name), 1.0), normal)
        if texture_size_m(name) is not None:
            self._fill(number, name, "x" if normal[0] == 0 else "y", _side_share(normal))
        return number

    def _fill(self, number: int, name: str, axis: Axis, share: float) -> None:
        pattern = (name, axis, share)
        if pattern not in self.patterned:
            self.patterned.append(pattern)
        self._patterns[number] = self.patterned.index(pattern) + 1

    def patterns(self) -> NDArray[np.uint8]:
        """Returns the pattern of each colour number: 0 for no pattern, else an index in `patterned` plus one."""
        table = np.zeros(len(self._colors), np.uint8)
        table[list(self._patterns)] = list(self._patterns.values())
        return table

    def sunny(self) -> NDArray[np.float32]:
        """Returns for each colour whether shadows fall on it: 1, or 0 for faces turned from the light."""
        sunny = np.ones(len(self._colors), np.float32)
        sunny[self._in_shade] = 0
        return sunny

    def away(self) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Returns for each colour how far east and north of a place light is looked up, in metres."""
        table = np.zeros((2, len(self._colors)), np.float32)
        for number, normal in self._normals.items():
            table[:, number] = normal
        table *= np.float32(_AWAY_M)
        return table[0], table[1]

    def table(self) -> NDArray[np.uint8]:
        """Returns red, green and blue of each colour number of the palette, 0 to 255."""
        return np.rint(np.clip(np.array(self._colors), 0, 1) * 255).astype(np.uint8)


def _side_share(normal: tuple[float, float]) -> float:
    """Returns the brightness of a vertical face, from its normal."""
    return 0.77 + 0.26 * (normal[0] * LIGHT[0] + normal[1] * LIGHT[1])


_CELL_M = 0.03
_MARGIN_M = 1.5
_CAST_CELLS = 2
"""Cells from one step along the light to the next; shadows are evened out over more."""
_SOFT_CELLS = 3
"""Cells over which shadows are evened out, twice: their edges have no steps."""
_CLOSE_CELLS, _WIDE_CELLS = 5, 13
"""Cells over which heights are evened out, twice, for the shade where things meet and in narrow places."""
_CLOSE_M = 0.5
"""Height in metres above which things make the floor before them no darker."""
_CLOSE, _WIDE = 0.75, 0.28
"""Loss of light for each metre of these heights."""
_MOST_CLOSE, _MOST_WIDE = 0.30, 0.22
_SUNLESS, _SUNLESS_EDGE = 0.32, 4.5
"""Loss of light in the sun's shadow, and how much of it comes for each metre below the shadow's edge."""


class Block(NamedTuple):
    """Box on the ground; distances are in metres."""

    west: float
    south: float
    east: float
    north: float
    height: float
    yaw: float = 0.0
    """Angle in radians by which the box is turned about its middle."""


@dataclass(frozen=True)
class LightMap:
    """Shadow map of a preview: height of the shadow and of surrounding objects, for each quarter of a ground cell."""

    origin: tuple[float, float]
    shade: Image
    """Height up to which a place is in the sun's shadow, in metres."""
    close: Image
    """Mean height of what touches a place, in metres."""
    crowd: Image
    """Mean height of the surroundings of a place, in metres."""

    @classmethod
    def of(cls, blocks: Iterable[Block], extent: tuple[float, float, float, float]) -> "LightMap":
        """Computes the shadows of blocks that are on the ground.

        Args:
            blocks: The blocks.
            extent: The building's west, south, east and north, in metres.
        """
        x0, y0 = extent[0] - _MARGIN_M, extent[1] - _MARGIN_M
        shape = (ceil((extent[3] + _MARGIN_M - y0) / _CELL_M), ceil((extent[2] + _MARGIN_M - x0) / _CELL_M))
        heights = np.zeros(shape, np.float32)
        for block in blocks:
            _raise(heights, block, (x0, y0))
        maps = (
            _even(_cast(heights), _SOFT_CELLS),
            _even(np.minimum(heights, np.float32(_CLOSE_M)), _CLOSE_CELLS),
            _even(heights, _WIDE_CELLS),
        )
        return cls((x0, y0), *map(_finer, maps))

    def brightness(self, x: Image, y: Image, z: Image, sunny: Image) -> Image:
        """Returns the brightness at positions of the scene, 0 to 1."""
        height, width = self.shade.shape
        rows = np.clip(((y - self.origin[1]) * (2 / _CELL_M)).astype(np.int32), 0, height - 1)
        columns = np.clip(((x - self.origin[0]) * (2 / _CELL_M)).astype(np.int32), 0, width - 1)
        cells = rows * width + columns
        sunless = np.clip((np.take(self.shade, cells) - z - 0.02) * _SUNLESS_EDGE, 0, 1) * sunny
        close = np.clip((np.take(self.close, cells) - z) * _CLOSE, 0, _MOST_CLOSE)
        wide = np.clip((np.take(self.crowd, cells) - z) * _WIDE, 0, _MOST_WIDE)
        return (1 - _SUNLESS * sunless) * (1 - close) * (1 - wide)


def _raise(heights: Image, block: Block, origin: tuple[float, float]) -> None:
    """Raises the ground, whose heights are changed in place, to the height of a block."""
    (x0, y0), (west, south, east, north, height, yaw) = origin, block
    c, s = (1.0, 0.0) if yaw == 0.0 else (round(cos(yaw), 9), round(sin(yaw), 9))
    x, y, wide, deep = (west + east) / 2 - x0, (south + north) / 2 - y0, (east - west) / 2, (north - south) / 2
    reach_x, reach_y = abs(c) * wide + abs(s) * deep, abs(s) * wide + abs(c) * deep
    rows = slice(max(0, floor((y - reach_y) / _CELL_M + 0.5)), max(0, floor((y + reach_y) / _CELL_M + 0.5)))
    columns = slice(max(0, floor((x - reach_x) / _CELL_M + 0.5)), max(0, floor((x + reach_x) / _CELL_M + 0.5)))
    old, new = heights[rows, columns], np.float32(height)
    if yaw == 0.0 or old.size == 0:
        np.maximum(old, new, out=old)
        return
    ys, xs = (axis.astype(np.float32) for axis in np.ogrid[rows, columns])
    right, up = (xs + np.float32(0.5)) * _CELL_M - x, (ys + np.float32(0.5)) * _CELL_M - y
    inside = (np.abs(right * c + up * s) <= wide) & (np.abs(up * c - right * s) <= deep)
    np.copyto(old, new, where=inside & (old < new))


def _even(cells: Image, size: int) -> Image:
    """Returns the weighted means of the cells around each cell: near ones count more."""
    return np.asarray(ndimage.uniform_filter(ndimage.uniform_filter(cells, size), size), np.float32)


def _finer(cells: Image) -> Image:
    """Returns a map of cells half as wide, between whose old ones values change evenly."""
    for _ in range(2):
        fine = np.empty((2 * len(cells), cells.shape[1]), np.float32)
        before, after = np.concatenate([cells[:1], cells[:-1]]), np.concatenate([cells[1:], cells[-1:]])
        fine[0::2] = np.float32(0.75) * cells + np.float32(0.25) * before
        fine[1::2] = np.float32(0.75) * cells + np.float32(0.25) * after
        cells = np.ascontiguousarray(fine.T)
    return cells


def _cast(heights: Image) -> Image:
    """Computes the shadow's height over every cell: the highest block towards the light, less the light's slope."""
    # The light comes from the left and from below: a step goes one cell to the left and part of a cell down. Rows are
    # turned around, so that it is up.
    heights = heights[::-1]
    slope, drop = LIGHT[1] / LIGHT[0], np.float32(-LIGHT[2] / LIGHT[0] * _CELL_M)
    shade, rise = np.zeros_like(heights), heights[1:] - heights[:-1]
    for left in range(1, ceil(heights.max() / drop), _CAST_CELLS):
        up = floor(left * slope)
        moved = rise[up:, :-left] * np.float32(left * slope - up)
        moved += heights[up:-1, :-left]
        moved -= left * drop
        target = shade[: len(moved), left:]
        np.maximum(target, moved, out=target)
    return shade[::-1]
