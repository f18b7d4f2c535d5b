"""Reflections in level surfaces: mirrors, screens, glazed tiles and lacquered floors."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .ray_casting import Array, Camera, Hits, Ids, RayCaster
from .ray_light import STEP, Corners, LightGrid, Lighting

_MIRROR = 0.5
"""Share of mirrored light above which a surface is a mirror: what it shows is as sharp as the rest."""
_LEAST_SHARE, _LEAST_MIRROR_SHARE = 0.004, 0.0004
"""Share of the picture from which a surface, or a mirror, gets a reflection of its own."""
_MOST = 7
"""Limit of the surfaces with reflections; the largest ones come first."""
_GRAIN = (0.02, 0.006)
"""Differences of normals, and of distances in metres, up to which places are on one surface."""

Shade = Callable[[Hits, Array], Array]
"""Function that returns the light that comes from places to the camera, by the light on them."""


@dataclass(frozen=True, slots=True)
class Reflections:
    """Light that the surfaces of a picture mirror.

    Gloss is known at a grid of pixels, mirrors at all of them.
    """

    gloss: LightGrid | None
    mirrors: LightGrid | None
    shares: Array
    """Shares of light that geoms mirror, straight and along the surface, shape (geoms, 2)."""
    camera: Camera

    @classmethod
    def cast(
        cls, caster: RayCaster, camera: Camera, hits: Hits, grid: LightGrid, lighting: Lighting, shade: Shade,
        shape: tuple[int, int],
    ) -> "Reflections":  # fmt: skip
        """Finds what the surfaces of a picture mirror.

        Args:
            caster: The world.
            camera: The picture's camera.
            hits: What all its pixels show.
            grid: Their light.
            lighting: The lamps, and which surfaces mirror.
            shade: Tells the light from places.
            shape: Rows and columns of the picture.
        """
        shares = lighting.gloss
        if len(shares) == 0:
            return cls(None, None, shares, camera)
        is_mirror = shares[:, 0] > _MIRROR
        few, full = grid.hits, np.zeros((shape[0] * shape[1], 3))
        found = np.zeros((len(few.geoms), 3))
        size = grid.shape
        any_gloss = any_mirror = False
        for geoms, normal, place in _surfaces(few, shares):
            mirror = bool(is_mirror[geoms[0]])
            scene, at, step = (hits, shape, 1) if mirror else (few, size, STEP)
            mine = np.flatnonzero(np.isin(scene.geoms, geoms) & (np.abs(scene.normals @ normal) > 1 - _GRAIN[0]))
            window = _window(mine, at)
            light = _seen(caster, camera, (normal, place), lighting, shade, window, step, shape)
            inside = _within(mine, window, at)
            (full if mirror else found)[mine] = light[inside]
            any_mirror, any_gloss = any_mirror or mirror, any_gloss or not mirror
        return cls(
            grid.with_light(found) if any_gloss else None,
            LightGrid(hits, full, np.zeros_like(full), shape, 1) if any_mirror else None,
            shares,
            camera,
        )

    def added(self, seen: Array, hits: Hits, rows: Array, columns: Array) -> Array:
        """Adds to the light from places what they mirror, in place, and returns it."""
        if self.gloss is None and self.mirrors is None:
            return seen
        known = np.maximum(hits.geoms, 0)
        straight = np.where(hits.geoms >= 0, self.shares[known, 0], 0.0)
        for source, chosen in (
            (self.gloss, (straight > 0) & (straight <= _MIRROR)),
            (self.mirrors, straight > _MIRROR),
        ):
            mine = np.flatnonzero(chosen)
            if source is None or len(mine) == 0:
                continue
            few = hits[mine]
            light, _ = source.at(few, rows[mine], columns[mine])
            share = self._share(few)[:, None]
            seen[mine] = seen[mine] * (1 - share) + light * share
        return seen

    def _share(self, hits: Hits) -> Array:
        """Returns the share of light that surfaces mirror at places: more of it the more one looks along them."""
        ways = hits.places - np.array(self.camera.place)
        ways /= np.maximum(np.linalg.norm(ways, axis=1), 1e-6)[:, None]
        facing = np.clip(np.abs(np.sum(ways * hits.normals, axis=1)), 0, 1)
        straight, along = self.shares[hits.geoms].T
        return straight + (along - straight) * (1 - facing) ** 5


def _surfaces(few: Hits, shares: Array) -> Iterator[tuple[Ids, Array, Array]]:
    """Yields level surfaces that mirror and are large in the picture: their geoms, normal and a place on them.

    The largest come first; those that fill too little of the picture are left out.
    """
    known = np.maximum(few.geoms, 0)
    glossy = np.flatnonzero((few.geoms >= 0) & (shares[known, 0] > 0))
    if len(glossy) == 0:
        return
    normals, geoms = few.normals[glossy], few.geoms[glossy]
    mirror = shares[geoms, 0] > _MIRROR
    away = np.sum(normals * few.places[glossy], axis=1)
    keys = np.column_stack([np.rint(normals / _GRAIN[0]), np.rint(away / _GRAIN[1]), mirror]).astype(np.int64)
    _, first, index, counts = np.unique(keys, axis=0, return_index=True, return_inverse=True, return_counts=True)
    least = np.where(mirror[first], _LEAST_MIRROR_SHARE, _LEAST_SHARE) * len(few.geoms)
    weight = counts * np.where(mirror[first], 30, 1)
    index = index.reshape(-1)
    for number in np.argsort(-weight, kind="stable")[:_MOST]:
        if counts[number] < least[number]:
            continue
        mine = np.flatnonzero(index == number)
        normal = normals[mine].mean(axis=0)
        yield np.unique(geoms[mine]), normal / np.linalg.norm(normal), few.places[glossy[mine[0]]]


def _window(mine: NDArray[np.int64], shape: tuple[int, int]) -> tuple[int, int, int, int]:
    """Returns the rows and columns (first, and one after the last) that surround pixels: top, bottom, left, right."""
    rows, columns = mine // shape[1], mine % shape[1]
    return int(rows.min()), int(rows.max()) + 1, int(columns.min()), int(columns.max()) + 1


def _within(mine: NDArray[np.int64], window: tuple[int, int, int, int], shape: tuple[int, int]) -> NDArray[np.int64]:
    top, _, left, right = window
    return (mine // shape[1] - top) * (right - left) + mine % shape[1] - left


def _seen(
    caster: RayCaster, camera: Camera, plane: tuple[Array, Array], lighting: Lighting, shade: Shade,
    window: tuple[int, int, int, int], step: int, shape: tuple[int, int],
) -> Array:  # fmt: skip
    """Returns the light that a plane mirrors at the pixels of a part of a picture.

    Args:
        caster: Casts the rays.
        camera: The picture's camera.
        plane: The mirror's normal and a place on it.
        lighting: The lamps and the sun.
        shade: Gives the light that places send to the camera.
        window: Top, bottom, left and right of the part, in steps; bottom and right are exclusive.
        step: Pixels between the places that are looked at.
        shape: Rows and columns of the whole picture.
    """
    normal, place = plane
    top, bottom, left, right = window
    rows, columns = (axis.ravel().astype(float) * step for axis in np.mgrid[top:bottom, left:right])
    rays = camera.rays(shape[1], shape[0], columns, rows)
    eye = np.array(camera.place)
    behind = eye - 2 * ((eye - place) @ normal) * normal
    turned = rays - 2 * (rays @ normal)[:, None] * normal
    x, y, z = (float(value) for value in behind)
    with caster.beyond(place, normal):
        hits = caster.hits((x, y, z), turned)
        size = (bottom - top, right - left)
        grid = LightGrid.cast(caster, hits, lighting, size)
        light, lean = grid.at(hits, *(axis.ravel().astype(float) for axis in np.mgrid[0 : size[0], 0 : size[1]]))
    share = Corners.cast(hits, lighting, size).share[:, None]
    light, lean = light * share, lean * share
    # Places that the sun may shine on are asked for its middle only: what is mirrored need not be finer.
    if lighting.sun:
        light = light + lighting.sun(hits, np.zeros(len(light), np.int64))
    return shade(Hits(hits.geoms, hits.places, hits.normals), np.hstack([light, lean]))
