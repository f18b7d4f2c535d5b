"""Pictures of a simulation, with OpenGL or without."""

# MuJoCo ships no types for its compiled module.
# pyright: reportAttributeAccessIssue=false, reportInvalidTypeForm=false

from typing import Protocol

import mujoco
import numpy as np
from numpy.typing import NDArray

Image = NDArray[np.uint8]
"""Height x width x 3, red, green, blue."""

_MAX_GEOMS = 20_000
_SKY = np.array([0.62, 0.74, 0.88])
_LIGHT = np.array([0.35, -0.25, 0.9]) / np.linalg.norm([0.35, -0.25, 0.9])
_GEOMS_SHOWN = np.array([1, 1, 1, 0, 0, 0], dtype=np.uint8)
"""MuJoCo's viewers show groups 0 to 2; 3 to 5 are collision shapes by custom."""


class Camera(Protocol):
    """Takes pictures of one model."""

    def picture(self, data: mujoco.MjData, view: mujoco.MjvCamera) -> Image:
        """Returns what `view` sees of the state in `data`."""
        ...

    def close(self) -> None:
        """Frees what the driver holds."""
        ...


class GlCamera:
    """Renders with MuJoCo's classic renderer, in the OpenGL that `MUJOCO_GL` names."""

    def __init__(self, model: mujoco.MjModel, width: int, height: int) -> None:
        """Makes a renderer.

        Args:
            model: The model; its visual settings are as before afterwards.
            width: Pixels.
            height: Pixels.

        Raises:
            Exception: OpenGL does not work here; the kind depends on the driver.
        """
        size, quality = model.vis.global_, model.vis.quality
        before = size.offwidth, size.offheight, quality.offsamples
        try:
            # Multisampling, shadows and reflections cost ten times the rest on a CPU.
            size.offwidth, size.offheight, quality.offsamples = max(width, before[0]), max(height, before[1]), 0
            self._renderer = mujoco.Renderer(model, height, width, max_geom=_MAX_GEOMS)
        finally:
            size.offwidth, size.offheight, quality.offsamples = before
        for flag in (mujoco.mjtRndFlag.mjRND_SHADOW, mujoco.mjtRndFlag.mjRND_REFLECTION):
            self._renderer.scene.flags[flag] = False

    def picture(self, data: mujoco.MjData, view: mujoco.MjvCamera) -> Image:
        """See `Camera`."""
        self._renderer.update_scene(data, view)
        return self._renderer.render()

    def close(self) -> None:
        """See `Camera`."""
        self._renderer.close()


class RayCamera:
    """Casts a ray per pixel: flat colours, one light, no textures; needs no driver at all."""

    def __init__(self, model: mujoco.MjModel, width: int, height: int) -> None:
        """Prepares rays and colours.

        Args:
            model: The model.
            width: Pixels.
            height: Pixels.
        """
        self._model = model
        self._shape = height, width
        count = width * height
        self._geoms = np.zeros(count, dtype=np.int32)
        self._distances = np.zeros(count)
        self._normals = np.zeros(3 * count)
        self._colours = _geom_colours(model)
        # A camera without a model of its own, only to learn where a view stands and looks.
        self._scene = mujoco.MjvScene(model, maxgeom=_MAX_GEOMS)
        self._option = mujoco.MjvOption()

    def picture(self, data: mujoco.MjData, view: mujoco.MjvCamera) -> Image:
        """See `Camera`."""
        mujoco.mjv_updateScene(
            self._model, data, self._option, None, view, mujoco.mjtCatBit.mjCAT_ALL.value, self._scene
        )
        eye, rays = self._rays()
        geoms, distances, normals = self._geoms, self._distances, self._normals
        housing, reach = self._body_around(data, eye), self._model.vis.map.zfar * self._model.stat.extent
        mujoco.mj_multiRay(
            self._model, data, eye, rays.ravel(), _GEOMS_SHOWN, True, housing, geoms, distances, normals,
            len(geoms), reach,
        )  # fmt: skip
        shade = 0.45 + 0.55 * np.abs(normals.reshape(-1, 3) @ _LIGHT)
        picture = self._colours[geoms] * shade[:, None]
        picture[geoms < 0] = _SKY
        return (np.clip(picture, 0.0, 1.0) * 255).astype(np.uint8).reshape(*self._shape, 3)

    def close(self) -> None:
        """See `Camera`."""

    def _body_around(self, data: mujoco.MjData, eye: NDArray[np.float64]) -> int:
        """The body whose geom the eye is in, as cameras are in their housings, or -1.

        OpenGL does not draw surfaces from behind; a ray would hit the housing from inside.
        """
        forward = np.asarray(self._scene.camera[0].forward, dtype=float)
        geom, normal = np.zeros(1, dtype=np.int32), np.zeros(3)
        mujoco.mj_ray(self._model, data, eye, forward, _GEOMS_SHOWN, True, -1, geom, normal)
        inside = geom[0] >= 0 and normal @ forward > 0
        body = int(self._model.geom_bodyid[geom[0]]) if inside else 0
        return body or -1

    def _rays(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The eye's position, and unit vectors through the pixels, row by row from the top."""
        left, right = self._scene.camera[0], self._scene.camera[1]
        eye = (np.asarray(left.pos, dtype=float) + right.pos) / 2
        forward, up = np.asarray(left.forward, dtype=float), np.asarray(left.up, dtype=float)
        height, width = self._shape
        top = left.frustum_top / left.frustum_near
        y = np.linspace(top, -top, height, endpoint=False) - top / height
        x = (np.arange(width) + 0.5 - width / 2) * (2 * top / height)
        rays = forward + y[:, None, None] * up + x[None, :, None] * np.cross(forward, up)
        return eye, rays.reshape(-1, 3) / np.linalg.norm(rays.reshape(-1, 3), axis=1, keepdims=True)


def _geom_colours(model: mujoco.MjModel) -> NDArray[np.float64]:
    """A colour per geom: the mean of its texture where it has one, otherwise its own or its material's.

    The extra last row is what geom id -1, no geom, finds.
    """
    colours = model.geom_rgba[:, :3].astype(float)
    for geom, material in enumerate(model.geom_matid):
        if material < 0:
            continue
        texture = int(model.mat_texid[material, mujoco.mjtTextureRole.mjTEXROLE_RGB])
        colours[geom] = model.mat_rgba[material, :3] * (_mean_colour(model, texture) if texture >= 0 else 1.0)
    return np.vstack([colours, _SKY])


def _mean_colour(model: mujoco.MjModel, texture: int) -> NDArray[np.float64]:
    channels = int(model.tex_nchannel[texture])
    start = int(model.tex_adr[texture])
    size = int(model.tex_height[texture]) * int(model.tex_width[texture]) * channels
    pixels = model.tex_data[start : start + size].reshape(-1, channels)
    return pixels[:, :3].mean(axis=0) / 255.0
