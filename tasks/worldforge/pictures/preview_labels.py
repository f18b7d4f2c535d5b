"""Names and areas of rooms in the picture from above, each where it covers little but floor."""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont
from scipy import ndimage

from ....schemas.worlds.world import Room

_NAME_PX, _AREA_PX, _RAISED_PX = 15, 12, 9
_PADDING_PX, _ROUND_PX, _SMOOTH = 7, 6, 4
"""Space around a label's letters and radius of its corners, in pixels, and how many times finer they are drawn."""
_PAPER_SHARE = 0.86
_INK, _FAINT = (44, 46, 50), (98, 100, 106)
_FAR_COST = 0.0006
"""Share of a label on the floor that a pixel's distance from the room's middle is worth."""
_LEAST_PX = 60
"""Least number of pixels of a room that has a label."""

Pixels = NDArray[np.uint8]


def with_labels(pixels: Pixels, floors: NDArray[np.int32], rooms: dict[int, Room]) -> Pixels:
    """Returns a picture with a label on the floor of each room.

    Args:
        pixels: The picture, shape (height, width, 3).
        floors: Number of the floor that each pixel shows, of the same shape but the last axis.
        rooms: The rooms by these numbers.
    """
    picture = Image.fromarray(pixels)
    for number, found in enumerate(ndimage.find_objects(floors, max(rooms, default=0)), 1):
        if number in rooms and found is not None:
            mask = floors[found] == number
            if mask.sum() > _LEAST_PX:
                _draw(picture, rooms[number], mask, (found[1].start, found[0].start))
    return np.asarray(picture)


def _draw(picture: Image.Image, room: Room, floor: NDArray[np.bool_], corner: tuple[int, int]) -> None:
    name, area = readable(room), f"{room.floor_m2:.0f} m"
    large, small, raised = _font(_NAME_PX), _font(_AREA_PX), _font(_RAISED_PX)
    area_px = small.getlength(area) + raised.getlength("2")
    width = round(max(large.getlength(name), area_px)) + 2 * _PADDING_PX
    height = _NAME_PX + _AREA_PX + 2 * _PADDING_PX
    x, y = _clearest(floor, width, height)
    x, y = x + corner[0], y + corner[1]
    size = (width * _SMOOTH, height * _SMOOTH)
    shape = Image.new("L", size)
    ImageDraw.Draw(shape).rounded_rectangle(
        (0, 0, size[0] - 1, size[1] - 1), _ROUND_PX * _SMOOTH, fill=round(255 * _PAPER_SHARE)
    )
    picture.paste((255, 255, 255), (x - width // 2, y - height // 2), shape.reduce(_SMOOTH))
    draw = ImageDraw.Draw(picture)
    top = y - height // 2 + _PADDING_PX
    draw.text((x, top - 2), name, _INK, large, anchor="ma")
    left = x - area_px / 2
    draw.text((left, top + _NAME_PX + 2), area, _FAINT, small)
    draw.text((left + small.getlength(area) + 1, top + _NAME_PX), "2", _FAINT, raised)


def _clearest(floor: NDArray[np.bool_], width: int, height: int) -> tuple[int, int]:
    """Returns the middle (column, row) of a label that covers most of a floor's pixels, near the middle of these.

    `floor` marks the pixels; width and height of the label are in pixels, too.
    """
    covered = ndimage.uniform_filter1d(floor.astype(np.float32), height, axis=0, mode="constant")
    covered = ndimage.uniform_filter1d(covered, width, axis=1, mode="constant")
    rows, columns = np.mgrid[: floor.shape[0], : floor.shape[1]].astype(np.float32)
    away = np.hypot(rows - rows[floor].mean(), columns - columns[floor].mean())
    row, column = np.unravel_index(int(np.argmax(np.round(covered - _FAR_COST * away, 4))), floor.shape)
    return int(column), int(row)


def readable(room: Room) -> str:
    """Returns a room's name in the letters that the font has, which are those of English."""
    return room.called if room.called.isascii() else room.name


@lru_cache(maxsize=3)
def _font(size_px: int) -> ImageFont.FreeTypeFont:
    # Pillow's own font: the same letters on every machine.
    font = ImageFont.load_default(size_px)
    if not isinstance(font, ImageFont.FreeTypeFont):
        raise TypeError("Pillow was built without FreeType; install one of its wheels")
    return font
