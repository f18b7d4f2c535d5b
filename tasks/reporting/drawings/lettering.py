"""Placement of room names in a floor plan."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

from markupsafe import Markup

from ....schemas.worlds.world import Point, contains
from .svg_writing import Frame, element

_LETTER = 0.6  # mean width of a letter, in letter heights, of common sans-serif faces
_FILL = 0.9  # share of a room's width that a name may take; small screens enlarge letters a little
_MOST_COORDINATES = 256
_TRIES = 4  # places tried to each side of the middle
_CLEARANCE, _AIR = 14.0, 5.0

LETTERS = 27.0
"""Height of letters in units of the drawing; the style sheet has the same number."""


@dataclass(frozen=True)
class Box:
    """An axis-aligned rectangle in which a room's label is drawn."""

    left: float
    bottom: float
    right: float
    top: float


def largest_box(polygon: Sequence[Point]) -> Box:
    """Returns the largest rectangle inside a room's axis-aligned polygon, as the place for its label.

    All pairs of coordinates are tried, as rooms have few corners; for a polygon with very many corners, the bounding
    box is returned.
    """
    xs = sorted({round(x, 6) for x, _ in polygon})
    ys = sorted({round(y, 6) for _, y in polygon})
    whole = Box(xs[0], ys[0], xs[-1], ys[-1])
    if len(xs) * len(ys) > _MOST_COORDINATES:
        return whole
    inside = [[contains(polygon, (x0 + x1) / 2, (y0 + y1) / 2) for y0, y1 in pairwise(ys)] for x0, x1 in pairwise(xs)]
    boxes = (
        Box(xs[i], ys[k], xs[j], ys[m])
        for i in range(len(xs))
        for j in range(i + 1, len(xs))
        for k in range(len(ys))
        for m in range(k + 1, len(ys))
        if all(all(column[k:m]) for column in inside[i:j])
    )
    return max(boxes, key=lambda box: (box.right - box.left) * (box.top - box.bottom), default=whole)


def draw_label(
    name: str, note: str, polygon: Sequence[Point], frame: Frame, crowd: Sequence[Point] = (), size: float = LETTERS
) -> Markup:
    """Draws a room's name and a note in a floor plan, where they cover least; vertically in narrow rooms.

    Args:
        name: Name of the room; it is shortened if it does not fit, and the whole name becomes the tooltip.
        note: Text below the name; left out if it does not fit.
        polygon: The room's corners in metres.
        frame: The drawing.
        crowd: Points of the drawing that the label should not cover.
        size: Height of the letters in units of the drawing; long names get smaller ones.
    """
    box = largest_box(polygon)
    width, height = (box.right - box.left) * frame.scale * _FILL, (box.top - box.bottom) * frame.scale * _FILL
    turned = height > 1.5 * width and len(name) * _LETTER * size > width
    along, across = (height, width) if turned else (width, height)
    fitted = max(0.6 * size, min(size, along / (max(len(name), 1) * _LETTER)))
    fitting = max(3, int(along / (fitted * _LETTER)))
    shown = name if len(name) <= fitting else name[: fitting - 1] + "…"
    note_size = max(0.6 * size, 0.76 * fitted)
    if len(note) * _LETTER * note_size > along or across < 2.2 * fitted:
        note = ""
    length = _LETTER * max(len(shown) * fitted, len(note) * note_size)
    thickness = (2.1 if note else 1.2) * fitted
    x, y = _calmest(box, (thickness, length) if turned else (length, thickness), frame, crowd)
    return element(
        "g",
        element("title", name) if shown != name else "",
        # Sizes in em of the group's letters, which the style sheet enlarges on small screens.
        element("text", shown, y="-0.1em" if note else "0.35em", font_size=f"{fitted / LETTERS:.2f}em"),
        element("text", note, class_="room-note", y="1em", font_size=f"{note_size / LETTERS:.2f}em") if note else "",
        transform=f"translate({x:.1f} {y:.1f})" + (" rotate(-90)" if turned else ""),
    )


def _calmest(box: Box, label: tuple[float, float], frame: Frame, crowd: Sequence[Point]) -> Point:
    """Returns the centre of the label where it covers the fewest points to keep free, nearest to the box's centre."""
    (left, top), (right, bottom) = frame.at((box.left, box.top)), frame.at((box.right, box.bottom))
    middle = (left + right) / 2, (top + bottom) / 2
    near = [(x, y) for x, y in crowd if left < x < right and top < y < bottom]
    if not near:
        return middle
    # The label keeps clear of the walls.
    slack_x = max(0.0, (right - left - label[0]) / 2 - _CLEARANCE)
    slack_y = max(0.0, (bottom - top - label[1]) / 2 - _CLEARANCE)
    places = [
        (middle[0] + slack_x * i / _TRIES, middle[1] + slack_y * j / _TRIES)
        for i in range(-_TRIES, _TRIES + 1)
        for j in range(-_TRIES, _TRIES + 1)
    ]

    def cost(place: Point) -> tuple[int, float]:
        covered = sum(
            abs(x - place[0]) < label[0] / 2 + _AIR and abs(y - place[1]) < label[1] / 2 + _AIR for x, y in near
        )
        return covered, math.dist(place, middle)

    return min(places, key=cost)
