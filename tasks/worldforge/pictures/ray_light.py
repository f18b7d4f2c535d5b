"""Light in ray-traced pictures: many small lamps, and the shade of corners, at a grid of pixels."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from math import cos, sin, sqrt

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

_CLOSE_M = 0.16
"""Distance up to which things darken what they touch, in metres."""
_LOOKS = 14
"""Number of places around a pixel that are asked whether they take light from it."""
_GOLDEN_RAD = 2.399963
"""Angle between two of these places, in radians, with which they lie evenly."""
_LEAST_SIN = 0.08
"""Sine of the height above a surface from which a place takes light: surfaces are not quite flat, nor is it exact."""
_TAKEN = 3.0
"""Factor of the light that is taken, over the share of the half sphere that places around it cover."""
_LEAST_OPEN = 0.3
"""Share of light that reaches the deepest corner."""
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
    def cast(cls, caster: RayCaster, hits: Hits, lighting: Lighting, shape: tuple[int, int]) -> "LightGrid":
        """Finds the light at a grid of a picture's pixels.

        Args:
            caster: Tells what stands between lamps and places.
            hits: What all pixels show.
            lighting: The lamps.
            shape: Rows and columns of the picture.
        """
        index = np.arange(shape[0] * shape[1]).reshape(shape)[::STEP, ::STEP]
        few = hits[index.ravel()]
        size = (index.shape[0], index.shape[1])
        every = np.arange(len(few.geoms))
        both = _lit(caster, few, lighting, slots_of(size), 1) * _shade_of_corners(few, size, lighting, every)
        both = _shared(both, few, size)
        return cls(few, both[:, :3], both[:, 3:], size)

    def refined(self, caster: RayCaster, hits: Hits, lighting: Lighting, shape: tuple[int, int]) -> "LightGrid":
        """Returns the same grid with the light of the pixels that it misses; see `cast` for the arguments."""
        rows, columns = (axis.ravel().astype(float) for axis in np.indices(shape))
        lost = np.flatnonzero((self._near(hits, rows, columns)[1] < _LOST) & (hits.geoms >= 0))
        if len(lost) == 0:
            return self
        light = np.zeros((len(rows), 7))
        light[lost, :6] = _lit(caster, hits[lost], lighting, slots_of(shape)[lost], _LOOKS_OF_MISSED)
        light[lost, :6] *= _shade_of_corners(hits, shape, lighting, lost)
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


def _shade_of_corners(hits: Hits, shape: tuple[int, int], lighting: Lighting, chosen: NDArray[np.int64]) -> Array:
    """Returns the share of light, (n, 1), that reaches chosen pixels past what is around them and close to them."""
    share = np.ones(len(chosen))
    if lighting.shaded_m:
        share = _openness(hits, shape, lighting.shaded_m, chosen) * _openness(hits, shape, _CLOSE_M, chosen)
    return share[:, None]


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


def _openness(hits: Hits, shape: tuple[int, int], reach_m: float, chosen: NDArray[np.int64]) -> Array:
    """Returns the share of light from everywhere that reaches chosen pixels past what the picture shows around them.

    Places are asked that lie around the pixel, as far as things reach that take its light. The result has shape (n,).
    """
    height, width = shape
    mine, rows, columns = hits[chosen], chosen // width, chosen % width
    right = np.linalg.norm(hits.places[np.minimum(columns + 1, width - 1) + rows * width] - mine.places, axis=1)
    down = np.linalg.norm(hits.places[columns + np.minimum(rows + 1, height - 1) * width] - mine.places, axis=1)
    # The smaller step: the other one may lead to something far behind. At edges of the picture there is none.
    step_m = np.maximum(
        np.where(np.minimum(right, down) < _SMALL_M, np.maximum(right, down), np.minimum(right, down)), _SMALL_M
    )
    reach = np.clip(reach_m / step_m, 2.0, width / 5)
    start = ((rows % _SLOTS) * _SLOTS + columns % _SLOTS) * (2 * np.pi / _SLOTS**2)
    taken = np.zeros(len(rows))
    for look in range(_LOOKS):
        out = reach * sqrt((look + 0.5) / _LOOKS)
        turn = np.array((cos(look * _GOLDEN_RAD), sin(look * _GOLDEN_RAD)))
        across = out * (turn[0] * np.cos(start) - turn[1] * np.sin(start))
        along = out * (turn[1] * np.cos(start) + turn[0] * np.sin(start))
        row = np.clip(np.rint(rows + along).astype(np.int64), 0, height - 1)
        column = np.clip(np.rint(columns + across).astype(np.int64), 0, width - 1)
        ways = hits.places[row * width + column] - mine.places
        away = np.maximum(np.linalg.norm(ways, axis=1), _SMALL_M)
        over = np.einsum("ij,ij->i", ways, mine.normals) / away
        near = np.clip(1 - (away / reach_m) ** 2, 0, 1) * (hits.geoms[row * width + column] >= 0)
        taken += np.clip(over - _LEAST_SIN, 0, 1) * near
    return np.clip(1 - _TAKEN * taken / _LOOKS, _LEAST_OPEN, 1)


def _shared(light: Array, hits: Hits, shape: tuple[int, int]) -> Array:
    """Evens light out among the pixels of one surface that looked at different lamps, near ones and then further.

    Edges of shadows stay. Returns the new light; that given stays as it is.
    """
    height, width = shape
    index = np.arange(height * width).reshape(shape)
    rows, columns = (axis.ravel() for axis in np.indices(shape))
    half = _SLOTS // 2
    for step in (1, _SLOTS):
        total, weight = np.zeros_like(light), np.zeros(len(light))
        for down in range(-half, half + 1):
            for right in range(-half, half + 1):
                other = index[np.clip(rows + step * down, 0, height - 1), np.clip(columns + step * right, 0, width - 1)]
                # Squares of one more than the slots: the outermost count half.
                share = (0.5 if abs(down) == half else 1.0) * (0.5 if abs(right) == half else 1.0)
                near = _alike(hits, hits, other) * share
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
