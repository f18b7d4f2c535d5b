"""Procedural texture patterns: woods, stones, tiles, fabrics, wallpapers.

Each takes the grid of a texture's pixels and a finish's three colours, and gives colours of shape
(rows, columns, 3), 0 to 1, that repeat without a seam in both directions.
"""

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .materials import Finish

Array = NDArray[np.floating[Any]]
Numbers = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Grid:
    """Pixel grid of one texture tile, with a random generator."""

    columns: int
    rows: int
    width_m: float
    height_m: float
    rng: np.random.Generator = field(default_factory=lambda: np.random.default_rng(0))

    def seeded(self, seed: int) -> "Grid":
        """Returns the same pixel grid with another random seed."""
        return replace(self, rng=np.random.default_rng(seed))

    def places(self) -> tuple[Array, Array]:
        """Returns the position of each pixel in metres, to the right and down."""
        x = (np.arange(self.columns) + 0.5) * (self.width_m / self.columns)
        y = (np.arange(self.rows) + 0.5) * (self.height_m / self.rows)
        return np.broadcast_to(x, (self.rows, self.columns)), np.broadcast_to(y[:, None], (self.rows, self.columns))

    def noise(self, across: int, down: int) -> Array:
        """Returns smooth noise from 0 to 1, with the given numbers of bumps to the right and down.

        The result has a row for each row of pixels. It repeats without a seam.
        """
        values = self.rng.random((down, across))
        for axis, count, pixels in ((1, across, self.columns), (0, down, self.rows)):
            place = (np.arange(pixels) + 0.5) * (count / pixels)
            first = np.floor(place).astype(np.int64)
            share = place - first
            share = share * share * (3 - 2 * share)
            share = share if axis == 1 else share[:, None]
            low, high = np.take(values, first % count, axis), np.take(values, (first + 1) % count, axis)
            values = low + (high - low) * share
        return values

    def clouds(self, across: int, down: int, octaves: int = 3) -> Array:
        """Returns fractal noise from 0 to 1, with ever finer detail."""
        total, weight = np.zeros((self.rows, self.columns)), 0.0
        for octave in range(octaves):
            share = 0.55**octave
            total = total + share * self.noise(across << octave, down << octave)
            weight += share
        return total / weight

    def grains(self) -> Array:
        """Returns a random value from 0 to 1 for each pixel of the texture."""
        return self.rng.random((self.rows, self.columns))

    def tones(self, row: Numbers, column: Numbers | int = 0) -> Array:
        """Returns a random value from 0 to 1 for each board or tile, by its row and column."""
        return self.rng.random((64, 64))[row % 64, column % 64]


def pile(grid: Grid, finish: Finish) -> Array:
    """Draws the texture of carpet."""
    tufts = 0.65 * grid.noise(128, 128) + 0.35 * grid.grains()
    lie = grid.clouds(4, 4)
    share = np.clip(1.5 * (tufts - 0.5) + 0.35 * (lie - 0.5) + 0.5, 0, 1)
    return _mix(_mix(finish.second, finish.color, np.clip(2 * share, 0, 1)), finish.line, np.clip(2 * share - 1, 0, 1))


def mottled(grid: Grid, finish: Finish) -> Array:
    """Draws the texture of trowelled concrete."""
    share = np.clip(2.0 * (grid.clouds(4, 4, 5) - 0.5) + 0.5 + 0.5 * (grid.grains() - 0.5), 0, 1)
    colors = _mix(finish.color, finish.second, share)
    return _mix(colors, finish.line, 0.6 * (grid.noise(128, 128) > 0.94))


def boards(grid: Grid, finish: Finish) -> Array:
    """Draws the texture of floorboards, 14 cm wide and 1.2 m long."""
    x, y = grid.places()
    row = _number(y, 0.14)
    shift = (row * 5 % 8) * 0.15
    column = _number(x + shift, 1.2) % 2
    colors = _wood(finish, grid.tones(row, column), _grain(grid, 10, 128))
    return _joints(colors, finish, _edge(y, 0.14) < 0.004, _edge(x + shift, 1.2) < 0.005)


def marbled(grid: Grid, finish: Finish) -> Array:
    """Draws the texture of linoleum."""
    bend = grid.clouds(3, 3)
    flow = grid.clouds(8, 8, 4) + 0.6 * bend
    wave = np.abs(flow * 7 % 2 - 1)
    colors = _mix(finish.color, finish.second, np.clip(1.4 * wave - 0.4, 0, 1) * 0.8)
    return _mix(colors, finish.line, np.clip(1 - 5 * wave, 0, 1) * 0.5) * _speck(grid, 0.03)


def checkered(grid: Grid, finish: Finish) -> Array:
    """Draws the texture of 30 cm squares in two colours."""
    x, y = grid.places()
    column, row = _number(x, 0.3), _number(y, 0.3)
    veins = grid.clouds(10, 10)
    base = _mix(finish.color, finish.second, ((column + row) % 2).astype(float))
    base = base * (0.95 + 0.05 * veins + 0.05 * grid.tones(row, column))[..., None]
    return _joints(base, finish, _edge(x, 0.3) < 0.003, _edge(y, 0.3) < 0.003)


def parquet(grid: Grid, finish: Finish) -> Array:
    """Draws the texture of mosaic parquet: squares of five slats."""
    x, y = grid.places()
    column, row = _number(x, 0.4), _number(y, 0.4)
    upright = (column + row) % 2 == 1
    slat = np.where(upright, _number(x, 0.08), _number(y, 0.08))
    other = np.where(upright, row + 20, column)
    grain = np.where(upright, _grain(grid, 80, 6), _grain(grid, 6, 80))
    colors = _wood(finish, grid.tones(slat, other), grain)
    thin = np.where(upright, _edge(x, 0.08), _edge(y, 0.08)) < 0.0026
    return _joints(colors, finish, thin, (_edge(x, 0.4) < 0.0026) | (_edge(y, 0.4) < 0.0026))


def herringbone(grid: Grid, finish: Finish) -> Array:
    """Draws the texture of herringbone parquet with slats of 8 by 40 cm."""
    x, y = grid.places()
    column, row = _number(x, 0.08), _number(y, 0.08)
    phase = (column - row) % 10
    lying = phase < 5
    start = np.where(lying, column - phase, row - (9 - phase))
    line = np.where(lying, row, column + 20)
    grain = np.where(lying, _grain(grid, 8, 107), _grain(grid, 107, 8))
    colors = _wood(finish, grid.tones(line % 40, start % 20), grain)
    x_end, y_end = _edge(x, 0.08) < 0.0026, _edge(y, 0.08) < 0.0026
    # Edges between squares of one slat are none.
    inner_x = lying & ~_first(x, 0.08, phase == 0, phase == 4)
    inner_y = ~lying & ~_first(y, 0.08, phase == 9, phase == 5)
    return _joints(colors, finish, x_end & ~inner_x, y_end & ~inner_y)


def tiles(grid: Grid, finish: Finish) -> Array:
    """Draws the texture of 30 cm tiles."""
    return _tiled(grid, finish, 0.3, 0.3, bond=False)


def metro(grid: Grid, finish: Finish) -> Array:
    """Draws the texture of glazed metro tiles, 20 by 10 cm."""
    return _tiled(grid, finish, 0.2, 0.1, bond=True)


def bricks(grid: Grid, finish: Finish) -> Array:
    """Draws the texture of a brick wall, 24 by 8 cm with mortar."""
    x, y = grid.places()
    row = _number(y, 0.08)
    shift = (row % 2) * 0.12
    column = _number(x + shift, 0.24) % 4
    rough = grid.clouds(48, 48, 2)
    tone = grid.tones(row, column)
    colors = _mix(finish.color, finish.second, tone) * (0.86 + 0.18 * rough + 0.1 * tone)[..., None]
    edge = np.minimum(_edge(x + shift, 0.24), _edge(y, 0.08)) + 0.004 * (rough - 0.5)
    colors = _shaded(colors, _top(y, 0.08, 0.014), 0.08)
    mortar = np.array(finish.line[:3]) * (0.92 + 0.12 * grid.grains())[..., None]
    return np.where((edge < 0.006)[..., None], mortar, colors)


def stones(grid: Grid, finish: Finish) -> Array:
    """Draws the texture of a wall of hewn stones."""
    x, y = grid.places()
    heights = (0.26, 0.18, 0.3, 0.22, 0.2, 0.24, 0.2)
    bottoms = np.cumsum((0.0, *heights))
    wobble = 0.018 * (grid.clouds(12, 12, 2) - 0.5)
    row = np.clip(np.searchsorted(bottoms, y + wobble, side="right") - 1, 0, len(heights) - 1)
    edge = np.minimum(np.abs(y + wobble - bottoms[row]), np.abs(bottoms[row + 1] - y - wobble))
    column = np.zeros_like(row)
    for course in range(len(heights)):
        cuts = _cuts(grid, 1.6, 0.22, 0.5)
        place = (x + wobble - cuts[0]) % 1.6 + cuts[0]
        found = np.clip(np.searchsorted(cuts, place, side="right") - 1, 0, len(cuts) - 2)
        mine = row == course
        column = np.where(mine, found, column)
        near = np.minimum(np.abs(place - cuts[found]), np.abs(cuts[found + 1] - place))
        edge = np.where(mine, np.minimum(edge, near), edge)
    rough = grid.clouds(20, 20, 4)
    colors = _mix(finish.color, finish.second, np.clip(grid.tones(row, column) * 0.8 + 0.5 * (rough - 0.3), 0, 1))
    colors = colors * (0.82 + 0.32 * rough)[..., None]
    relief = np.clip(edge / 0.03, 0, 1)
    colors = colors * (0.8 + 0.2 * relief)[..., None]
    return np.where((edge < 0.007)[..., None], np.array(finish.line[:3]) * (0.85 + 0.2 * rough)[..., None], colors)


def formwork(grid: Grid, finish: Finish) -> Array:
    """Draws the texture of cast concrete in panels of 1.2 m."""
    x, y = grid.places()
    colors = _mix(finish.color, finish.second, np.clip(1.5 * (grid.clouds(5, 4, 5) - 0.5) + 0.5, 0, 1))
    colors = colors * (0.98 + 0.04 * grid.tones(_number(x, 1.2), _number(y, 1.2)))[..., None]
    colors = _mix(colors, finish.line, 0.4 * (grid.noise(128, 128) > 0.97))
    colors = _joints(colors, finish, _edge(x, 1.2) < 0.008, _edge(y, 1.2) < 0.008)
    dx, dy = np.abs((x - 0.3) % 0.6 - 0.3), np.abs((y - 0.3) % 0.6 - 0.3)
    hole = (0.3 - dx) ** 2 + (0.3 - dy) ** 2 < 0.018**2
    return _mix(colors, finish.line, hole.astype(float))


def panels(grid: Grid, finish: Finish) -> Array:
    """Draws the texture of upright boards, 14 cm wide."""
    x, _ = grid.places()
    board = _number(x, 0.14)
    colors = _wood(finish, grid.tones(board), _grain(grid, 96, 5))
    edge = _edge(x, 0.14)
    colors = colors * (0.9 + 0.1 * np.clip(edge / 0.016, 0, 1))[..., None]
    return _joints(colors, finish, edge < 0.004, np.zeros_like(edge, dtype=np.bool_))


def stripes(grid: Grid, finish: Finish) -> Array:
    """Draws the texture of striped wallpaper."""
    x, _ = grid.places()
    place = x % 0.18
    colors = _mix(finish.color, finish.second, ((place > 0.06) & (place < 0.13)).astype(float))
    thin = (np.abs(place - 0.045) < 0.004) | (np.abs(place - 0.145) < 0.004)
    return _mix(colors, finish.line, 0.7 * thin) * _speck(grid, 0.02)


def trellis(grid: Grid, finish: Finish) -> Array:
    """Draws the texture of wallpaper with diamonds."""
    x, y = grid.places()
    u, v = (x + y) % 0.2, (x - y) % 0.2
    edge = np.minimum(np.minimum(u, 0.2 - u), np.minimum(v, 0.2 - v))
    colors = _mix(finish.color, finish.second, np.clip(1 - edge / 0.05, 0, 1) * 0.5)
    colors = _mix(colors, finish.line, 0.9 * (edge < 0.006))
    dot = (u - 0.1) ** 2 + (v - 0.1) ** 2 < 0.022**2
    return _mix(colors, finish.line, 0.6 * dot) * _speck(grid, 0.02)


def sprigs(grid: Grid, finish: Finish) -> Array:
    """Draws the texture of wallpaper with twigs."""
    x, y = grid.places()
    column = _number(x, 0.3)
    u, v = x % 0.3 - 0.15, (y + (column % 2) * 0.15) % 0.3 - 0.15
    u = np.where(column % 2 == 0, u, -u)
    stem = (np.abs(u - 0.25 * v - 0.8 * v * v) < 0.0035) & (np.abs(v) < 0.085)
    leaf = np.zeros(stem.shape, np.bool_)
    for at, side, length in ((0.065, 1, 0.042), (0.03, -1, 0.045), (-0.005, 1, 0.04), (-0.04, -1, 0.036)):
        a, b = u - (0.25 * at + 0.8 * at * at) - side * length * 0.55, v - at + 0.02
        along, across = 0.8 * a - 0.6 * side * b, 0.6 * side * a + 0.8 * b
        leaf |= (along / (length * 0.62)) ** 2 + (across / 0.011) ** 2 < 1
    petals = np.zeros(stem.shape, np.bool_)
    for dx, dy in ((0.0, -0.016), (0.015, -0.005), (0.009, 0.013), (-0.009, 0.013), (-0.015, -0.005)):
        petals |= (u + 0.016 - dx) ** 2 + (v + 0.088 - dy) ** 2 < 0.0115**2
    colors = _mix(finish.color, finish.second, (stem | leaf).astype(float))
    colors = _mix(colors, finish.line, petals.astype(float))
    heart = (u + 0.016) ** 2 + (v + 0.088) ** 2 < 0.006**2
    return _mix(colors, finish.color, 0.8 * heart) * _speck(grid, 0.02)


def _tiled(grid: Grid, finish: Finish, width: float, height: float, *, bond: bool) -> Array:
    x, y = grid.places()
    row = _number(y, height)
    shift = (row % 2) * (width / 2) if bond else np.zeros_like(x)
    column = _number(x + shift, width) % round(grid.width_m / width)
    tone = grid.tones(row, column)
    colors = _mix(finish.color, finish.second, tone * 0.8 + 0.4 * (grid.clouds(8, 8) - 0.3))
    colors = _shaded(colors, _top(y, height, 0.008), 0.05)
    colors = _shaded(colors, _top(-y, height, 0.01), -0.06)
    return _joints(colors, finish, _edge(x + shift, width) < 0.0035, _edge(y, height) < 0.0035)


def _mix(first: Any, second: Any, share: Array) -> Array:
    """Interpolates between two colours by a share from 0 to 1."""
    low = np.asarray(first, float)[..., :3]
    high = np.asarray(second, float)[..., :3]
    return low + (high - low) * np.asarray(share, float)[..., None]


def _wood(finish: Finish, tone: Array, grain: Array) -> Array:
    """Returns the colours of wood from the tone of each board, 0 to 1, and its grain, 0 to 1."""
    colors = _mix(finish.color, finish.second, np.clip(0.75 * tone + 0.9 * (grain - 0.45), 0, 1))
    return _mix(colors, finish.line, np.clip(2.2 * (grain - 0.72), 0, 0.55)) * (0.97 + 0.06 * tone)[..., None]


def _grain(grid: Grid, across: int, down: int) -> Array:
    """Returns noise of long wood fibres; the smaller of the two counts is along the fibres."""
    fine = grid.noise(across, down)
    broad = grid.noise(max(2, across // 3), max(2, down // 3))
    return 0.55 * fine + 0.45 * broad


def _speck(grid: Grid, depth: float) -> Array:
    return (1 - depth + 2 * depth * grid.grains())[..., None]


def _number(place: Array, size: float) -> Numbers:
    """Returns the number of the board, stone or tile of a given size at each position."""
    return np.floor(place / size + 1e-9).astype(np.int64)


def _edge(place: Array, size: float) -> Array:
    """Returns the distance of each position to the nearest joint of boards or tiles."""
    inside = place - np.floor(place / size) * size
    return np.minimum(inside, size - inside)


def _top(place: Array, size: float, reach: float) -> NDArray[np.bool_]:
    """Returns a mask of the positions close behind a joint of boards or tiles."""
    return place - np.floor(place / size) * size < reach


def _first(place: Array, size: float, is_first: NDArray[np.bool_], is_last: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Returns a mask of positions whose nearest edge is the outer edge of the first or the last square."""
    low = place - np.floor(place / size) * size < size / 2
    return (is_first & low) | (is_last & ~low)


def _shaded(colors: Array, where: NDArray[np.bool_], change: float) -> Array:
    return colors * (1 + change * where)[..., None]


def _joints(colors: Array, finish: Finish, *where: NDArray[np.bool_]) -> Array:
    joint = where[0]
    for more in where[1:]:
        joint = joint | more
    return np.where(joint[..., None], np.array(finish.line[:3]), colors)


def _cuts(grid: Grid, length: float, least: float, most: float) -> Array:
    """Returns random starts of the stones of one course, then the position where the first one is repeated."""
    widths: list[float] = []
    while sum(widths) < length:
        widths.append(float(grid.rng.uniform(least, most)))
    start = float(grid.rng.uniform(0, length))
    return start + np.cumsum([0.0, *widths]) * (length / sum(widths))
