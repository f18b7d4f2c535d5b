"""Picture with every kind of furniture in all its styles, ray-traced."""

# MuJoCo ships no types for its compiled module.
# pyright: reportAttributeAccessIssue=false

import io
from math import atan2, hypot, radians, tan
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from ....schemas.worlds.world import MODEL_TYPES, Furniture
from ..furniture.catalogue import LOOSE_TYPES, styles_of
from ..geometry.parts import Style
from ..model.mjcf import piece_geoms
from ..pictures.ray_casting import Camera, Hits
from ..pictures.ray_light import Lamp, Lighting
from ..pictures.ray_picture import RayPicture

CELL_WIDTH, CELL_HEIGHT = 150, 140
"""Width and height of one piece's picture, in pixels."""

_PER_ROW = 10
_LABEL = 18
_FOV_DEG = 26.0
_PAPER = (246, 244, 239)
_FLOOR = (0.9, 0.88, 0.85)


def catalogue_sheet(kinds: tuple[str, ...] = (*MODEL_TYPES, *LOOSE_TYPES)) -> bytes:
    """Renders a picture of all styles of some furniture types.

    Args:
        kinds: The kinds, in order.

    Returns:
        A PNG.
    """
    rows: list[Image.Image] = []
    for kind in kinds:
        known = styles_of(kind)
        rows += [_row(kind, known[first : first + _PER_ROW], first) for first in range(0, len(known), _PER_ROW)]
    sheet = Image.new("RGB", (_PER_ROW * CELL_WIDTH, len(rows) * (CELL_HEIGHT + _LABEL)), _PAPER)
    for index, row in enumerate(rows):
        sheet.paste(row, (0, index * (CELL_HEIGHT + _LABEL)))
    buffer = io.BytesIO()
    sheet.save(buffer, format="PNG", optimize=True)
    return buffer.getvalue()


def style_picture(kind: str, style: Style) -> NDArray[np.uint8]:
    """Renders one piece of furniture on a plain floor.

    Returns:
        Red, green, blue, shape (`CELL_HEIGHT`, `CELL_WIDTH`, 3).
    """
    item = Furniture(
        id="piece",
        model_type=kind,
        style=style.name,
        room="",
        x=0.0,
        y=0.0,
        yaw=0.0,
        width_m=style.width_m,
        depth_m=style.depth_m,
        height_m=style.height_m,
    )
    geoms = "\n".join([*piece_geoms(item), '<geom name="floor" type="plane" size="20 20 1"/>'])
    model = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{geoms}</worldbody></mujoco>")
    top = max(style.height_m, 0.05) + (0.15 if style.height_m > 0.3 else 0.0)
    reach = hypot(style.width_m, style.depth_m, top) / 2
    distance = 1.12 * reach / tan(radians(_FOV_DEG) / 2) * max(1.0, CELL_WIDTH / CELL_HEIGHT * 0.9)
    flat, rise = 0.84 * distance, 0.54 * distance
    camera = Camera((0.82 * flat, 0.57 * flat, rise + top / 2), atan2(-0.57, -0.82), -atan2(rise, flat), _FOV_DEG)
    rng = np.random.default_rng(3)
    key = [Lamp((2.2 + a, -0.6 + b, 3.2), 5.5, (1.0, 0.97, 0.92)) for a, b in rng.uniform(-0.45, 0.45, (16, 2))]
    fill = [Lamp((a, b, c), 1.9, (0.93, 0.97, 1.0)) for a, b, c in rng.uniform((-1, 1, 0.8), (3, 3, 3), (16, 3))]
    lighting = Lighting([key, fill], ambient=(0.3, 0.3, 0.3))
    return RayPicture(model, _Look(model).colors).draw(camera, lighting, CELL_WIDTH, CELL_HEIGHT)


class _Look:
    """Colours of a single furnishing on a plain floor."""

    def __init__(self, model: mujoco.MjModel) -> None:
        self._colors = model.geom_rgba[:, :3].astype(float)
        self._colors[model.geom("floor").id] = _FLOOR

    def colors(self, hits: Hits) -> NDArray[np.floating[Any]]:
        """Returns the unlit surface colour at each ray hit: red, green and blue from 0 to 1."""
        return self._colors[np.maximum(hits.geoms, 0)]


def _row(kind: str, known: tuple[Style, ...], first: int) -> Image.Image:
    row = Image.new("RGB", (_PER_ROW * CELL_WIDTH, CELL_HEIGHT + _LABEL), _PAPER)
    pen, font = ImageDraw.Draw(row), ImageFont.load_default(11)
    for index, style in enumerate(known):
        left = index * CELL_WIDTH
        row.paste(Image.fromarray(style_picture(kind, style)), (left, _LABEL))
        text = f"{kind}: {style.name}" if index == 0 and first == 0 else style.name
        pen.text((left + 4, 2), text if len(text) < 27 else text[:26] + "…", (60, 60, 60), font)
    return row
