"""Ray-traced pictures of a compiled world with MuJoCo's own rays: no graphics driver, no display.

Each pixel's ray is traced once, and four times where an edge runs through the pixel. Light comes from many small lamps;
every pixel samples some of them and shares the result with its neighbours, so that shadows are soft and corners dark
without tracing every lamp from everywhere. Smooth floors mirror what stands on them.
"""

# MuJoCo ships no types for its compiled module.
# pyright: reportAttributeAccessIssue=false

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from ..geometry.parts import Vector
from .ray_casting import Array, Camera, Hits, RayCaster
from .ray_light import STEP, Corners, LightGrid, Lighting, slots_of, soft_light, turned_light
from .reflections import Reflections, Shade

GAMMA = 2.2
"""Power that turns colours, as screens have them, into amounts of light."""

_SUB_PIXELS = ((-0.375, -0.125), (0.125, -0.375), (0.375, 0.125), (-0.125, 0.375))
_MIDDLE, _HIGHLIGHT = 0.48, 1.4
"""Light in the middle of a well exposed picture of a bright room, and that which a tenth is brighter than at most."""
_BALANCE = 0.6
"""Share of a room's tint of light that a photographer takes away: walls of wood make everything yellow."""
_VIEW = 2.3
"""Light of a white thing outside, over that of one in the picture's middle: photographers expose for both."""
_DAYLIGHT, _SUNLIGHT = 0.55, 0.6
"""Light of the sky and of the sun on what is outside, where 1 is white."""
_LINE_PX = 8
"""Half the length in pixels of the gaps in lines as thin as a pixel that are looked at closely."""
_SUN_EDGE_PX = 3
"""Number of pixels beside sunny ones that may have some sun: as far as neighbours share it."""

_KNEE = 0.25
"""Light up to which paper shows what is there; brighter places come ever more slowly to white."""
_PALER = 0.4
"""Share of the colour that bright places lose as on film; the rest is as bright, and has the hue it had."""
_DEPTH = 0.18
"""Strength of the curve that makes dark places darker and bright ones brighter, around the middle."""
_BRIGHTNESS = np.array((0.2126, 0.7152, 0.0722), np.float32)

Look = Callable[[Hits], Array]
"""Function that returns the colours at ray hits, 0 to 1 in sRGB, shape (n, 3).

Negative values mean that the surface shines by itself.
"""


class RayPicture(RayCaster):
    """Ray tracer for pictures of a world.

    Args:
        model: The compiled world.
        look: Tells the colours of places.
        background: Colour where a ray meets nothing, 0 to 1.
        bend: Tells the directions that surfaces have at places for light, which are not flat; absent: the same.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        look: Look,
        background: Vector = (0.86, 0.91, 0.95),
        bend: Callable[[Hits], Array] | None = None,
    ) -> None:
        super().__init__(model)
        self._look, self._bend = look, bend
        self._background = np.array(background) ** GAMMA

    def draw(self, camera: Camera, lighting: Lighting, width: int, height: int) -> NDArray[np.uint8]:
        """Renders the picture.

        Args:
            camera: Position and direction of the camera.
            lighting: Its light.
            width: Pixels.
            height: Pixels.

        Returns:
            Red, green, blue, shape (height, width, 3).
        """
        rows, columns = (axis.ravel().astype(float) for axis in np.mgrid[0:height, 0:width])
        with self.before(camera):
            hits = self.hits(camera.place, camera.rays(width, height, columns, rows))
            glass = self.through_glass(camera.place, camera.rays(width, height, columns, rows), hits)
        shape = (height, width)
        grid = LightGrid.cast(self, hits, lighting, shape, closely=True).refined(self, hits, lighting, shape)
        sun = self._sun(hits, lighting, shape)
        corners = Corners.cast(hits, lighting, shape)
        shot = _Shot(camera, lighting, grid, sun)
        common = shot.light(hits, rows, columns, corners.share)
        # Bumps and rounded edges are the same for all rays of a pixel.
        common = common * self._turned(hits, common)[:, None]
        scale = self._scale(shot, hits, common) if lighting.exposed else None
        if scale is not None:
            shot.view = _VIEW / scale
        shot.mirror = Reflections.cast(self, camera, hits, grid, lighting, shot.shader(self._shade), shape)
        edge = _edges(hits, glass, shape).ravel()
        total = np.zeros((height * width, 3))
        for right, down in _SUB_PIXELS:
            rays = camera.rays(width, height, columns + right, rows + down)
            seen = self._shade(shot, Hits(hits.geoms, _on_plane(camera, rays, hits), hits.normals), common)
            colors = _finished(shot.mirror.added(seen, hits, rows, columns), glass, scale)
            with self.before(camera):
                again = self.hits(camera.place, rays[edge])
                clear = self.through_glass(camera.place, rays[edge], again)
            where = rows[edge] + down, columns[edge] + right
            lit = shot.light(again, *where, corners.at(again, *where))
            seen = self._shade(shot, again, lit * self._turned(again, lit)[:, None])
            seen = shot.mirror.added(seen, again, rows[edge], columns[edge])
            colors[edge] = _finished(seen, clear, scale)
            total += colors
        return np.rint(total.reshape(height, width, 3) * (255 / len(_SUB_PIXELS))).astype(np.uint8)

    def before(self, camera: Camera) -> AbstractContextManager[None]:
        """Returns a context in which a camera that stands behind a wall sees through it; for others it does nothing."""
        if camera.front is None:
            return nullcontext()
        place, normal = camera.front
        return self.beyond(np.array(place), np.array(normal))

    def _sun(self, hits: Hits, lighting: Lighting, shape: tuple[int, int]) -> LightGrid | None:
        """Returns the sunlight at each pixel, with soft edges as the sun has a width; `None` if no sun shines."""
        if lighting.sun is None:
            return None
        light = lighting.sun(hits, slots_of(shape))
        lit = (light[:, 0] > 0).reshape(shape)
        light = soft_light(hits, light, shape, np.flatnonzero(_widened(lit)))
        lean = light.mean(axis=1)[:, None] * np.array(lighting.toward_sun)
        facing = np.clip(hits.normals @ np.array(lighting.toward_sun), 0.05, 1)[:, None]
        return LightGrid(hits, light, lean / facing, shape, 1)

    def _turned(self, hits: Hits, light: Array) -> Array:
        """Returns the share of light that places have on the bumps and rounded edges of their surfaces."""
        if self._bend is None:
            return np.ones(len(light))
        return turned_light(light[:, :3], light[:, 3:], self._bend(hits) - hits.normals)

    def _shade(self, shot: "_Shot", hits: Hits, light: Array) -> Array:
        """Returns the light that comes from places to the camera, shape (n, 3), for the light that falls on them.

        Rays that hit nothing have the background or, through a window, the view.
        """
        colors = self._look(hits)
        bright = np.abs(colors) ** GAMMA
        seen = np.where(colors[:, :1] < 0, bright, bright * light[:, :3])
        nothing = np.flatnonzero(hits.geoms < 0)
        if shot.lighting.outside is None:
            seen[nothing] = self._background
        elif len(nothing):
            seen[nothing] = shot.lighting.outside(hits.places[nothing] - np.array(shot.camera.place)) * shot.view
        if shot.lighting.outdoors is not None:
            open_air = np.flatnonzero(shot.lighting.outdoors(hits))
            facing = np.clip(hits.normals[open_air] @ np.array(shot.lighting.toward_sun), 0, 1)[:, None]
            seen[open_air] = bright[open_air] * (_DAYLIGHT + _SUNLIGHT * facing) * shot.view
        return seen

    def _scale(self, shot: "_Shot", hits: Hits, light: Array) -> Array:
        """Returns what red, green and blue are multiplied by for a picture that is not dark, pale or tinted."""
        few = np.flatnonzero(hits.geoms >= 0)[:: STEP * STEP]
        bright = self._shade(shot, hits[few], light[few]).mean(axis=1)
        # Few bright places, such as patches of sun, do not darken the room.
        scale = _MIDDLE / max(float(np.minimum(bright, 1.5 * np.median(bright)).mean()), 1e-3)
        scale = min(scale, _HIGHLIGHT / max(float(np.quantile(bright, 0.9)), 1e-3))
        tint = np.maximum(np.minimum(light[few, :3], 1.5 * np.median(light[few, :3])).mean(axis=0), 1e-3)
        return scale * (tint.mean() / tint) ** _BALANCE


class _Shot:
    """A camera with its light, while a picture is drawn."""

    mirror: Reflections
    view: Array | float = 1.0
    """Light of a white thing outside, as it is seen in the picture."""

    def __init__(self, camera: Camera, lighting: Lighting, grid: LightGrid, sun: LightGrid | None) -> None:
        self.camera, self.lighting, self._grid, self._sun_at = camera, lighting, grid, sun

    def light(self, hits: Hits, rows: Array, columns: Array, share: Array) -> Array:
        """Returns the light at places and how it leans, shape (n, 6); corners get a share of what is no sunlight."""
        light = np.hstack(self._grid.at(hits, rows, columns)) * share[:, None]
        if self._sun_at is not None:
            grid = self._sun_at
            height, width = grid.shape
            row, column = (np.clip(np.floor(axis).astype(np.int64), 0, most - 1)
                           for axis, most in ((rows, height), (columns, width)))  # fmt: skip
            near = np.flatnonzero(_widened(grid.light[:, 0].reshape(grid.shape) > 0)[row, column])
            light[near] += np.hstack(grid.at(hits[near], rows[near], columns[near]))
        return light

    def shader(self, shade: "Callable[[_Shot, Hits, Array], Array]") -> Shade:
        """Returns a function that shades what this shot's surfaces mirror."""
        return lambda hits, light: shade(self, hits, light)


def _widened(marked: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Marks the pixels around marked ones as well."""
    return np.asarray(ndimage.binary_dilation(marked, iterations=_SUN_EDGE_PX), np.bool_)


def _finished(seen: Array, glass: Array, scale: Array | None) -> Array:
    """Returns the colours of a picture as eyes see them, from 0 to 1.

    `glass` says which pixels are seen through glass. Light is multiplied by `scale`; `None` compresses it as film does.
    """
    seen = seen if scale is None else seen * scale
    seen = seen * (1 - 0.1 * glass[:, None]) + 0.02 * glass[:, None]
    if scale is None:
        # Highlights are compressed as film does.
        return np.clip(seen * (1 + seen / 6.0) / (1 + seen * 0.72), 0, 1) ** (1 / GAMMA)
    return _developed(seen)


def _developed(seen: Array) -> Array:
    """Returns colours of light on paper, from 0 to 1: whites are white, and bright places keep their drawing."""
    seen = seen.astype(np.float32)
    strongest = seen.max(axis=1)
    level = (strongest + seen @ _BRIGHTNESS) / 2
    kept = seen * (_paper(level) / np.maximum(level, 1e-6))[:, None]
    # What one colour has over white becomes paler.
    bright, strongest = kept @ _BRIGHTNESS, kept.max(axis=1)
    share = np.clip((1 - bright) / np.maximum(strongest - bright, 1e-6), 0, 1)
    kept = bright[:, None] + (kept - bright[:, None]) * share[:, None]
    shown = np.clip(_PALER * _paper(seen) + (1 - _PALER) * kept, 0, 1) ** np.float32(1 / GAMMA)
    return shown + _DEPTH * shown * (1 - shown) * (2 * shown - 1)


def _paper(light: Array) -> Array:
    """Returns the brightness of paper for light."""
    rest = 1 - _KNEE
    return np.where(light < _KNEE, light, 1 - rest * np.exp(np.minimum((_KNEE - light) / rest, 0)))


def _on_plane(camera: Camera, rays: Array, hits: Hits) -> Array:
    """Returns the points at which other rays meet the planes that were hit; a metre away where nothing was."""
    reach = np.sum((hits.places - np.array(camera.place)) * hits.normals, axis=1)
    slope = np.sum(rays * hits.normals, axis=1)
    reach = np.where(hits.geoms < 0, 1.0, reach / np.where(np.abs(slope) < 1e-4, 1e-4, slope))
    return np.array(camera.place) + rays * reach[:, None]


def _edges(hits: Hits, glass: Array, shape: tuple[int, int]) -> NDArray[np.bool_]:
    """Returns a mask of the pixels that show another geom or surface direction than a neighbour, or a thin line."""
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
    return edge | _thin(kinds)


def _thin(kinds: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Returns a mask of pixels near lines that are as thin as a pixel: rays beside them go past them by chance."""
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
