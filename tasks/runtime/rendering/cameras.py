"""Renderers with OpenGL: context, light, images."""

# MuJoCo ships no types for its compiled module.
# pyright: reportAttributeAccessIssue=false, reportInvalidTypeForm=false

import importlib
import os
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from typing import Any, Protocol

import mujoco
import numpy as np
from numpy.typing import NDArray

from ....schemas.worlds.appearance import Appearance, Rgb, sky_look
from .views import View, roofs, without_unseen

_SUN, _LAMP, _SKY = "sun", "lamp_", "sky"


class Relighting:
    """Lights of a model in a chosen appearance (day, night, ...), which are set in each scene that is rendered."""

    def __init__(self, model: mujoco.MjModel, appearance: Appearance) -> None:
        """Finds the model's lights and shiny materials that the appearance changes; the model itself stays as it is."""
        self._appearance = appearance
        self._colors: dict[int, Rgb] = {}
        for light in range(model.nlight):
            name = model.light(light).name
            if name == _SUN or name.startswith(_LAMP):
                self._colors[light] = appearance.sun if name == _SUN else appearance.lamps
        shining = {"ceiling": appearance.ceiling, "lamp_shade": appearance.shades}
        self._emissions = {
            material: shining[model.mat(material).name]
            for material in range(model.nmat)
            if model.mat(material).name in shining
        }

    def light(self, scene: mujoco.MjvScene) -> None:
        """Sets the lights and shiny materials of a scene that is to be rendered to the chosen appearance, in place."""
        for light in scene.lights[: scene.nlight]:
            if light.headlight:
                light.ambient[:], light.diffuse[:] = self._appearance.ambient, self._appearance.headlight
            elif light.id in self._colors:
                light.diffuse[:] = self._colors[light.id]
                light.castshadow = light.castshadow and self._appearance.shadows
        for geom in scene.geoms[: scene.ngeom] if self._emissions else ():
            if geom.matid in self._emissions:
                geom.emission = self._emissions[geom.matid]

    @contextmanager
    def sky(self, model: mujoco.MjModel) -> Iterator[None]:
        """Replaces the pixels of a model's sky inside the `with` block, in which a renderer is to be created.

        Does nothing if the appearance has no sky of its own, or the model has no sky.
        """
        found = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_TEXTURE.value, _SKY)
        if self._appearance.sky is None or found < 0:
            yield
            return
        wide, tall, channels = (int(size[found]) for size in (model.tex_width, model.tex_height, model.tex_nchannel))
        first = int(model.tex_adr[found])
        pixels = model.tex_data[first : first + wide * tall * channels].reshape(tall, wide, channels)
        before = pixels.copy()
        pixels[..., :3] = _gradient(sky_look(self._appearance.sky), wide, tall).reshape(tall, wide, -1)[..., :3]
        try:
            yield
        finally:
            pixels[:] = before


def _gradient(look: str, wide: int, tall: int) -> np.ndarray:
    """Lets MuJoCo generate a sky texture, and returns its pixels as a flat array of bytes."""
    texture = f'<texture type="skybox" {look} width="{wide}" height="{tall}"/>'
    return mujoco.MjModel.from_xml_string(f"<mujoco><asset>{texture}</asset></mujoco>").tex_data


DISABLED = "disable"


def follow_environment() -> None:
    """Makes MuJoCo and dm_control use the OpenGL backend that `MUJOCO_GL` names now; does nothing if it names none.

    Raises:
        Exception: The requested OpenGL backend is missing; the type depends on what is missing.
    """
    if os.environ.get("MUJOCO_GL", DISABLED) == DISABLED:
        return
    for name in ("mujoco.rendering.classic.gl_context", "dm_control._render"):
        importlib.reload(importlib.import_module(name))


def make_context(width: int, height: int, backend: str | None = None) -> Any:
    """Creates an OpenGL context with the backend that `MUJOCO_GL` names, whatever MuJoCo and dm_control chose.

    Args:
        width: Maximum width in pixels.
        height: Maximum height in pixels.
        backend: Name of the backend (`egl`, `osmesa` or `glfw`) if `MUJOCO_GL` is not set.

    Returns:
        An object of MuJoCo's with `make_current()` and `free()`.

    Raises:
        Exception: OpenGL does not work here; the kind depends on the driver.
    """
    chosen = os.environ.get("MUJOCO_GL", DISABLED).lower()
    name = chosen if chosen in ("egl", "osmesa", "glfw") else backend or "egl"
    return importlib.import_module(f"mujoco.{name}").GLContext(width, height)


Image = NDArray[np.uint8]
"""Image: height x width x 3, red, green, blue."""

Depths = NDArray[np.float32]
"""Depth image, height x width: distances in metres from the camera's plane, infinite where nothing is hit."""

MAX_GEOMS = 20_000
_SMALL_HEIGHT = 300
_SMALL_SLICES = 20
_LARGE_M = 0.5
_SHINES = 0.2
"""Specular reflectance of a material from which highlights are visible."""
_NO_MATERIAL_SPECULAR = 0.5
_THROUGH_ROOFS = 0.35
"""Factor on light under roofs for lights with shadows, since this renderer draws no shadows."""


class Camera(Protocol):
    """Interface of a renderer that takes pictures of a simulation model."""

    def picture(self, data: mujoco.MjData, view: View, size: tuple[int, int] | None = None) -> Image:
        """Renders a simulation state from a camera view, and returns the RGB image.

        Args:
            data: The state.
            view: Camera view.
            size: Width and height in pixels, at most those of the renderer, which are the default.
        """
        ...

    def depths(self, data: mujoco.MjData, view: View) -> Depths:
        """Renders a depth image: the distance in metres of the surface at each pixel.

        Args:
            data: The state.
            view: Camera view.
        """
        ...

    def close(self) -> None:
        """Frees the renderer's memory; no picture can be drawn afterwards."""
        ...


class GlCamera:
    """Renderer with MuJoCo's classic OpenGL renderer; must be used and closed by the thread that created it."""

    def __init__(
        self,
        model: mujoco.MjModel,
        width: int,
        height: int,
        backend: str | None = None,
        appearance: Appearance | None = None,
    ) -> None:
        """Creates an OpenGL renderer of a model, with a context of its own.

        Args:
            model: Compiled model; its visual settings are restored afterwards.
            width: Pixels.
            height: Pixels.
            backend: Name of the backend (`egl` or `osmesa`) if `MUJOCO_GL` is not set.
            appearance: Light of the world; None: that of the model.

        Raises:
            Exception: OpenGL does not work here; the kind depends on the driver.
        """
        self._model = model
        self._size = width, height
        self._has_roofs = len(roofs(model)) > 0
        self._scene = mujoco.MjvScene(model, maxgeom=MAX_GEOMS)
        self._option = mujoco.MjvOption()
        self._option.flags[mujoco.mjtVisFlag.mjVIS_RANGEFINDER] = False  # yellow lines through the picture
        # Multisampling, shadows and reflections cost ten times the rest on a CPU.
        for flag in (mujoco.mjtRndFlag.mjRND_SHADOW, mujoco.mjtRndFlag.mjRND_REFLECTION):
            self._scene.flags[flag] = False
        self._context = make_context(width, height, backend)
        self._context.make_current()
        self._relighting = Relighting(model, appearance) if appearance else None
        sky = self._relighting.sky(model) if self._relighting else nullcontext()
        with sky, _fast_settings(model, width, height):
            self._renderer = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100.value)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, self._renderer)
        # Depths are 1 at the nearest that is drawn, and 0 at the farthest: floating point is finest there.
        self._renderer.readDepthMap = mujoco.mjtDepthMap.mjDEPTH_ZEROFAR.value

    def picture(self, data: mujoco.MjData, view: View, size: tuple[int, int] | None = None) -> Image:
        """Renders a simulation state from a camera view as an RGB image; see `Camera`.

        Args:
            data: The state.
            view: Camera view.
            size: Width and height in pixels; absent: those of the camera.

        Returns:
            Colours from 0 to 255, shape (height, width, 3), the top row first.
        """
        width, height = size or self._size
        self._see(data, view, width / height)
        if self._relighting is not None:
            self._relighting.light(self._scene)
        self._dim_under_roofs()
        self._context.make_current()
        window = mujoco.MjrRect(0, 0, width, height)
        mujoco.mjr_render(window, self._scene, self._renderer)
        pixels = np.empty((height, width, 3), dtype=np.uint8)
        mujoco.mjr_readPixels(pixels, None, window, self._renderer)
        return np.ascontiguousarray(pixels[::-1])  # OpenGL begins at the bottom

    def depths(self, data: mujoco.MjData, view: View) -> Depths:
        """Renders the depths in a camera view in metres, shape (height, width), inf where nothing is; see `Camera`."""
        width, height = self._size
        self._see(data, view, width / height)
        before = self._scene.flags.copy()
        # Without light, textures and sky, which need no depth.
        self._scene.flags[mujoco.mjtRndFlag.mjRND_SEGMENT] = self._scene.flags[mujoco.mjtRndFlag.mjRND_IDCOLOR] = True
        self._context.make_current()
        window = mujoco.MjrRect(0, 0, width, height)
        mujoco.mjr_render(window, self._scene, self._renderer)
        self._scene.flags[:] = before
        read = np.empty((height, width), dtype=np.float32)
        mujoco.mjr_readPixels(None, read, window, self._renderer)
        near_m, far_m = self._scene.camera[0].frustum_near, self._scene.camera[0].frustum_far
        there = read[::-1].astype(np.float64)  # OpenGL begins at the bottom
        if self._scene.camera[0].orthographic:
            found_m = far_m - there * (far_m - near_m)
        else:
            found_m = near_m * far_m / (there * (far_m - near_m) + near_m)
        return np.where(there > 0.0, found_m, np.inf).astype(np.float32)

    def _see(self, data: mujoco.MjData, view: View, aspect: float) -> None:
        """Fills the scene with the geoms that are visible in a camera view, in place of those before."""
        model, scene, camera = self._model, self._scene, view(data)
        mujoco.mjv_updateCamera(model, data, camera, scene)
        with without_unseen(model, data, scene, aspect):
            mujoco.mjv_updateScene(model, data, self._option, None, camera, mujoco.mjtCatBit.mjCAT_ALL.value, scene)

    def _dim_under_roofs(self) -> None:
        """Dims the sun of the scene if the model has roofs, as it would shine through them without shadows."""
        for light in self._scene.lights[: self._scene.nlight] if self._has_roofs else ():
            if light.castshadow and not light.headlight:
                light.diffuse[:] = light.diffuse * _THROUGH_ROOFS

    def close(self) -> None:
        """Frees the renderer's memory and OpenGL context; see `Camera`."""
        self._context.make_current()
        self._renderer.free()
        self._context.free()


@contextmanager
def _fast_settings(model: mujoco.MjModel, width: int, height: int) -> Iterator[None]:
    """Sets a model's visual settings for fast rendering on a CPU inside the `with` block.

    Multisampling is off. Faces of boxes are not divided where that looks the same; MuJoCo divides them because light is
    computed at vertices only. In small images, round shapes have fewer vertices. Together this halves the time of a 320
    x 240 image.
    """
    size, quality = model.vis.global_, model.vis.quality
    before = size.offwidth, size.offheight
    rounds = quality.offsamples, quality.numslices, quality.numstacks, quality.numquads
    try:
        size.offwidth, size.offheight, quality.offsamples = width, height, 0
        if _is_evenly_lit(model):
            quality.numquads = 1
        if height <= _SMALL_HEIGHT:
            quality.numslices = min(quality.numslices, _SMALL_SLICES)
            quality.numstacks = min(quality.numstacks, _SMALL_SLICES // 2)
        yield
    finally:
        size.offwidth, size.offheight = before
        quality.offsamples, quality.numslices, quality.numstacks, quality.numquads = rounds


def _is_evenly_lit(model: mujoco.MjModel) -> bool:
    """Returns whether each face has one brightness: light comes from afar, and no large face is shiny."""
    if (model.light_type != mujoco.mjtLightType.mjLIGHT_DIRECTIONAL.value).any():
        return False
    large = (model.geom_type == mujoco.mjtGeom.mjGEOM_BOX.value) & (model.geom_size.max(axis=1) > _LARGE_M)
    materials = model.geom_matid[large]
    specular = np.append(model.mat_specular, _NO_MATERIAL_SPECULAR)[materials]  # -1: no material
    return bool((specular < _SHINES).all())
