"""Colours of the preview by number: what the rasteriser writes into a picture's pixels."""

import numpy as np
from numpy.typing import NDArray

from ..geometry.parts import Axis, Color, rgb
from ..materials.textures import mean_color, texture_size_m
from .preview_raster import LEVELS, LIGHT

GROUND = rgb("eeece6")[:3]
"""Colour number 0: what lies around the building."""


class Palette:
    """Colour numbers, each with its red, green, blue as it looks in full light.

    Attributes:
        patterned: surfaces that are to be filled with their patterns, and the share of light on them: `z`
            floors, `x` and `y` walls by the direction in which they run.
    """

    def __init__(self) -> None:
        self._colors: list[tuple[float, float, float]] = [GROUND]
        self._in_shade: list[int] = []
        self.patterned: list[tuple[str, Axis, float]] = []
        self._patterns: dict[int, int] = {}

    def add(self, color: Color, shade: float = 1.0) -> int:
        """A colour, darkened or not; returns its number."""
        red, green, blue, _ = color
        self._colors.append((red * shade, green * shade, blue * shade))
        return len(self._colors) - 1

    def add_side(self, color: Color, normal: tuple[float, float]) -> int:
        """An upright face; one that is turned from the light takes no shadow besides."""
        facing = normal[0] * LIGHT[0] + normal[1] * LIGHT[1]
        number = self.add(color, _side_share(normal))
        if facing <= 0:
            self._in_shade.append(number)
        return number

    def add_curved(self, color: Color) -> int:
        """A curved surface: one number per shade, of which the darkest, the first, is returned."""
        first = len(self._colors)
        for level in range(LEVELS):
            self.add(color, 0.62 + 0.42 * (level + 0.5) / LEVELS)
        return first

    def add_floor(self, name: str) -> int:
        """A floor by its name in the MJCF."""
        number = self.add((*mean_color(name), 1.0))
        self._fill(number, name, "z", 1.0)
        return number

    def add_wall(self, name: str, normal: tuple[float, float]) -> int:
        """An upright face of a wall by its name in the MJCF."""
        number = self.add_side((*mean_color(name), 1.0), normal)
        if texture_size_m(name) is not None:
            self._fill(number, name, "x" if normal[0] == 0 else "y", _side_share(normal))
        return number

    def _fill(self, number: int, name: str, axis: Axis, share: float) -> None:
        pattern = (name, axis, share)
        if pattern not in self.patterned:
            self.patterned.append(pattern)
        self._patterns[number] = self.patterned.index(pattern) + 1

    def patterns(self) -> NDArray[np.uint8]:
        """Patterns by colour number: 0 for none, else one more than the index in `patterned`."""
        table = np.zeros(len(self._colors), np.uint8)
        table[list(self._patterns)] = list(self._patterns.values())
        return table

    def sunny(self) -> NDArray[np.float32]:
        """1 for colours that shadows fall on, 0 for those turned from the light."""
        sunny = np.ones(len(self._colors), np.float32)
        sunny[self._in_shade] = 0
        return sunny

    def table(self) -> NDArray[np.uint8]:
        """Red, green and blue by colour number, 0 to 255."""
        return np.rint(np.clip(np.array(self._colors), 0, 1) * 255).astype(np.uint8)


def _side_share(normal: tuple[float, float]) -> float:
    """How bright an upright face is."""
    return 0.8 + 0.16 * (normal[0] * LIGHT[0] + normal[1] * LIGHT[1])
