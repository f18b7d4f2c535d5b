"""Ray-traced pictures of a compiled world with MuJoCo's own rays: no graphics driver, no display.

Each pixel's ray is traced once, and four times where an edge runs through the pixel. Light comes from many small lamps;
every pixel samples some of them and shares the result with its neighbours, so that shadows are soft and corners dark
without tracing every lamp from everywhere.
"""

# MuJoCo ships no types for its compiled module.
# pyright: reportAttributeAccessIssue=false

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import cos, radians, sin, tan
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from ..geometry.parts import Vector

Array = NDArray[np.floating[Any]]
Ids = NDArray[np.int32]

_GAMMA = 2.2
_SLOTS = 4
"""Side of the pixel squares within which neighbouring pixels sample different lamps."""
_STEP = 3
"""Step between pixels for which light is computed, along each axis."""
_CUTOFF_M = 60.0
_GLASS_GROUP = 5
_SUB_PIXELS = ((-0.375, -0.125), (0.125, -0.375), (0.375, 0.125), (-0.125, 0.375))
_SKIN_M = 0.004


@dataclass(frozen=True, slots=True)
class Camera:
    """Position, direction and field of view of a camera."""

    place: Vector
    """Position of the camera, in metres."""
    yaw: float
    """Direction of the camera's view in radians: 0 is east, pi/2 north."""
    pitch: float
    """Angle of the camera's view above the horizon, in radians."""
    fov_deg: float
    """Horizontal field of view of the camera, in degrees."""

    def rays(self, width: int, height: int, columns: Array, rows: Array) -> Array:
        """Returns unit direction vectors through pixel positions, shape (n, 3)."""
        reach = tan(radians(self.fov_deg) / 2)
        right = (columns + 0.5 - width / 2) * (2 * reach / width)
        down = (rows + 0.5 - height / 2) * (2 * reach / width)
        c, s, up, flat = cos(self.yaw), sin(self.yaw), sin(self.pitch), cos(self.pitch)
        ahead, side, over = (
            np.array([c * flat, s * flat, up]),
            np.array([s, -c, 0.0]),
            np.array([-c * up, -s * up, flat]),
        )
        rays = ahead + right[:, None] * side - down[:, None] * over
        return rays / np.linalg.norm(rays, axis=1, keepdims=True)


@dataclass(frozen=True, slots=True)
class Lamp:
    """A small light source in a ray-traced picture."""

    place: Vector
    power: float
    """Power of a lamp: the brightness of a white wall one metre away from it."""
    color: Vector = (1.0, 1.0, 1.0)
    facing: Vector | None = None
    """Direction in which a lamp shines; `None`: everywhere alike."""


@dataclass(frozen=True, slots=True)
class Hits:
    """Points where rays hit geoms, with geom ids and normals."""

    geoms: Ids
    """Geom id that each ray hit; -1: none."""
    places: Array
    normals: Array

    def __getitem__(self, chosen: Any) -> "Hits":
        return Hits(self.geoms[chosen], self.places[chosen], self.normals[chosen])


Look = Callable[[Hits], Array]
"""Function that returns the colours at ray hits, 0 to 1 in sRGB, shape (n, 3).

Negative values mean that the surface shines by itself.
"""


class RayPicture:
    """Ray tracer for pictures of a world.

    Args:
        model: the compiled world.
        look: tells the colours of places.
        background: colour where a ray meets nothing, 0 to 1.
    """

    def __init__(self, model: mujoco.MjModel, look: Look, background: Vector = (0.86, 0.91, 0.95)) -> None:
        self._model = model
        self._look = look
        self._background = np.array(background)
        self._data = mujoco.MjData(model)
        mujoco.mj_forward(model, self._data)
        alpha = (
            np.where(model.geom_matid >= 0, model.mat_rgba[model.geom_matid, 3], model.geom_rgba[:, 3])
            if (model.nmat)
            else model.geom_rgba[:, 3]
        )
        self._is_glass = (alpha < 0.99) & (model.geom_group < 3)
        model.geom_group[self._is_glass] = _GLASS_GROUP
        self._has_panes = bool(self._is_glass.any())
        self._seen = np.array([1, 1, 1, 0, 1, 0], np.uint8)
        self._glass = np.array([0, 0, 0, 0, 0, 1], np.uint8)

    def trace(self, origin: Vector, rays: Array, groups: NDArray[np.uint8] | None = None) -> tuple[Ids, Array, Array]:
        """Casts rays from one point; returns geom (-1: no hit), distance in metres and normal of each ray."""
        count = len(rays)
        geoms, distances = np.full(count, -1, np.int32), np.full(count, -1.0)
        normals = np.zeros(3 * count)
        visible = self._seen if groups is None else groups
        mujoco.mj_multiRay(
            self._model, self._data, np.array(origin, float), np.ascontiguousarray(rays, float).ravel(), visible,
            True, -1, geoms, distances, normals, count, _CUTOFF_M,
        )  # fmt: skip
        return geoms, distances, normals.reshape(-1, 3)

    def glass_share(self, camera: Camera, width: int, height: int) -> float:
        """Returns the share of a picture that is seen through window panes."""
        if not self._is_glass.any():
            return 0.0
        rows, columns = (axis.ravel().astype(float) for axis in np.mgrid[0:height, 0:width])
        rays = camera.rays(width, height, columns, rows)
        (geoms, distances, _), (panes, near, _) = (
            self.trace(camera.place, rays),
            self.trace(camera.place, rays, self._glass),
        )
        return float(((panes >= 0) & ((geoms < 0) | (near < distances))).mean())

    def draw(
        self, camera: Camera, lamps: Sequence[Sequence[Lamp]], width: int, height: int, *, ambient: float = 0.1,
        extra: Callable[["RayPicture", Hits], Array] | None = None,
    ) -> NDArray[np.uint8]:  # fmt: skip
        """Renders the picture.

        Args:
            camera: position and direction of the camera.
            lamps: sets of lamps; a pixel looks at one lamp of each set and at the others through its
                neighbours.
            width: pixels.
            height: pixels.
            ambient: light that comes from everywhere.
            extra: further light at places, shape (n, 3): the sun.

        Returns:
            Red, green, blue, shape (height, width, 3).
        """
        rows, columns = (axis.ravel().astype(float) for axis in np.mgrid[0:height, 0:width])
        self._has_panes = self.glass_share(camera, width // 4, height // 4) > 0
        hits, glass = self._hits(camera, camera.rays(width, height, columns, rows))
        light = _Light.cast(self, hits, lamps, (height, width))
        edge = _edges(hits, glass, (height, width)).ravel()
        total = np.zeros((height * width, 3))
        common = light.at(hits, rows, columns) + ambient
        if extra is not None:
            common = common + extra(self, hits)
        for right, down in _SUB_PIXELS:
            rays = camera.rays(width, height, columns + right, rows + down)
            here = Hits(hits.geoms, _on_plane(camera, rays, hits), hits.normals)
            colors = self._finished(here, common, glass)
            again, again_glass = self._hits(camera, rays[edge])
            lit = light.at(again, rows[edge], columns[edge]) + ambient
            if extra is not None:
                lit = lit + extra(self, again)
            colors[edge] = self._finished(again, lit, again_glass)
            total += colors
        return np.rint(total.reshape(height, width, 3) * (255 / len(_SUB_PIXELS))).astype(np.uint8)

    def _hits(self, camera: Camera, rays: Array) -> tuple[Hits, Array]:
        """Returns the hits of a camera's rays, and whether each ray passes through glass (0 or 1)."""
        if len(rays) == 0:
            return Hits(np.zeros(0, np.int32), np.zeros((0, 3)), np.zeros((0, 3))), np.zeros(0)
        geoms, distances, normals = self.trace(camera.place, rays)
        glass = np.zeros(len(rays))
        if self._has_panes:
            panes, pane_distances, _ = self.trace(camera.place, rays, self._glass)
            glass[(panes >= 0) & ((geoms < 0) | (pane_distances < distances))] = 1
        facing = np.sum(normals * rays, axis=1) > 0
        normals[facing] *= -1
        return Hits(geoms, np.array(camera.place) + rays * np.maximum(distances, 0)[:, None], normals), glass

    def _finished(self, hits: Hits, light: Array, glass: Array) -> Array:
        """Converts light at hits to final sRGB colours."""
        colors = self._look(hits)
        shining = colors[:, :1] < 0
        bright = np.abs(colors) ** _GAMMA
        seen = np.where(shining, bright, bright * light)
        seen = np.where((hits.geoms < 0)[:, None], self._background**_GAMMA, seen)
        seen = seen * (1 - 0.16 * glass[:, None]) + 0.05 * glass[:, None]
        # Highlights are compressed as film does.
        return np.clip(seen * (1 + seen / 6.0) / (1 + seen * 0.72), 0, 1) ** (1 / _GAMMA)


@dataclass(frozen=True, slots=True)
class _Light:
    """Light at a coarse grid of pixels."""

    hits: Hits
    light: Array
    """Light colours at the pixels of a coarse grid, shape (rows, columns, 3)."""
    shape: tuple[int, int]

    @classmethod
    def cast(cls, picture: RayPicture, hits: Hits, lamps: Sequence[Sequence[Lamp]], shape: tuple[int, int]) -> "_Light":
        index = np.arange(shape[0] * shape[1]).reshape(shape)[::_STEP, ::_STEP]
        few = hits[index.ravel()]
        rows, columns = (axis.ravel() for axis in np.indices(index.shape))
        slots = (rows % _SLOTS) * _SLOTS + columns % _SLOTS
        light = np.zeros((len(rows), 3))
        for group in lamps:
            for number, lamp in enumerate(group):
                mine = np.flatnonzero((slots % len(group) == number) & (few.geoms >= 0))
                light[mine] += _shine(picture, lamp, few[mine])
        return cls(few, _shared(light, few, index.shape), (index.shape[0], index.shape[1]))

    def at(self, hits: Hits, rows: Array, columns: Array) -> Array:
        """Returns the light at points, smoothed over neighbouring pixels of the same surface."""
        total, weight = np.zeros((len(hits.geoms), 3)), np.full(len(hits.geoms), 1e-6)
        row, column = np.floor(rows / _STEP).astype(np.int64), np.floor(columns / _STEP).astype(np.int64)
        height, width = self.shape
        light = self.light.reshape(-1, 3)
        for down in (0, 1):
            for right in (0, 1):
                other = np.clip(row + down, 0, height - 1) * width + np.clip(column + right, 0, width - 1)
                share = np.abs(1 - down - (rows / _STEP - row)) * np.abs(1 - right - (columns / _STEP - column))
                near = (_alike(hits, self.hits, other) + 1e-4) * (share + 1e-3)
                total += light[other] * near[:, None]
                weight += near
        return total / weight[:, None]


def _alike(hits: Hits, others: Hits, index: NDArray[np.int64]) -> Array:
    """Returns 1 for points in the same plane, 0 for others."""
    normals, places = others.normals[index], others.places[index]
    turned = np.clip(np.einsum("ij,ij->i", hits.normals, normals), 0, 1)
    apart = np.abs(np.einsum("ij,ij->i", hits.normals, hits.places - places))
    return turned**8 / (1 + (apart / 0.02) ** 2) ** 2


def _shine(picture: RayPicture, lamp: Lamp, hits: Hits) -> Array:
    """Computes the light of one lamp at ray hits."""
    ways = hits.places + hits.normals * _SKIN_M - np.array(lamp.place)
    distances = np.linalg.norm(ways, axis=1)
    ways = ways / np.maximum(distances, 1e-6)[:, None]
    strength = np.clip(-np.sum(ways * hits.normals, axis=1), 0, 1)
    if lamp.facing is not None:
        strength = strength * np.clip(ways @ np.array(lamp.facing), 0, 1)
    strength = strength * (lamp.power * 2 / (1 + distances**2))
    lit = np.flatnonzero(strength > 3e-3)
    if len(lit):
        _, met, _ = picture.trace(lamp.place, ways[lit])
        strength[lit[(met >= 0) & (met < distances[lit] - 0.012)]] = 0
    return strength[:, None] * np.array(lamp.color)


def _shared(light: Array, hits: Hits, shape: tuple[int, ...]) -> Array:
    """Averages light among neighbouring pixels of one surface that sampled different lamps."""
    height, width = shape
    index = np.arange(height * width).reshape(shape)
    total, weight = np.zeros_like(light), np.zeros(len(light))
    rows, columns = (axis.ravel() for axis in np.indices(shape))
    for down in range(-_SLOTS // 2, _SLOTS // 2 + 1):
        for right in range(-_SLOTS // 2, _SLOTS // 2 + 1):
            other = index[np.clip(rows + down, 0, height - 1), np.clip(columns + right, 0, width - 1)]
            # Squares of one more than the slots: the outermost count half.
            share = (0.5 if abs(down) == _SLOTS // 2 else 1.0) * (0.5 if abs(right) == _SLOTS // 2 else 1.0)
            near = _alike(hits, hits, other) * share
            total += light[other] * near[:, None]
            weight += near
    return (total / np.maximum(weight, 1e-6)[:, None]).reshape(height, width, 3)


def _on_plane(camera: Camera, rays: Array, hits: Hits) -> Array:
    """Returns the points where other rays meet the planes that were hit."""
    reach = np.sum((hits.places - np.array(camera.place)) * hits.normals, axis=1)
    slope = np.sum(rays * hits.normals, axis=1)
    return np.array(camera.place) + rays * (reach / np.where(np.abs(slope) < 1e-4, 1e-4, slope))[:, None]


def _edges(hits: Hits, glass: Array, shape: tuple[int, int]) -> NDArray[np.bool_]:
    """Finds the pixels that show another geom or surface direction than a neighbour."""
    kinds = (hits.geoms.astype(np.int64) * 2 + (glass > 0)).reshape(shape)
    normals = hits.normals.reshape(*shape, 3)
    edge = np.zeros(shape, np.bool_)
    for axis in (0, 1):
        first = [slice(None), slice(None)]
        second = [slice(None), slice(None)]
        first[axis], second[axis] = slice(0, -1), slice(1, None)
        a, b = tuple(first), tuple(second)
        differ = (kinds[a] != kinds[b]) | (np.sum(normals[a] * normals[b], axis=-1) < 0.8)
        edge[a] |= differ
        edge[b] |= differ
    return edge
