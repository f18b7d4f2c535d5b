"""Ray-traced pictures of a compiled world with MuJoCo's own rays: no graphics driver, no display.

Each pixel's ray is traced once, and four times where an edge runs through the pixel. Light comes from many small lamps;
every pixel samples some of them and shares the result with its neighbours, so that shadows are soft and corners dark
shadows are soft without tracing every lamp from everywhere. Smooth floors mirror what stands on them.
"""

# MuJoCo ships no types for its compiled module.
# pyright: reportAttributeAccessIssue=false

from collections.abc import Callable

import mujoco
import numpy as np
from numpy.typing import NDArray

from ..geometry.parts import Vector
from .ray_casting import Array, Camera, Hits, RayCaster
from .ray_light import STEP, LightGrid, Lighting

GAMMA = 2.2
"""Power that turns colours, as screens have them, into amounts of light."""

_SUB_PIXELS = ((-0.375, -0.125), (0.125, -0.375), (0.375, 0.125), (-0.125, 0.375))
_MIDDLE = 0.25
"""Light in the middle of a well exposed picture of a bright room, of 1."""
_MIRRORED, _GRAZING = 0.03, 0.5
"""Share of light that lacquer and glaze mirror: seen from straight above, and more of it along the floor."""
_LINE_PX = 8
"""Gaps up to twice as long in lines as thin as a pixel are looked at closely."""
_SUN_EDGE = 0.1
"""Difference of sunlight between neighbours that is an edge."""

Look = Callable[[Hits], Array]
"""Function that returns the colours at ray hits, 0 to 1 in sRGB, shape (n, 3).

Negative values mean that the surface shines by itself.
"""


class RayPicture(RayCaster):
    """Ray tracer for pictures of a world.

    Args:
        model: the compiled world.
        look: tells the colours of places.
        background: colour where a ray meets nothing, 0 to 1.
    """

    def __init__(self, model: mujoco.MjModel, look: Look, background: Vector = (0.86, 0.91, 0.95)) -> None:
        super().__init__(model)
        self._look = look
        self._background = np.array(background) ** GAMMA

    def draw(self, camera: Camera, lighting: Lighting, width: int, height: int) -> NDArray[np.uint8]:
        """Renders the picture.

        Args:
            camera: position and direction of the camera.
            lighting: its light.
            width: pixels.
            height: pixels.

        Returns:
            Red, green, blue, shape (height, width, 3).
        """
        rows, columns = (axis.ravel().astype(float) for axis in np.mgrid[0:height, 0:width])
        rays = camera.rays(width, height, columns, rows)
        hits = self.hits(camera.place, rays)
        glass = self.through_glass(camera.place, rays, hits)
        grid = LightGrid.cast(self, hits, lighting, (height, width))
        shot = _Shot(camera, lighting, grid, self._mirror(camera, lighting, grid))
        sun = lighting.sun(hits) if lighting.sun else np.zeros((1, 1))
        common = grid.at(hits, rows, columns) + sun
        mirrored = shot.mirror.at(hits, rows, columns) if shot.mirror else None
        scale = self._scale(shot, hits, common) if lighting.exposed else None
        edge = _edges(hits, glass, sun[:, 0] if lighting.sun else None, (height, width)).ravel()
        total = np.zeros((height * width, 3))
        for right, down in _SUB_PIXELS:
            rays = camera.rays(width, height, columns + right, rows + down)
            seen = self._light_of(shot, Hits(hits.geoms, _on_plane(camera, rays, hits), hits.normals), common, mirrored)
            colors = _finished(seen, glass, scale)
            again = self.hits(camera.place, rays[edge])
            lit = grid.at(again, rows[edge], columns[edge]) + (lighting.sun(again) if lighting.sun else 0.0)
            shown = shot.mirror.at(again, rows[edge], columns[edge]) if shot.mirror else None
            seen = self._light_of(shot, again, lit, shown)
            colors[edge] = _finished(seen, self.through_glass(camera.place, rays[edge], again), scale)
            total += colors
        return np.rint(total.reshape(height, width, 3) * (255 / len(_SUB_PIXELS))).astype(np.uint8)

    def _light_of(self, shot: "_Shot", hits: Hits, light: Array, mirrored: Array | None) -> Array:
        """Light that comes from places to the camera."""
        colors = self._look(hits)
        bright = np.abs(colors) ** GAMMA
        seen = np.where(colors[:, :1] < 0, bright, bright * light)
        if mirrored is not None:
            floor = np.flatnonzero(shot.is_floor(hits))
            seen[floor] += mirrored[floor] * _fresnel(shot.camera, hits[floor])[:, None]
        nothing = np.flatnonzero(hits.geoms < 0)
        if shot.lighting.outside is None:
            seen[nothing] = self._background
        elif len(nothing):
            seen[nothing] = shot.lighting.outside(hits.places[nothing] - np.array(shot.camera.place))
        return seen

    def _mirror(self, camera: Camera, lighting: Lighting, grid: LightGrid) -> LightGrid | None:
        """Light that floors mirror at the grid's pixels, as a camera that is as far below them would see it."""
        floor = np.flatnonzero(np.isin(grid.hits.geoms, lighting.smooth))
        if len(floor) == 0:
            return None
        below = (camera.place[0], camera.place[1], -camera.place[2])
        rays = grid.hits.places[floor] - np.array(below)
        rays /= np.linalg.norm(rays, axis=1, keepdims=True)
        with self.without(lighting.floors):
            hits = self.hits(below, rays)
        colors = self._look(hits)
        bright = np.abs(colors) ** GAMMA
        seen = np.where(colors[:, :1] < 0, bright, bright * grid.light[grid.hits.geoms >= 0].mean(axis=0))
        nothing = hits.geoms < 0
        seen[nothing] = lighting.outside(rays[nothing]) if lighting.outside else self._background
        light = np.zeros_like(grid.light)
        light[floor] = seen
        return grid.with_light(light)

    def _scale(self, shot: "_Shot", hits: Hits, light: Array) -> float:
        """Returns what light is multiplied by for a picture that is neither dark nor pale."""
        few = np.flatnonzero(hits.geoms >= 0)[:: STEP * STEP]
        bright = self._light_of(shot, hits[few], light[few], None).mean(axis=1)
        # Few bright places, such as patches of sun, do not darken the room.
        return _MIDDLE / max(float(np.minimum(bright, 1.5 * np.median(bright)).mean()), 1e-3)


class _Shot:
    """A camera with its light, while a picture is drawn."""

    def __init__(self, camera: Camera, lighting: Lighting, grid: LightGrid, mirror: LightGrid | None) -> None:
        self.camera, self.lighting, self.grid, self.mirror = camera, lighting, grid, mirror

    def is_floor(self, hits: Hits) -> NDArray[np.bool_]:
        """Tells which places are on floors that mirror."""
        return np.isin(hits.geoms, self.lighting.smooth)


def _fresnel(camera: Camera, hits: Hits) -> Array:
    """Share of light that a level floor mirrors at places."""
    ways = hits.places - np.array(camera.place)
    facing = np.clip(-ways[:, 2] / np.maximum(np.linalg.norm(ways, axis=1), 1e-6), 0, 1)
    return _MIRRORED + _GRAZING * (1 - facing) ** 5


def _finished(seen: Array, glass: Array, scale: float | None) -> Array:
    """Colours as eyes see them."""
    seen = seen if scale is None else seen * scale
    seen = seen * (1 - 0.16 * glass[:, None]) + 0.05 * glass[:, None]
    if scale is None:
        # Highlights are compressed as film does.
        return np.clip(seen * (1 + seen / 6.0) / (1 + seen * 0.72), 0, 1) ** (1 / GAMMA)
    # A film's curve by K. Narkowicz: shadows are a little deeper, and highlights never end abruptly.
    return np.clip(seen * (2.51 * seen + 0.03) / (seen * (2.43 * seen + 0.59) + 0.14), 0, 1) ** (1 / GAMMA)


def _on_plane(camera: Camera, rays: Array, hits: Hits) -> Array:
    """Points at which other rays meet the planes that were hit; a metre away where nothing was."""
    reach = np.sum((hits.places - np.array(camera.place)) * hits.normals, axis=1)
    slope = np.sum(rays * hits.normals, axis=1)
    reach = np.where(hits.geoms < 0, 1.0, reach / np.where(np.abs(slope) < 1e-4, 1e-4, slope))
    return np.array(camera.place) + rays * reach[:, None]


def _edges(hits: Hits, glass: Array, sun: Array | None, shape: tuple[int, int]) -> NDArray[np.bool_]:
    """Finds the pixels that show another geom, surface direction or sunlight than a neighbour."""
    kinds = (hits.geoms.astype(np.int64) * 2 + (glass > 0)).reshape(shape)
    normals = hits.normals.reshape(*shape, 3)
    sunny = None if sun is None else sun.reshape(shape)
    edge = np.zeros(shape, np.bool_)
    for axis in (0, 1):
        first = [slice(None), slice(None)]
        second = [slice(None), slice(None)]
        first[axis], second[axis] = slice(0, -1), slice(1, None)
        a, b = tuple(first), tuple(second)
        differ = (kinds[a] != kinds[b]) | (np.sum(normals[a] * normals[b], axis=-1) < 0.8)
        if sunny is not None:
            differ |= np.abs(sunny[a] - sunny[b]) > _SUN_EDGE
        edge[a] |= differ
        edge[b] |= differ
    return edge | _thin(kinds)


def _thin(kinds: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Finds pixels near lines that are as thin as a pixel: rays of pixels beside them go past them by chance."""
    thin = np.zeros(kinds.shape, np.bool_)
    for axis in (0, 1):
        across = kinds if axis == 0 else kinds.T
        line = (across[1:-1] != across[:-2]) & (across[1:-1] != across[2:])
        wide = np.zeros(across.shape, np.bool_)
        wide[1:-1] = line
        for shift in range(-_LINE_PX, _LINE_PX + 1):
            # A slanted line leaves one row for the next.
            for aside in (-1, 0, 1):
                wide[1:-1] |= np.roll(line, (aside, shift), axis=(0, 1))
        thin |= wide if axis == 0 else wide.T
    return thin
