"""Renderer without OpenGL: casts rays, one for each pixel that may show something else than those around it."""

# MuJoCo ships no types for its compiled module.
# pyright: reportAttributeAccessIssue=false, reportInvalidTypeForm=false

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from .cameras import MAX_GEOMS, Depths, Image
from .views import SHOWN_GROUPS, View, hidden, roofs

_SKY = np.array([0.62, 0.74, 0.88])
_LIGHT = np.array([0.35, -0.25, 0.9]) / np.linalg.norm([0.35, -0.25, 0.9])
_MAX_RAYS = 320 * 240
"""Maximum number of rays; larger images are upscaled. A ray costs about two microseconds in a furnished flat."""
_GRID = 3
"""Step of the coarse grid in pixels: pixels in between are cast only if the grid pixels around them differ."""
_SAME_SURFACE = 0.995
"""Cosine of the angle between normals up to which pixels belong to one flat surface."""

_Vectors = NDArray[np.float64]
_Pixels = NDArray[np.intp]


class _Window(NamedTuple):
    """Edges of the field of view at one metre in front of the camera: metres to the right and up."""

    left: float
    right: float
    bottom: float
    top: float


class RayCamera:
    """Renders colour and depth images by MuJoCo's rays on the CPU, without a graphics driver and without textures.

    At most `_MAX_RAYS` rays are cast: larger images are made coarser and upscaled. In colour images, pixels inside one
    flat surface take over the colour of those around them, without a ray of their own.
    """

    def __init__(self, model: mujoco.MjModel, width: int, height: int) -> None:
        """Computes the colours of a model's geoms, for pictures that are made by casting rays.

        Args:
            model: The model.
            width: Pixels.
            height: Pixels.
        """
        self._model = model
        self._size = width, height
        self._colours = geom_colours(model)
        self._roofs = roofs(model)
        # A scene without a renderer, only to learn where a view stands and looks.
        self._scene = mujoco.MjvScene(model, maxgeom=MAX_GEOMS)
        self._option = mujoco.MjvOption()
        self._buffers: dict[tuple[int, int], _Buffers] = {}

    def picture(self, data: mujoco.MjData, view: View, size: tuple[int, int] | None = None) -> Image:
        """Renders a simulation state from a camera view as an RGB image by casting rays, coarser if it is large.

        See `Camera`. Without a size in pixels, the image has the camera's own.
        """
        return self._enlarged(lambda shape: self._cast(data, view, shape), size or self._size)

    def depths(self, data: mujoco.MjData, view: View) -> Depths:
        """Renders the depths in a camera view in metres by casting rays; see `Camera`."""
        return self._enlarged(lambda shape: self._measure(data, view, shape), self._size)

    def _enlarged(self, make: Callable[[tuple[int, int]], NDArray[Any]], size: tuple[int, int]) -> NDArray[Any]:
        """Returns an image that is made with a limited number of rays, upscaled to a size (width, height)."""
        width, height = size
        coarseness = math.ceil(math.sqrt(width * height / _MAX_RAYS))
        made = make((math.ceil(height / coarseness), math.ceil(width / coarseness)))
        if coarseness > 1:
            made = made.repeat(coarseness, axis=0).repeat(coarseness, axis=1)[:height, :width]
        return np.ascontiguousarray(made)

    def close(self) -> None:
        """Does nothing, as this renderer has no OpenGL context; see `Camera`."""

    def _cast(self, data: mujoco.MjData, view: View, shape: tuple[int, int]) -> Image:
        with self._aimed(data, view, shape) as (eye, rays, buffers, housing):
            self._hit(data, eye, rays, buffers, buffers.grid, housing)
            self._hit(data, eye, rays, buffers, buffers.between(), housing)
        shade = 0.45 + 0.55 * np.abs(buffers.normals @ _LIGHT)
        shade[buffers.geoms < 0] = 1.0
        return (self._colours[buffers.geoms] * (255 * shade[:, None])).astype(np.uint8).reshape(*shape, 3)

    def _measure(self, data: mujoco.MjData, view: View, shape: tuple[int, int]) -> Depths:
        with self._aimed(data, view, shape) as (eye, rays, buffers, housing):
            away_m = self._hit(data, eye, rays, buffers, np.arange(len(rays)), housing)
        along = buffers.directions(self._eye(shape)[3])[:, 0]
        return np.where(away_m >= 0.0, away_m * along, np.inf).astype(np.float32).reshape(shape)

    @contextmanager
    def _aimed(
        self, data: mujoco.MjData, view: View, shape: tuple[int, int]
    ) -> Iterator[tuple[_Vectors, _Vectors, "_Buffers", int]]:
        """Yields the camera's position, rays, buffers and the body around the camera, while back faces are hidden.

        Args:
            data: The state.
            view: Camera view.
            shape: Height and width of the image in pixels.
        """
        no_category = 0  # the scene's camera is all that is wanted
        mujoco.mjv_updateScene(self._model, data, self._option, None, view(data), no_category, self._scene)
        if shape not in self._buffers:
            self._buffers[shape] = _Buffers(shape)
        buffers = self._buffers[shape]
        eye, forward, up, window = self._eye(shape)
        rays = buffers.directions(window) @ np.array((forward, up, np.cross(forward, up)))
        housing = self._body_around(data, eye, forward)
        # Rays see what looks away from them, which renderers leave out.
        above = data.geom_xpos[self._roofs, 2] < eye[2]
        with hidden(self._model, self._roofs[above]):
            yield eye, rays, buffers, housing

    def _hit(
        self, data: mujoco.MjData, eye: _Vectors, rays: _Vectors, buffers: "_Buffers", pixels: _Pixels, housing: int
    ) -> _Vectors:
        """Finds the geoms at some pixels and stores them in the buffers, with the surfaces' normals.

        Args:
            data: The state.
            eye: Position of the camera in metres.
            rays: Unit vectors of all pixels, shape (pixels, 3).
            buffers: Geoms and normals of the image.
            pixels: Numbers of the pixels to cast, shape (n,).
            housing: Body around the camera, which is not seen.

        Returns:
            Distances along their rays in metres, shape (n,), -1 without a hit.
        """
        away_m = np.zeros(len(pixels))
        if not len(pixels):
            return away_m
        geoms, normals = np.zeros(len(pixels), dtype=np.int32), np.zeros((len(pixels), 3))
        mujoco.mj_multiRay(
            self._model, data, eye, rays[pixels].ravel(), SHOWN_GROUPS, True, housing, geoms, away_m,
            normals.ravel(), len(pixels), self._model.vis.map.zfar * self._model.stat.extent,
        )  # fmt: skip
        buffers.geoms[pixels], buffers.normals[pixels] = geoms, normals
        return away_m

    def _eye(self, shape: tuple[int, int]) -> tuple[_Vectors, _Vectors, _Vectors, _Window]:
        """Returns the camera's position, its forward and up directions, and its field of view at one metre."""
        left, right = self._scene.camera[0], self._scene.camera[1]
        eye = (np.asarray(left.pos, dtype=float) + right.pos) / 2
        forward, up = np.asarray(left.forward, dtype=float), np.asarray(left.up, dtype=float)
        top, bottom, middle, half = (
            float(each) / left.frustum_near
            for each in (left.frustum_top, left.frustum_bottom, left.frustum_center, left.frustum_width)
        )
        # Like `mjr_render`: without a width of its own the view is as wide as the picture.
        half = half or (top - bottom) / 2 * shape[1] / shape[0]
        return eye, forward, up, _Window(middle - half, middle + half, bottom, top)

    def _body_around(self, data: mujoco.MjData, eye: _Vectors, forward: _Vectors) -> int:
        """Returns the body whose geom encloses the camera, such as its housing, or -1.

        OpenGL does not draw back faces, but a ray would hit the housing from inside.
        """
        geom, normal = np.zeros(1, dtype=np.int32), np.zeros(3)
        mujoco.mj_ray(self._model, data, eye, forward, SHOWN_GROUPS, True, -1, geom, normal)
        inside = geom[0] >= 0 and normal @ forward > 0
        body = int(self._model.geom_bodyid[geom[0]]) if inside else 0
        return body or -1


class _Buffers:
    """Memory for pictures of one size, which is used again: geom and surface normal of each pixel."""

    def __init__(self, shape: tuple[int, int]) -> None:
        count = shape[0] * shape[1]
        self.geoms = np.zeros(count, dtype=np.int32)
        self.normals = np.zeros((count, 3))
        self._shape = shape
        self._window, self._directions = _Window(0, 0, 0, 0), np.zeros((count, 3))
        rows, columns = (_grid_lines(length) for length in shape)
        self.grid: _Pixels = (rows[:, None] * shape[1] + columns).ravel()
        """Indices of the pixels that are cast first, including the last row and column."""
        self._grid_shape = len(rows), len(columns)
        self._steps = np.diff(rows), np.diff(columns)
        self._in_grid = np.zeros(count, dtype=bool)
        self._in_grid[self.grid] = True

    def directions(self, window: _Window) -> _Vectors:
        """Returns unit vectors through the pixels as (forward, up, right), shape (pixels, 3), by rows from the top."""
        if window != self._window:
            height, width = self._shape
            rays = np.ones((height, width, 3))
            left, right, bottom, top = window
            rays[..., 1] = (top - (np.arange(height) + 0.5) * ((top - bottom) / height))[:, None]
            rays[..., 2] = left + (np.arange(width) + 0.5) * ((right - left) / width)
            self._window = window
            self._directions = (rays / np.linalg.norm(rays, axis=2, keepdims=True)).reshape(-1, 3)
        return self._directions

    def between(self) -> _Pixels:
        """Fills grid cells whose corners see one flat surface; returns the numbers of the pixels still to be cast."""
        geoms = self.geoms[self.grid].reshape(self._grid_shape)
        normals = self.normals[self.grid].reshape(*self._grid_shape, 3)
        first, first_normal = geoms[:-1, :-1], normals[:-1, :-1]
        same = np.ones(first.shape, dtype=bool)
        for corner in ((slice(1, None), slice(None, -1)), (slice(None, -1), slice(1, None)), (slice(1, None),) * 2):
            alike = np.einsum("rci,rci->rc", normals[corner], first_normal) > _SAME_SURFACE
            same &= (geoms[corner] == first) & (alike | (first < 0))
        cells = np.zeros(self._shape, dtype=np.intp)
        known = np.zeros(self._shape, dtype=bool)
        cells[:-1, :-1] = self._enlarged(self.grid.reshape(self._grid_shape)[:-1, :-1])
        known[:-1, :-1] = self._enlarged(same)
        fill = np.flatnonzero(known.ravel() & ~self._in_grid)
        source = cells.ravel()[fill]
        self.geoms[fill], self.normals[fill] = self.geoms[source], self.normals[source]
        return np.flatnonzero(~(known.ravel() | self._in_grid))

    def _enlarged(self, cells: NDArray[Any]) -> NDArray[Any]:
        """Returns an array in which each grid cell's value is repeated for all pixels of the cell."""
        return cells.repeat(self._steps[0], axis=0).repeat(self._steps[1], axis=1)


def _grid_lines(length: int) -> _Pixels:
    return np.unique(np.append(np.arange(0, length, _GRID), length - 1))


def geom_colours(model: mujoco.MjModel, geoms: NDArray[np.intp] | None = None) -> NDArray[np.float64]:
    """Returns a colour for each geom: the mean of its texture, or its own or its material's colour.

    Args:
        model: The model.
        geoms: Ids of the geoms; None: all, and an extra last row for rays without a hit (geom id -1).
    """
    chosen = slice(None) if geoms is None else geoms
    colours, materials = model.geom_rgba[chosen, :3].astype(float), model.geom_matid[chosen]
    for material in np.unique(materials[materials >= 0]).tolist():
        texture = int(model.mat_texid[material, mujoco.mjtTextureRole.mjTEXROLE_RGB])
        mean = _mean_colour(model, texture) if texture >= 0 else 1.0
        colours[materials == material] = model.mat_rgba[material, :3] * mean
    return np.clip(np.vstack([colours, _SKY]) if geoms is None else colours, 0.0, 1.0)


def _mean_colour(model: mujoco.MjModel, texture: int) -> NDArray[np.float64]:
    channels = int(model.tex_nchannel[texture])
    start = int(model.tex_adr[texture])
    height, width = int(model.tex_height[texture]), int(model.tex_width[texture])
    pixels = model.tex_data[start : start + height * width * channels].reshape(height, -1)
    # Row by row, which is ten times faster than pixel by pixel.
    sums = pixels.sum(axis=0, dtype=np.uint32).reshape(width, channels).sum(axis=0)
    return sums[:3] / (height * width) / 255.0
