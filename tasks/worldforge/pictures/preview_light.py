"""Light and shadow of the preview, from a map of how high things stand."""

from collections.abc import Iterable
from dataclasses import dataclass
from math import ceil, floor, sqrt

import numpy as np
from scipy import ndimage

from .preview_raster import LIGHT, Image

_CELL_M = 0.03
_MARGIN_M = 1.5

Block = tuple[float, float, float, float, float]
"""West, south, east, north, height."""


@dataclass(frozen=True)
class LightMap:
    """Per cell of the ground: how high the shade reaches, and how much stands around."""

    origin: tuple[float, float]
    shade: Image
    """Everything below this height lies in the sun's shadow, metres."""
    crowd: Image
    """Mean height of the surroundings, metres."""

    @classmethod
    def of(cls, blocks: Iterable[Block], extent: tuple[float, float, float, float]) -> "LightMap":
        """Casts shadows of blocks that stand on the ground."""
        x0, y0 = extent[0] - _MARGIN_M, extent[1] - _MARGIN_M
        shape = (ceil((extent[3] + _MARGIN_M - y0) / _CELL_M), ceil((extent[2] + _MARGIN_M - x0) / _CELL_M))
        heights = np.zeros(shape, np.float32)
        for west, south, east, north, height in blocks:
            rows = slice(max(0, floor((south - y0) / _CELL_M + 0.5)), max(0, floor((north - y0) / _CELL_M + 0.5)))
            columns = slice(max(0, floor((west - x0) / _CELL_M + 0.5)), max(0, floor((east - x0) / _CELL_M + 0.5)))
            np.maximum(heights[rows, columns], np.float32(height), out=heights[rows, columns])
        crowd = ndimage.uniform_filter(heights, 11, mode="nearest") + ndimage.uniform_filter(
            heights, 27, mode="nearest"
        )
        shade = ndimage.uniform_filter(_cast(heights), 5)
        return cls((x0, y0), np.asarray(shade, np.float32), np.asarray(crowd, np.float32) / 2)

    def brightness(self, x: Image, y: Image, z: Image, sunny: Image) -> Image:
        """How bright the light is at places of the scene, 0 to 1; shadows fall where `sunny` is 1."""
        rows = np.clip(((y - self.origin[1]) / _CELL_M).astype(np.int32), 0, self.shade.shape[0] - 1)
        columns = np.clip(((x - self.origin[0]) / _CELL_M).astype(np.int32), 0, self.shade.shape[1] - 1)
        cells = rows * self.shade.shape[1] + columns
        sunless = np.clip((np.take(self.shade, cells) - z - 0.02) * 3, 0, 1) * sunny
        hemmed_in = np.clip((np.take(self.crowd, cells) - z) * 0.38, 0, 0.3)
        return (1 - 0.27 * sunless) * (1 - hemmed_in)


def _cast(heights: Image) -> Image:
    """Height of the shadow over every cell: the highest block towards the light, less the light's slope."""
    reach = sqrt(LIGHT[0] ** 2 + LIGHT[1] ** 2)
    drop = LIGHT[2] / reach * _CELL_M
    shade = np.zeros_like(heights)
    for step in range(1, ceil(2.1 / drop)):
        right, up = round(step * LIGHT[0] / reach), round(step * LIGHT[1] / reach)
        moved = heights[max(up, 0) or None :, : right or None] if right < 0 else heights[max(up, 0) :, right:]
        target = shade[: shade.shape[0] - max(up, 0), max(-right, 0) :] if right < 0 else shade[: -up or None, :-right]
        np.maximum(target, moved - np.float32(step * drop), out=target)
    return shade
