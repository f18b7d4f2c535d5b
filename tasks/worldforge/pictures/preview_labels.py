"""Names and areas of rooms in the picture from above, each where it covers little but floor."""

from functools import lru_cache
from math import ceil
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont
from scipy import ndimage

from ....schemas.worlds.world import Room

_PADDING_PX, _ROUND_PX, _SMOOTH = 6, 6, 4
"""Space around a label's letters and radius of its corners, in pixels, and how many times finer they are drawn."""
_PAPER_SHARE = 0.86
_INK, _FAINT = (44, 46, 50), (98, 100, 106)
_FAR_COST = 0.0006
"""Share of a label on the floor that a pixel's distance from the room's middle is worth."""
_CLEAR = 0.985
"""Share of a label on the floor that is enough: it covers no furniture that one would miss."""
_EVERY_PX = 2
"""Distance between the pixels of a floor that are asked: labels are placed no more exactly."""
_LEAST_PX = 60
"""Least number of pixels of a room that has a label."""

Pixels = NDArray[np.uint8]


class _Form(NamedTuple):
    """A way to write a label."""

    name_px: int
    area_px: int
    raised_px: int
    lines: int


_FORMS = (_Form(15, 12, 9, 2), _Form(13, 11, 8, 2), _Form(13, 11, 8, 1), _Form(11, 10, 8, 2), _Form(11, 10, 8, 1))
"""Forms of labels, better ones first: rooms full of furniture have small ones."""


def with_labels(pixels: Pixels, floors: NDArray[np.int32], rooms: dict[int, Room]) -> Pixels:
    """Returns a picture with a label on the floor of each room, where it covers no furniture.

    Args:
        pixels: The picture, shape (height, width, 3).
        floors: Number of the floor or rug that each pixel shows, of the same shape but the last axis.
        rooms: The rooms by these numbers.
    """
    picture = Image.fromarray(pixels)
    named = {room.name: room for room in rooms.values()}
    order = list(named)
    table = np.zeros(max(int(floors.max()), *rooms) + 1, np.int32)
    for number, room in rooms.items():
        table[number] = order.index(room.name) + 1
    free = np.take(table, floors)
    for number, found in enumerate(ndimage.find_objects(free), 1):
        if found is not None:
            mask = free[found] == number
            if mask.sum() > _LEAST_PX:
                _draw(picture, named[order[number - 1]], mask, (found[1].start, found[0].start))
    return np.asarray(picture)


def _draw(picture: Image.Image, room: Room, floor: NDArray[np.bool_], corner: tuple[int, int]) -> None:
    name, area = readable(room), f"{room.floor_m2:.0f} m"
    form, (x, y) = _place(name, area, floor)
    x, y = x + corner[0], y + corner[1]
    width, height = _extent(name, area, form)
    size = (width * _SMOOTH, height * _SMOOTH)
    shape = Image.new("L", size)
    ImageDraw.Draw(shape).rounded_rectangle(
        (0, 0, size[0] - 1, size[1] - 1), _ROUND_PX * _SMOOTH, fill=round(255 * _PAPER_SHARE)
    )
    left, top = x - width // 2, y - height // 2
    picture.paste((255, 255, 255), (left, top), shape.reduce(_SMOOTH))
    draw = ImageDraw.Draw(picture)
    large, small, raised = _font(form.name_px), _font(form.area_px), _font(form.raised_px)
    name_width, area_width = large.getlength(name), small.getlength(area)
    if form.lines == 1:
        start, base = left + _PADDING_PX, top + height - _PADDING_PX
        draw.text((start, base), name, _INK, large, anchor="ls")
        start += name_width + form.area_px / 2
    else:
        base = top + height - _PADDING_PX
        draw.text((x, top + _PADDING_PX + form.name_px - 3), name, _INK, large, anchor="ms")
        start = x - (area_width + raised.getlength("2")) / 2
    draw.text((start, base), area, _FAINT, small, anchor="ls")
    draw.text((start + area_width + 1, base - form.area_px // 3), "2", _FAINT, raised, anchor="ls")


def _extent(name: str, area: str, form: _Form) -> tuple[int, int]:
    """Width and height of a label in pixels."""
    large, small, raised = _font(form.name_px), _font(form.area_px), _font(form.raised_px)
    area_width = small.getlength(area) + raised.getlength("2") + 1
    if form.lines == 1:
        wide = large.getlength(name) + form.area_px / 2 + area_width
        return ceil(wide) + 2 * _PADDING_PX, form.name_px - 3 + 2 * _PADDING_PX
    wide = max(large.getlength(name), area_width)
    return ceil(wide) + 2 * _PADDING_PX, form.name_px + form.area_px - 1 + 2 * _PADDING_PX


def _place(name: str, area: str, floor: NDArray[np.bool_]) -> tuple[_Form, tuple[int, int]]:
    """Form and middle of the best label that covers floor alone; else of the one that covers most of it."""
    rows, columns = np.ogrid[: floor.shape[0] : _EVERY_PX, : floor.shape[1] : _EVERY_PX]
    few = floor[::_EVERY_PX, ::_EVERY_PX]
    row, column = (float(axis.mean()) * _EVERY_PX for axis in np.nonzero(few))
    cost = _FAR_COST * np.sqrt((rows - row) ** 2 + (columns - column) ** 2)
    best, best_share = (_FORMS[0], (0, 0)), -1.0
    for form in _FORMS:
        width, height = _extent(name, area, form)
        covered = _covered(few, ceil(height / _EVERY_PX), ceil(width / _EVERY_PX))
        place = int(np.argmax(np.round(covered - cost, 4)))
        share = float(covered.ravel()[place])
        if share > best_share:
            down, right = divmod(place, few.shape[1])
            best, best_share = (form, (right * _EVERY_PX, down * _EVERY_PX)), share
        if best_share >= _CLEAR:
            break
    return best


def _covered(floor: NDArray[np.bool_], height: int, width: int) -> NDArray[np.float32]:
    """Share of a label around each place that is on the floor."""
    covered = ndimage.uniform_filter1d(floor.astype(np.float32), height, axis=0, mode="constant")
    return np.asarray(ndimage.uniform_filter1d(covered, width, axis=1, mode="constant"), np.float32)


def readable(room: Room) -> str:
    """Returns a room's name in the letters that the font has, which are those of English."""
    return room.called if room.called.isascii() else room.name


@lru_cache(maxsize=16)
def _font(size_px: int) -> ImageFont.FreeTypeFont:
    # Pillow's own font: the same letters on every machine.
    font = ImageFont.load_default(size_px)
    if not isinstance(font, ImageFont.FreeTypeFont):
        raise TypeError("Pillow was built without FreeType; install one of its wheels")
    return font
