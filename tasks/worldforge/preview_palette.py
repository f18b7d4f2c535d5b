"""Colours of the preview by number: what the rasteriser writes into a picture's pixels."""

import numpy as np
from numpy.typing import NDArray

from .parts import Color, rgb
from .preview_raster import LEVELS, LIGHT
from .textures import mean_color

GROUND = rgb("eeece6")[:3]
"""Colour number 0: what lies around the building."""


class Palette:
    """Colour numbers, each with its red, green, blue as it looks in full light.

    Attributes:
      floors: numbers of the floors of each material, to be filled with its pattern.
    """

    def __init__(self) -> None:
        self._colors: list[tuple[float, float, float]] = [GROUND]
        self._in_shade: list[int] = []
        self.floors: dict[str, list[int]] = {}

    def add(self, color: Color, shade: float = 1.0) -> int:
        """A colour, darkened or not; returns its number."""
        red, green, blue, _ = color
        self._colors.append((red * shade, green * shade, blue * shade))
        return len(self._colors) - 1

    def add_side(self, color: Color, normal: tuple[float, float]) -> int:
        """An upright face; one that is turned from the light takes no shadow besides."""
        facing = normal[0] * LIGHT[0] + normal[1] * LIGHT[1]
        number = self.add(color, 0.8 + 0.16 * facing)
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
        self.floors.setdefault(name, []).append(number)
        return number

    def sunny(self) -> NDArray[np.float32]:
        """1 for colours that shadows fall on, 0 for those turned from the light."""
        sunny = np.ones(len(self._colors), np.float32)
        sunny[self._in_shade] = 0
        return sunny

    def table(self) -> NDArray[np.uint8]:
        """Red, green and blue by colour number, 0 to 255."""
        return np.rint(np.clip(np.array(self._colors), 0, 1) * 255).astype(np.uint8)
