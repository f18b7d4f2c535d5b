"""Light in ray-traced pictures: many small lamps, and the shade of corners, at a grid of pixels."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from math import pi, sqrt

import numpy as np
from numpy.typing import NDArray

from ..geometry.parts import Vector
from .ray_casting import Array, Flags, Hits, RayCaster

STEP = 3
"""Distance of the pixels for which light is found, in pixels, each way."""

_SLOTS = 4
"""Side of the squares of pixels in which each looks at another lamp, in pixels."""
SUNS = _SLOTS * _SLOTS
"""Number of places on the sun's disc that light comes from."""
_LEAST_TURNED, _MOST_TURNED = 0.3, 2.0
"""Bounds of what a surface's light is multiplied by where it is turned a little."""
_SKIN_M = 0.004
_LEAST_LIT = 8e-4
"""Strength of light that is too weak to be asked for its shadows: where it ended, more would be seen as a border."""

_LOST = 0.02
"""Weight below which the four pixels of the grid around a place are no neighbours of it."""
_AROUND, _AROUND_M = 2, 0.06
"""Pixels of the grid each way that are asked then, and the distance in metres at which they count a quarter."""

_LOOKS_OF_MISSED = 2
"""Number of lamps of each set that a pixel looks at where few neighbours share its surface."""

_LOOKS_OF_LONELY, _FEW_ALIKE = 3, 0.6
"""Number of lamps of each set that a pixel of the grid looks at if less than this share of its square is alike."""

_CLOSE_M = 0.11
"""Distance up to which things darken what they touch, in metres."""
_LOOKS = 12
"""Number of places around a pixel that are asked whether they take light from it."""
_GOLDEN_RAD = 2.399963
"""Angle between two of these places, in radians, with which they lie evenly."""
_LEAST_SIN = 0.08
"""Sine of the height above a surface from which a place takes light: surfaces are not quite flat, nor is it exact."""
_TAKEN, _TAKEN_CLOSE = 1.8, 2.7
"""Factors of the light that is taken from afar and from close by, over what places around it cover."""
_LEAST_OPEN = 0.42
"""Share of light that reaches the deepest corner."""
_SAME_PLANE_M = 0.012
"""Distance from a plane, in metres, at which a pixel counts half as a neighbour on it."""
_SMALL_M = 1e-4


@dataclass(frozen=True, slots=True)
class Lamp:
    """A small light source in a ray-traced picture."""

    place: Vector
    power: float
    """Brightness of a white wall one metre away from it."""
    color: Vector = (1.0, 1.0, 1.0)
    facing: Vector | None = None
    """Direction in which the lamp shines; `None`: everywhere alike."""


@dataclass(frozen=True, slots=True)
class Lighting:
    """Everything that a picture is lit by."""

    lamps: Sequence[Sequence[Lamp]]
    """Sets of lamps; a pixel looks at one lamp of each set and at the others through its neighbours."""
    ambient: Vector = (0.1, 0.1, 0.1)
    """Light that comes from everywhere: red, green and blue."""
    sun: Callable[[Hits, NDArray[np.int64]], Array] | None = None
    """Further light at places, shape (n, 3), from one of `SUNS` places on the sun's disc, by numbers."""
    toward_sun: Vector = (0.0, 0.0, 1.0)
    """Direction of the sun, a unit vector."""
    outside: Callable[[Array], Array] | None = None
    """Function from a ray's direction to its light where it hits nothing, shape (n, 3); `None`: a plain background."""
    outdoors: Callable[[Hits], Flags] | None = None
    """Function that tells which places the day outside lights; `None`: none."""
    shaded_m: float = 0.0
    """Distance up to which things take light from each other, in metres; 0: they do not."""
    exposed: bool = False
    """Whether the picture becomes as bright as a photographer makes it; else lamps say how bright it is."""
    gloss: Array = field(default_factory=lambda: np.zeros((0, 2)))
    """Shares of light that geoms mirror, straight and along the surface, shape (geoms, 2); empty: none does."""


@dataclass(frozen=True, slots=True)
class LightGrid:
    """Light at a grid of pixels, and between them."""

    hits: Hits
    light: Array
    """Light of each pixel of the grid: red, green and blue, shape (rows * columns, 3)."""
    lean: Array
    """Change of the light's brightness by the direction of the surface, shape (rows * columns, 3)."""
    shape: tuple[int, int]
    step: int = STEP
    """Distance between two pixels of the grid, in pixels."""
    fine: "LightGrid | None" = None
    """Light at the pixels of surfaces that are so narrow that the grid misses them; `None`: there are none."""
    known: Array | None = None
    """Mask with 1 for pixels whose light is known, 0 for others; `None`: all are."""

    @classmethod
    def cast(
        cls, caster: RayCaster, hits: Hits, lighting: Lighting, shape: tuple[int, int], closely: bool = False
    ) -> "LightGrid":
        """Finds the light at a grid of a picture's pixels.

        Args:
            caster: Tells what stands between lamps and places.
            hits: What all pixels show.
            lighting: The lamps.
            shape: Rows and columns of the picture.
            closely: Whether pixels with few neighbours on their surface look at several lamps of each set.
        """
        index = np.arange(shape[0] * shape[1]).reshape(shape)[::STEP, ::STEP]
        few = hits[index.ravel()]
        size = (index.shape[0], index.shape[1])
        light, slots = _lit(caster, few, lighting, slots_of(size), 1), slots_of(size)
        if closely:
            lonely = np.flatnonzero(_alone(few, size))
            light[lonely] = _lit(caster, few[lonely], lighting, slots[lonely], _LOOKS_OF_LONELY)
        both = _shared(light, few, size)
        return cls(few, both[:, :3], both[:, 3:], size)

    def refined(self, caster: RayCaster, hits: Hits, lighting: Lighting, shape: tuple[int, int]) -> "LightGrid":
        """Returns the same grid with the light of the pixels that it misses; see `cast` for the arguments."""
        rows, columns = (axis.ravel().astype(float) for axis in np.indices(shape))
        lost = np.flatnonzero((self._near(hits, rows, columns)[1] < _LOST) & (hits.geoms >= 0))
        if len(lost) == 0:
            return self
        light = np.zeros((len(rows), 7))
        light[lost, :6] = _lit(caster, hits[lost], lighting, slots_of(shape)[lost], _LOOKS_OF_MISSED)
        light[lost, 6] = 1
        known = light[:, 6].copy()
        light = soft_light(hits, light, shape, lost)
        light[lost, :6] /= np.maximum(light[lost, 6:], 1e-6)
        return replace(self, fine=LightGrid(hits, light[:, :3], light[:, 3:6], shape, 1, None, known))

    def with_light(self, light: Array) -> "LightGrid":
        """Returns the same grid with other light, shared among neighbours, that is alike in all directions."""
        return LightGrid(self.hits, _shared(light, self.hits, self.shape), np.zeros_like(light), self.shape, self.step)

    def at(self, hits: Hits, rows: Array, columns: Array) -> tuple[Array, Array]:
        """Returns the light at points and how it leans, smoothed over neighbouring pixels of the same surface.

        Both have shape (n, 3).
        """
        both, weight = self._near(hits, rows, columns)
        lost = np.flatnonzero(weight < _LOST)
        if self.fine is not None and len(lost):
            both[lost], weight[lost] = self.fine._near(hits[lost], rows[lost], columns[lost])
            lost = lost[weight[lost] < _LOST]
        # Places that no pixel knows have the light of the most similar ones around.
        row, column = (np.floor(axis[lost] / self.step).astype(np.int64) for axis in (rows, columns))
        both[lost] = self._around(hits[lost], row, column)
        return both[:, :3], both[:, 3:]

    def _near(self, hits: Hits, rows: Array, columns: Array) -> tuple[Array, Array]:
        """Returns the light at points and how it leans, (n, 6), from the four grid pixels around each, and a weight.

        The weight says how much these pixels have to do with the point: about 0 if all show other surfaces.
        """
        both, weight = np.zeros((len(hits.geoms), 6)), np.zeros(len(hits.geoms))
        row, column = np.floor(rows / self.step).astype(np.int64), np.floor(columns / self.step).astype(np.int64)
        height, width = self.shape
        for down in (0, 1):
            for right in (0, 1):
                other = np.clip(row + down, 0, height - 1) * width + np.clip(column + right, 0, width - 1)
                share = np.abs(1 - down - (rows / self.step - row)) * np.abs(1 - right - (columns / self.step - column))
                near = _alike(hits, self.hits, other) * (share + 1e-3)
                if self.known is not None:
                    near *= self.known[other]
                both += self._for(hits.normals, other) * near[:, None]
                weight += near
        return both / np.maximum(weight, 1e-9)[:, None], weight

    def _around(self, hits: Hits, row: NDArray[np.int64], column: NDArray[np.int64]) -> Array:
        height, width = self.shape
        total, weight = np.zeros((len(row), 6)), np.full(len(row), 1e-9)
        for down in range(-_AROUND, _AROUND + 2):
            for right in range(-_AROUND, _AROUND + 2):
                other = np.clip(row + down, 0, height - 1) * width + np.clip(column + right, 0, width - 1)
                turned = np.clip(np.einsum("ij,ij->i", hits.normals, self.hits.normals[other]), 0, 1)
                away = np.sum((hits.places - self.hits.places[other]) ** 2, axis=1)
                near = (turned**4 + 0.02) / (1 + away / _AROUND_M**2) ** 2 * (self.hits.geoms[other] >= 0)
                total += self._for(hits.normals, other) * near[:, None]
                weight += near
        return total / weight[:, None]

    def _for(self, normals: Array, others: NDArray[np.int64]) -> Array:
        """Returns the light of pixels of the grid, and how it leans, as surfaces of other directions would have it.

        The result has shape (n, 6).
        """
        lean = self.lean[others]
        share = turned_light(self.light[others], lean, normals - self.hits.normals[others])
        return np.hstack([self.light[others] * share[:, None], lean])


def slots_of(shape: tuple[int, int]) -> NDArray[np.int64]:
    """Returns a number below `SUNS` for each pixel; each square of four by four pixels has them all."""
    rows, columns = (axis.ravel() for axis in np.indices(shape))
    return (rows % _SLOTS) * _SLOTS + columns % _SLOTS


def turned_light(light: Array, lean: Array, turned: Array) -> Array:
    """Returns what light is multiplied by on a surface that is turned a little.

    Args:
        light: Light on the surface, shape (n, 3).
        lean: How it leans.
        turned: The new unit normal less the old one, shape (n, 3).
    """
    share = 1 + np.einsum("ij,ij->i", lean, turned) / np.maximum(light.mean(axis=1), 1e-4)
    return np.clip(share, _LEAST_TURNED, _MOST_TURNED)


def _alike(hits: Hits, others: Hits, index: NDArray[np.int64]) -> Array:
    """Returns how much places lie on one plane: 1 for the same plane, about 0 for different ones, shape (n,)."""
    normals, places = others.normals[index], others.places[index]
    turned = np.clip(np.einsum("ij,ij->i", hits.normals, normals), 0, 1)
    apart = np.abs(np.einsum("ij,ij->i", hits.normals, hits.places - places))
    return turned**8 / (1 + (apart / 0.02) ** 2) ** 2


def _alone(hits: Hits, shape: tuple[int, int]) -> Flags:
    """Returns a mask of the pixels that share too few neighbours' surfaces to know all lamps from these."""
    rows, columns = (axis.ravel() for axis in np.indices(shape))
    height, width = shape
    alike = np.zeros(height * width)
    for down in (-2, -1, 1, 2):
        for right in (-2, -1, 1, 2):
            other = np.clip(rows + down, 0, height - 1) * width + np.clip(columns + right, 0, width - 1)
            alike += _alike(hits, hits, other) > 0.5
    return (alike < _FEW_ALIKE * 16) & (hits.geoms >= 0)


def _lit(caster: RayCaster, hits: Hits, lighting: Lighting, slots: NDArray[np.int64], looks: int) -> Array:
    """Returns the light at places and how it leans, shape (n, 6), from `looks` lamps of each set.

    `slots` says for each place with which of the lamps to begin. A place without a geom has the ambient light only.
    """
    light = np.zeros((len(slots), 6))
    light[:, :3] = lighting.ambient
    known = hits.geoms >= 0
    for group in lighting.lamps:
        few = min(looks, len(group))
        for number, lamp in enumerate(group):
            turn = (number - slots) % len(group)
            mine = np.flatnonzero((turn % (len(group) // few) == 0) & (turn // (len(group) // few) < few) & known)
            strength, toward = _shine(caster, lamp, hits[mine])
            light[mine, :3] += strength[:, None] * np.array(lamp.color) / few
            light[mine, 3:] += toward / few
    return light


def _shine(caster: RayCaster, lamp: Lamp, hits: Hits) -> tuple[Array, Array]:
    """Returns the brightness of one lamp's light at places, and how it leans, shape (n, 3); 0 in its shadow."""
    ways = hits.places + hits.normals * _SKIN_M - np.array(lamp.place)
    distances = np.linalg.norm(ways, axis=1)
    ways = ways / np.maximum(distances, 1e-6)[:, None]
    cosine = np.clip(-np.sum(ways * hits.normals, axis=1), 0, 1)
    power = lamp.power * 2 / (1 + distances**2)
    if lamp.facing is not None:
        power = power * np.clip(ways @ np.array(lamp.facing), 0, 1)
    strength = cosine * power
    lit = np.flatnonzero(strength > _LEAST_LIT)
    if len(lit):
        _, met, _ = caster.trace(lamp.place, ways[lit])
        strength[lit[(met >= 0) & (met < distances[lit] - 0.012)]] = 0
    return strength, ways * (-power * (strength > 0) * float(np.mean(lamp.color)))[:, None]


@dataclass(frozen=True, slots=True)
class Corners:
    """Share of light that reaches the pixels of a picture past what is around them and close to them."""

    hits: Hits
    share: Array
    """Share of light for each pixel, shape (rows * columns,)."""
    shape: tuple[int, int]

    @classmethod
    def cast(cls, hits: Hits, lighting: Lighting, shape: tuple[int, int]) -> "Corners":
        """Finds the shares from what a picture shows.

        Args:
            hits: What all pixels show.
            lighting: Says how far things take light from each other.
            shape: Rows and columns of the picture.
        """
        if not lighting.shaded_m:
            return cls(hits, np.ones(shape[0] * shape[1]), shape)
        places = hits.places.astype(np.float32)
        normals = hits.normals.astype(np.float32)
        share = _openness(hits.geoms >= 0, places, normals, shape, lighting.shaded_m, _TAKEN)
        share *= _openness(hits.geoms >= 0, places, normals, shape, _CLOSE_M, _TAKEN_CLOSE)
        return cls(hits, np.maximum(_evened(share.reshape(shape), places, normals), _LEAST_OPEN), shape)

    def at(self, hits: Hits, rows: Array, columns: Array) -> Array:
        """Returns the share of light at places in pixels, from the pixels around that show the same surface."""
        height, width = self.shape
        row, column = np.rint(rows).astype(np.int64), np.rint(columns).astype(np.int64)
        total, weight = np.zeros(len(row)), np.zeros(len(row))
        for down in (-1, 0, 1):
            for right in (-1, 0, 1):
                other = np.clip(row + down, 0, height - 1) * width + np.clip(column + right, 0, width - 1)
                near = _alike(hits, self.hits, other) + 1e-4
                total += self.share[other] * near
                weight += near
        return total / weight


def _openness(
    there: Flags, places: Array, normals: Array, shape: tuple[int, int], reach_m: float, taken: float
) -> Array:
    """Returns the share of light from everywhere that reaches pixels past what the picture shows around them.

    Places are asked that lie around the pixel, as far as things reach that take its light. Pixels of a square look in
    different directions. The result has shape (n,).
    """
    height, width = shape
    grid = places.reshape(height, width, 3)
    right, down = np.full(shape, np.inf, np.float32), np.full(shape, np.inf, np.float32)
    right[:, :-1] = np.linalg.norm(grid[:, 1:] - grid[:, :-1], axis=2)
    down[:-1] = np.linalg.norm(grid[1:] - grid[:-1], axis=2)
    # The smaller step: the other one may lead to something far behind.
    step_m = np.maximum(np.minimum(right, down), _SMALL_M).ravel()
    reach = np.clip(reach_m / step_m, 2.0, width / 5).astype(np.float32)
    slots = slots_of(shape)
    rows, columns = (axis.ravel().astype(np.float32) for axis in np.indices(shape))
    covered = np.zeros(height * width, np.float32)
    x, y, z = (np.ascontiguousarray(axis) for axis in places.T)
    right_n, away_n, up_n = (np.ascontiguousarray(axis) for axis in normals.T)
    for look in range(_LOOKS):
        out = reach * np.float32(sqrt((look + 0.5) / _LOOKS))
        turns = look * _GOLDEN_RAD + np.arange(_SLOTS**2) * (2 * pi / _SLOTS**2)
        # Nine digits: the last bits of cos and sin differ between C libraries.
        across, along = (np.round(wave(turns), 9).astype(np.float32)[slots] for wave in (np.cos, np.sin))
        row = np.clip(rows + out * along + 0.5, 0, height - 1).astype(np.int32)
        column = np.clip(columns + out * across + 0.5, 0, width - 1).astype(np.int32)
        other = row * width + column
        dx, dy, dz = x[other] - x, y[other] - y, z[other] - z
        square = np.maximum(dx * dx + dy * dy + dz * dz, _SMALL_M**2)
        over = (dx * right_n + dy * away_n + dz * up_n) / np.sqrt(square)
        near = np.clip(1 - square / np.float32(reach_m**2), 0, 1) * there[other]
        covered += np.clip(over - np.float32(_LEAST_SIN), 0, 1) * near
    return np.clip(1 - covered * np.float32(taken / _LOOKS), _LEAST_OPEN, 1)


def _evened(share: Array, places: Array, normals: Array) -> Array:
    """Evens out what the pixels of a square found in different directions, on one surface; returns shape (n,)."""
    height, width = share.shape
    half = _SLOTS // 2
    x, y, z = (np.pad(axis.reshape(share.shape), half, mode="edge") for axis in places.T)
    u, v, w = (np.pad(axis.reshape(share.shape), half, mode="edge") for axis in normals.T)
    wide = np.pad(share, half, mode="edge")
    mine = (slice(half, half + height), slice(half, half + width))
    total, weight = np.zeros_like(share), np.zeros_like(share)
    for down in range(2 * half + 1):
        for right in range(2 * half + 1):
            other = (slice(down, down + height), slice(right, right + width))
            alike = np.maximum(u[mine] * u[other] + v[mine] * v[other] + w[mine] * w[other], 0) ** 4
            apart = (
                (x[mine] - x[other]) * u[mine] + (y[mine] - y[other]) * v[mine] + (z[mine] - z[other]) * w[mine]
            ) / np.float32(_SAME_PLANE_M)
            part = (0.5 if down in (0, 2 * half) else 1.0) * (0.5 if right in (0, 2 * half) else 1.0)
            near = np.float32(part) * alike / (1 + apart * apart)
            total += wide[other] * near
            weight += near
    return (total / np.maximum(weight, np.float32(1e-6))).ravel()


def _shared(light: Array, hits: Hits, shape: tuple[int, int]) -> Array:
    """Evens light out among the pixels of one surface that looked at different lamps, near ones and then further.

    Edges of shadows stay. Returns the new light; that given stays as it is.
    """
    height, width = shape
    index = np.arange(height * width).reshape(shape)
    rows, columns = (axis.ravel() for axis in np.indices(shape))
    half = _SLOTS // 2
    for step in (1, 2, _SLOTS):
        total, weight = np.zeros_like(light), np.zeros(len(light))
        for down in range(-half, half + 1):
            for right in range(-half, half + 1):
                other = index[np.clip(rows + step * down, 0, height - 1), np.clip(columns + step * right, 0, width - 1)]
                # First all lamps count alike, in squares of one more than the slots whose outermost count half.
                outer, inner = (0.5, 1.0) if step == 1 else (0.17, 0.67)
                near = _alike(hits, hits, other)
                for away in (abs(down), abs(right)):
                    near = near * (outer if away == half else inner if away else 1.0)
                if step > 1:
                    # Light that differs much is a shadow's edge, which stays.
                    near = near / (
                        1
                        + (
                            np.abs(light[other, :3] - light[:, :3]).sum(axis=1)
                            / (0.15 * light[:, :3].sum(axis=1) + 1e-3)
                        )
                        ** 2
                    )
                total += light[other] * near[:, None]
                weight += near
        light = total / np.maximum(weight, 1e-6)[:, None]
    return light


def soft_light(hits: Hits, light: Array, shape: tuple[int, int], chosen: NDArray[np.int64]) -> Array:
    """Returns light evened out among neighbouring pixels of one surface that looked at different places on the sun.

    Args:
        hits: What all pixels show.
        light: Their light, shape (n, channels); left as it is.
        shape: Rows and columns of the picture.
        chosen: The pixels that may have some; others have none.
    """
    height, width = shape
    rows, columns = chosen // width, chosen % width
    half = _SLOTS // 2
    mine = hits[chosen]
    total, weight = np.zeros((len(chosen), light.shape[1])), np.zeros(len(chosen))
    for down in range(-half, half + 1):
        for right in range(-half, half + 1):
            other = np.clip(rows + down, 0, height - 1) * width + np.clip(columns + right, 0, width - 1)
            share = (0.5 if abs(down) == half else 1.0) * (0.5 if abs(right) == half else 1.0)
            near = _alike(mine, hits, other) * share
            total += light[other] * near[:, None]
            weight += near
    even = np.zeros_like(light)
    even[chosen] = total / np.maximum(weight, 1e-6)[:, None]
    return even
