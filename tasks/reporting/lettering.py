"""Putting names into rooms so that they fit."""

from collections.abc import Sequence
from dataclasses import dataclass

from markupsafe import Markup

from ...schemas.world import Point
from .frame import Frame
from .svg import element

_LETTER = 0.56  # mean width of a letter, in letter heights, of common sans-serif faces
_SIZE, _SMALLEST = 25.0, 15.0
_FILL = 0.9  # share of a room's width that a name may take; small screens enlarge letters a little


@dataclass(frozen=True)
class Box:
    """An axis-aligned rectangle."""

    left: float
    bottom: float
    right: float
    top: float

    @property
    def middle(self) -> Point:
        """Its centre."""
        return (self.left + self.right) / 2, (self.bottom + self.top) / 2


def largest_box(polygon: Sequence[Point]) -> Box:
    """The largest rectangle inside an axis-aligned polygon whose sides lie on the corners' coordinates.

    Rooms have few corners, so trying all pairs of coordinates is quick.
    """
    xs = sorted({round(x, 6) for x, _ in polygon})
    ys = sorted({round(y, 6) for _, y in polygon})
    inside = [
        [_contains(polygon, ((x0 + x1) / 2, (y0 + y1) / 2)) for y0, y1 in zip(ys, ys[1:], strict=False)]
        for x0, x1 in zip(xs, xs[1:], strict=False)
    ]
    boxes = (
        Box(xs[i], ys[k], xs[j], ys[m])
        for i in range(len(xs))
        for j in range(i + 1, len(xs))
        for k in range(len(ys))
        for m in range(k + 1, len(ys))
        if all(all(column[k:m]) for column in inside[i:j])
    )
    whole = Box(xs[0], ys[0], xs[-1], ys[-1])
    return max(boxes, key=lambda box: (box.right - box.left) * (box.top - box.bottom), default=whole)


def _contains(polygon: Sequence[Point], point: Point) -> bool:
    crossings = 0
    for (x0, y0), (x1, y1) in zip(polygon, [*polygon[1:], polygon[0]], strict=True):
        if (y0 > point[1]) != (y1 > point[1]) and point[0] < x0 + (point[1] - y0) * (x1 - x0) / (y1 - y0):
            crossings += 1
    return crossings % 2 == 1


def draw_label(name: str, note: str, polygon: Sequence[Point], frame: Frame) -> Markup:
    """A room's name and a note below it, in the room's largest rectangle, turned where that is tall and narrow."""
    box = largest_box(polygon)
    width, height = (box.right - box.left) * frame.scale * _FILL, (box.top - box.bottom) * frame.scale * _FILL
    turned = height > 1.5 * width and len(name) * _LETTER * _SIZE > width
    room = height if turned else width
    size = max(_SMALLEST, min(_SIZE, room / (max(len(name), 1) * _LETTER)))
    fitting = max(3, int(room / (size * _LETTER)))
    shown = name if len(name) <= fitting else name[: fitting - 1] + "…"
    note_size = max(_SMALLEST, 0.76 * size)
    fits = len(note) * _LETTER * note_size <= room and (width if turned else height) > 2.2 * size
    note_shown = note if fits else ""
    x, y = frame.at(box.middle)
    return element(
        "g",
        element("title", name) if shown != name else "",
        # Sizes in em of the group's letters, which the style sheet enlarges on small screens.
        element("text", shown, y="-0.1em" if note_shown else "0.35em", font_size=f"{size / _SIZE:.2f}em"),
        element("text", note_shown, class_="room-note", y="1em", font_size=f"{note_size / _SIZE:.2f}em")
        if note_shown
        else "",
        transform=f"translate({x:.1f} {y:.1f})" + (" rotate(-90)" if turned else ""),
    )
