"""Geometry of SVG elements: outlines of shapes, arcs of door leaves in paths, transforms and view boxes."""

import re
from collections.abc import Iterator, Sequence
from itertools import islice, pairwise
from math import cos, hypot, radians, sin, sqrt, tan
from typing import NamedTuple
from xml.etree import ElementTree as ET

from ....schemas.worlds.world import Point
from .door_symbols import Swing
from .drawn_shapes import Line

MOST_CORNERS = 10_000
"""Limit of the corners of one shape.

Rooms have a dozen; a traced picture has some thousands and is no part of a plan.
"""

NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_TOKENS = re.compile(rf"([MmLlHhVvCcSsQqTtAaZz])|({NUMBER})")
_COUNTS = {"M": 2, "L": 2, "H": 1, "V": 1, "C": 6, "S": 4, "Q": 4, "T": 2, "A": 7}
_PAPER_M = {"mm": 1e-3, "cm": 1e-2, "in": 0.0254, "pt": 0.0254 / 72, "pc": 0.0254 / 6, "m": 1.0}
_ROUND = 0.05
"""Largest difference of the distances of an arc's two ends from its hinge, as a share of the radius; programs round."""
_LONGEST_TRANSFORM = 10_000

Matrix = tuple[float, float, float, float, float, float]
SAME: Matrix = (1.0, 0.0, 0.0, 1.0, 0.0, 0.0)
Size = tuple[float, float]


class PathError(ValueError):
    """Raised for an SVG path that cannot be read."""


class TooManyCornersError(Exception):
    """Raised for an SVG shape that is too large to be part of a floor plan."""


class Outline(NamedTuple):
    """Geometry of an SVG shape, or of one part of a path, in its own coordinates."""

    points: tuple[Point, ...]
    """Corners of an SVG shape; of curves, the ends."""
    closed: bool = False
    curved: bool = False
    swings: tuple[Swing, ...] = ()
    """Arcs in an SVG shape that a door leaf may swing along."""
    lines: tuple[Line, ...] = ()

    def moved(self, matrix: Matrix, *, is_way: bool) -> "Outline":
        """Returns the outline transformed to page coordinates with y up; for a door, with its swings and lines."""
        points = tuple(moved(matrix, point) for point in self.points)
        if not is_way:
            return Outline(points, self.closed, self.curved)
        return self._replace(
            points=points,
            swings=tuple(
                Swing(moved(matrix, hinge), (moved(matrix, one), moved(matrix, other)))
                for hinge, (one, other) in self.swings
            ),
            lines=tuple((moved(matrix, one), moved(matrix, other)) for one, other in self.lines),
        )


def outlines(element: ET.Element, tag: str) -> list[Outline]:
    """Parses a shape: one outline, of a path one for each of its parts.

    Raises:
        PathError: The path cannot be read.
        ValueError: An attribute of the shape is not a number.
        TooManyCornersError: The shape has more corners than a part of a floor plan.
    """
    if tag == "rect":
        x, y, width, height = (number(element.get(key)) for key in ("x", "y", "width", "height"))
        return [_polygon([(x, y), (x + width, y), (x + width, y + height), (x, y + height)], closed=True)]
    if tag == "line":
        x0, y0, x1, y1 = (number(element.get(key)) for key in ("x1", "y1", "x2", "y2"))
        return [_polygon([(x0, y0), (x1, y1)], closed=False)]
    if tag == "path":
        return path_parts(element.get("d") or "")
    found = islice(re.finditer(NUMBER, element.get("points") or ""), 2 * MOST_CORNERS + 1)
    numbers = [float(each[0]) for each in found]
    if len(numbers) > 2 * MOST_CORNERS:
        raise TooManyCornersError
    if len(numbers) % 2:
        raise ValueError(f"its points are {len(numbers)} numbers; pairs would be right")
    points = list(zip(numbers[::2], numbers[1::2], strict=True))
    return [_polygon(points, closed=tag == "polygon" or (len(points) > 3 and points[0] == points[-1]))]


def _polygon(points: Sequence[Point], *, closed: bool) -> Outline:
    around = [*points, points[0]] if closed and points else points
    return Outline(tuple(points), closed, lines=tuple(pairwise(around)))


def path_parts(d: str) -> list[Outline]:
    """Parses an SVG path: its parts, each from one `M` to the next.

    Raises:
        PathError: The text is not a path.
        TooManyCornersError: The path has more corners than a part of a floor plan.
    """
    parts: list[_PathPart] = []
    x = y = 0.0
    for count, (command, numbers) in enumerate(_commands(d)):
        if count >= MOST_CORNERS:
            raise TooManyCornersError
        if command in "Zz":
            parts[-1].close()
            x, y = parts[-1].points[0]
            continue
        end = _end(command, numbers, (x, y))
        if command in "Mm":
            parts.append(_PathPart(end))
        else:
            if parts[-1].closed:  # after Z, the next part begins where this one did
                parts.append(_PathPart((x, y)))
            parts[-1].go(command, numbers, end)
        x, y = end
    return [part.outline() for part in parts if len(part.points) > 1]


class _PathPart:
    """Part of an SVG path that is being read, from one `M` to the next."""

    def __init__(self, start: Point) -> None:
        self.points = [start]
        self.closed = self.curved = False
        self.swings: list[Swing] = []
        self.lines: list[Line] = []

    def go(self, command: str, numbers: Sequence[float], end: Point) -> None:
        start = self.points[-1]
        if command.upper() in "CSQTA":
            self.curved = True
            hinge = _hinge(command, numbers, start, end)
            self.swings += [Swing(hinge, (start, end))] if hinge else []
        else:
            self.lines.append((start, end))
        self.points.append(end)

    def close(self) -> None:
        if self.points[-1] != self.points[0]:
            self.lines.append((self.points[-1], self.points[0]))
        self.closed = True

    def outline(self) -> Outline:
        closed = self.closed or (len(self.points) > 3 and self.points[0] == self.points[-1])
        return Outline(tuple(self.points), closed, self.curved, tuple(self.swings), tuple(self.lines))


def _end(command: str, numbers: Sequence[float], at: Point) -> Point:
    """Returns the end point of one SVG path command."""
    base = at if command.islower() else (0.0, 0.0)
    if command in "Hh":
        return base[0] + numbers[0], at[1]
    if command in "Vv":
        return at[0], base[1] + numbers[0]
    return base[0] + numbers[-2], base[1] + numbers[-1]


def _hinge(command: str, numbers: Sequence[float], start: Point, end: Point) -> Point | None:
    """Returns the centre of a curve if it is an arc of a circle, else `None`.

    Such a curve is an `A` with one radius, or a quarter of a circle.
    """
    if command in "Aa":
        return _centre(numbers, start, end)
    if command not in "CcQq":
        return None
    base = start if command.islower() else (0.0, 0.0)
    first = base[0] + numbers[0], base[1] + numbers[1]
    last = base[0] + numbers[-4], base[1] + numbers[-3]
    # Where the tangents of both ends meet is the corner opposite to the hinge.
    (ux, uy), (vx, vy) = (first[0] - start[0], first[1] - start[1]), (last[0] - end[0], last[1] - end[1])
    across = ux * vy - uy * vx
    if not across or abs(ux * vx + uy * vy) > _ROUND * hypot(ux, uy) * hypot(vx, vy):
        return None
    along = ((end[0] - start[0]) * vy - (end[1] - start[1]) * vx) / across
    corner = start[0] + along * ux, start[1] + along * uy
    hinge = start[0] + end[0] - corner[0], start[1] + end[1] - corner[1]
    return hinge if _is_round(hinge, start, end) and _is_round(corner, start, end) else None


def _centre(numbers: Sequence[float], start: Point, end: Point) -> Point | None:
    """Returns the centre of a circular arc given by an SVG `A` command; `None` for an ellipse."""
    radius, other, _, large, sweep = (abs(numbers[0]), abs(numbers[1]), *numbers[2:5])
    chord = hypot(end[0] - start[0], end[1] - start[1])
    if not chord or abs(radius - other) > _ROUND * radius:
        return None
    radius = max(radius, chord / 2)
    off = sqrt(max(0.0, radius**2 - chord**2 / 4)) * (1 if bool(large) != bool(sweep) else -1) / chord
    middle = (start[0] + end[0]) / 2, (start[1] + end[1]) / 2
    return middle[0] - off * (end[1] - start[1]), middle[1] + off * (end[0] - start[0])


def _is_round(centre: Point, one: Point, other: Point) -> bool:
    near, far = sorted(hypot(at[0] - centre[0], at[1] - centre[1]) for at in (one, other))
    return far - near <= _ROUND * far


def _commands(d: str) -> Iterator[tuple[str, list[float]]]:
    """Yields the commands of an SVG path with their numbers, lazily; repeated numbers after `M` are lines.

    Raises PathError if the path does not begin with `M`, or a command has too few or too many numbers.
    """
    command: str = ""
    numbers: list[float] = []
    begun = False
    for token in _TOKENS.finditer(d):
        letter: str = token[1] or ""
        figure: str = token[2] or ""
        if not begun and letter not in ("M", "m"):
            raise PathError("it does not begin with M")
        begun = True
        if letter:
            if numbers:
                raise PathError(f"{command} has {len(numbers)} numbers too many")
            command = letter
            if letter in "Zz":
                yield letter, []
            continue
        if command in "Zz":
            raise PathError("a number follows Z")
        numbers.append(float(figure))
        if len(numbers) == _COUNTS[command.upper()]:
            yield command, numbers
            numbers = []
            command = {"M": "L", "m": "l"}.get(command, command)
    if numbers:
        raise PathError(f"{command} lacks numbers")


def number(text: str | None) -> float:
    """Parses a length in user units; of one in other units, the number.

    Raises:
        ValueError: The text is not a length.
    """
    found = re.match(NUMBER, (text or "0").strip())
    if found is None:
        raise ValueError(f"{text!r} is no number")
    return float(found[0])


def paper_m(root: ET.Element) -> float | None:
    """Returns the length on paper of one user unit of an SVG drawing, in metres; `None` without a size on paper."""
    size = re.fullmatch(rf"\s*({NUMBER})\s*([a-z]+)\s*", root.get("width") or "")
    box = view_box(root)
    if size is None or size[2] not in _PAPER_M or box is None:
        return None
    return float(size[1]) * _PAPER_M[size[2]] / box[2]


def view_box(element: ET.Element) -> tuple[float, float, float, float] | None:
    """Returns x, y, width and height of an element's view box; `None` if it has none."""
    found = [float(each) for each in re.findall(NUMBER, (element.get("viewBox") or "")[:_LONGEST_TRANSFORM])]
    if len(found) != 4 or found[2] <= 0 or found[3] <= 0:
        return None
    x, y, width, height = found
    return x, y, width, height


def viewport_size(element: ET.Element, around: Size, instance: ET.Element | None = None) -> Size:
    """Returns width and height that an `<svg>` or `<symbol>` fills.

    Args:
        element: The `<svg>` or `<symbol>`.
        around: Width and height of what it is in, of which 100 % is meant where nothing is said.
        instance: The `<use>` that shows it, whose width and height come first.
    """
    size: list[float] = []
    for key, whole in zip(("width", "height"), around, strict=True):
        said = (instance.get(key) if instance is not None else None) or element.get(key) or "100%"
        size.append(number(said) * (whole / 100 if said.strip().endswith("%") else 1))
    return size[0], size[1]


def viewport(element: ET.Element, size: Size) -> Matrix:
    """Returns the transform from a view box into its viewport, as `preserveAspectRatio` says.

    Args:
        element: An `<svg>` or `<symbol>`.
        size: Width and height of the viewport.
    """
    box = view_box(element)
    if box is None:
        return SAME
    x, y, width, height = box
    wide, high = size[0] / width, size[1] / height
    kept = (element.get("preserveAspectRatio") or "xMidYMid").split()
    if kept and kept[0] == "none":
        return wide, 0.0, 0.0, high, -x * wide, -y * high
    scale = max(wide, high) if "slice" in kept else min(wide, high)
    shares = {"Min": 0.0, "Mid": 0.5, "Max": 1.0}
    align = kept[0] if kept else ""
    left, top = shares.get(align[1:4], 0.5), shares.get(align[5:8], 0.5)
    return (
        scale, 0.0, 0.0, scale,
        left * (size[0] - width * scale) - x * scale, top * (size[1] - height * scale) - y * scale,
    )  # fmt: skip


def transform(written: str) -> Matrix:
    """Parses a `transform`.

    Raises:
        ValueError: The transform cannot be read; the message says why.
    """
    matrix = SAME
    if len(written) > _LONGEST_TRANSFORM:
        raise ValueError(f"a transform has {len(written):,} characters; at most {_LONGEST_TRANSFORM:,} are right")
    for what, inside in re.findall(r"(\w+)\s*\(([^)]*)\)", written):
        numbers = [float(each) for each in re.findall(NUMBER, inside)]
        try:
            matrix = times(matrix, _matrix(what, numbers))
        except (IndexError, ValueError, TypeError):
            raise ValueError(f"transform {what}({inside}) cannot be read") from None
    return matrix


def _matrix(what: str, numbers: Sequence[float]) -> Matrix:
    first, second = numbers[0], (numbers[1] if len(numbers) > 1 else None)
    if what == "translate":
        return translation(first, second or 0.0)
    if what == "scale":
        return first, 0.0, 0.0, first if second is None else second, 0.0, 0.0
    if what == "rotate":
        c, s = cos(radians(first)), sin(radians(first))
        x, y = (numbers[1], numbers[2]) if second is not None else (0.0, 0.0)
        return c, s, -s, c, x - c * x + s * y, y - s * x - c * y
    if what == "skewX":
        return 1.0, 0.0, tan(radians(first)), 1.0, 0.0, 0.0
    if what == "skewY":
        return 1.0, tan(radians(first)), 0.0, 1.0, 0.0, 0.0
    a, b, c, d, e, f = numbers
    return a, b, c, d, e, f


def translation(x: float, y: float) -> Matrix:
    """Returns the 2D transform that moves by x and y."""
    return 1.0, 0.0, 0.0, 1.0, x, y


def times(one: Matrix, other: Matrix) -> Matrix:
    """Multiplies two 2D transforms: the result applies the second one first, then the first."""
    a, b, c, d, e, f = one
    u, v, w, x, y, z = other
    return a * u + c * v, b * u + d * v, a * w + c * x, b * w + d * x, a * y + c * z + e, b * y + d * z + f


def moved(matrix: Matrix, point: Point) -> Point:
    """Transforms a point of an SVG element to page coordinates with y up."""
    a, b, c, d, e, f = matrix
    x, y = point
    return a * x + c * y + e, -(b * x + d * y + f)
