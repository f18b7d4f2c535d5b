"""Pictures of a world in another light: the model, and so what moves, stays as it is."""

# MuJoCo ships no types for its compiled module.
# pyright: reportAttributeAccessIssue=false, reportInvalidTypeForm=false

from collections.abc import Iterator
from contextlib import contextmanager

import mujoco
import numpy as np

from ....schemas.worlds.appearance import Appearance, Rgb, sky_look

_SUN, _LAMP, _SKY = "sun", "lamp_", "sky"


class Relighting:
    """Lights scenes of one model as an appearance says; what the world has not, such as lamps, is left out."""

    def __init__(self, model: mujoco.MjModel, appearance: Appearance) -> None:
        """Finds what shines."""
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
        """Lights a scene that was just made."""
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
        """Gives a model the sky of the appearance, for as long as a renderer is made; it has its own afterwards."""
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
    """The sky that MuJoCo makes of a look."""
    texture = f'<texture type="skybox" {look} width="{wide}" height="{tall}"/>'
    return mujoco.MjModel.from_xml_string(f"<mujoco><asset>{texture}</asset></mujoco>").tex_data
