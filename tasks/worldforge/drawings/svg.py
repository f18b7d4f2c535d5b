"""Reads shapes and texts of an SVG file, with the classes, names and layers of the groups around them."""

import re
from collections.abc import Iterator, Sequence
from itertools import islice
from math import cos, radians, sin, tan
from xml.etree import ElementTree as ET

from ....schemas.wire.errors import ConfigurationError
from ....schemas.worlds.world import Point
from .drawn_shapes import Drawing, Label, Shape

_TOKENS = re.compile(r"([MmLlHhVvCcSsQqTtAaZz])|([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)")
_COUNTS = {"M": 2, "L": 2, "H": 1, "V": 1, "C": 6, "S": 4, "Q": 4, "T": 2, "A": 7}


MOST_CORNERS = 10_000
"""Corners of one shape. Rooms have a dozen; a traced picture has some thousands and is no part of a plan."""


class PathError(ValueError):
    """Raised for an SVG path that cannot be read."""


class TooManyCornersError(Exception):
    """Raised for an SVG shape that is too large to be part of a floor plan."""


def path_points(d: str) -> tuple[list[Point], bool, bool]:
    """Parses an SVG path: the corners of its first part, whether it is closed, and whether it has curves.

    Raises:
        PathError: it is no path.
    """
    points: list[Point] = []
    curved = closed = False
    x = y = 0.0
    for command, numbers in _commands(d):
        if len(points) >= MOST_CORNERS:
            raise TooManyCornersError(f"it has more than {MOST_CORNERS:,} corners")
        if command in "Zz":
            closed = True
            break
        if command in "Mm" and points:
            break
        x, y = _end(command, numbers, (x, y))
        curved |= command.upper() in "CSQTA"
        points.append((x, y))
    if len(points) > 3 and points[0] == points[-1]:
        closed = True
    return points, closed, curved


def _end(command: str, numbers: Sequence[float], at: Point) -> Point:
    """End point of a path's command."""
    base = at if command.islower() else (0.0, 0.0)
    if command in "Hh":
        return base[0] + numbers[0], at[1]
    if command in "Vv":
        return at[0], base[1] + numbers[0]
    return base[0] + numbers[-2], base[1] + numbers[-1]


def _commands(d: str) -> Iterator[tuple[str, list[float]]]:
    """Commands with their numbers, as far as they are asked for; after `M`, repeated numbers are lines."""
    command, numbers = "", list[float]()
    for token in _TOKENS.finditer(d):
        letter, number = token.groups()
        if letter:
            if numbers:
                raise PathError(f"{command} has {len(numbers)} numbers too many")
            command = letter
            if letter in "Zz":
                yield letter, []
            continue
        if command not in _COUNTS and command.upper() not in _COUNTS:
            raise PathError("it does not begin with M")
        numbers.append(float(number))
        if len(numbers) == _COUNTS[command.upper()]:
            yield command, numbers
            numbers = []
            command = {"M": "L", "m": "l"}.get(command, command)
    if numbers:
        raise PathError(f"{command} lacks numbers")


_INKSCAPE = "{http://www.inkscape.org/namespaces/inkscape}"
_HIDDEN = ("defs", "symbol", "clipPath", "mask", "pattern", "marker", "style", "script", "metadata")
_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_PAPER_M = {"mm": 1e-3, "cm": 1e-2, "in": 0.0254, "pt": 0.0254 / 72, "pc": 0.0254 / 6, "m": 1.0}

_DEEPEST = 100
"""Groups around a shape; drawing programs nest a handful."""

_MOST_SHAPES = 100_000
_LONGEST_TRANSFORM = 10_000

Matrix = tuple[float, float, float, float, float, float]
_SAME: Matrix = (1.0, 0.0, 0.0, 1.0, 0.0, 0.0)


def read_svg(content: bytes, name: str) -> Drawing:
    """Reads the floor plan shapes and texts of an SVG file.

    Args:
        content: the file's bytes.
        name: what errors call it.

    Raises:
        ConfigurationError: it is no SVG, or a shape in it cannot be read.
    """
    try:
        root = ET.fromstring(content)  # noqa: S314 (expat bounds entities since 2.4)
    except ET.ParseError as error:
        raise ConfigurationError(f"{name}: this is not XML: {error}") from error
    if _tag(root) != "svg":
        raise ConfigurationError(f"{name}: its root is <{_tag(root)}>; an SVG file's is <svg>")
    reader = _Reader(name)
    reader.walk(root, _SAME, ())
    stated = root.get("data-metres-per-unit") or root.get("data-meters-per-unit")
    try:
        metres = float(stated) if stated else None
    except ValueError:
        raise ConfigurationError(f"{name}: data-metres-per-unit is {stated!r}; a number would be right") from None
    return Drawing(reader.shapes, reader.labels, metres, _paper_m(root), left_out=reader.left_out)


class _Reader:
    """Walks through the elements of a drawing."""

    def __init__(self, name: str) -> None:
        self._name = name
        self.shapes: list[Shape] = []
        self.labels: list[Label] = []
        self.left_out: list[str] = []

    def walk(self, element: ET.Element, matrix: Matrix, around: tuple[str, ...], depth: int = 0) -> None:
        """Collects the shapes of an SVG element and its children."""
        if depth > _DEEPEST:
            raise ConfigurationError(f"{self._name}: it has more than {_DEEPEST} groups inside one another")
        tag = _tag(element)
        if tag in _HIDDEN or element.get("display") == "none" or "display:none" in (element.get("style") or ""):
            return
        matrix = _times(matrix, self._transform(element))
        own = _words(element)
        if tag == "text":
            self._text(element, matrix)
        elif tag in ("rect", "polygon", "polyline", "line", "path"):
            self._shape(element, tag, matrix, (*own, *around))
        elif tag in ("svg", "g", "a", "switch"):
            for child in element:
                if isinstance(child.tag, str):
                    self.walk(child, matrix, (*own, *around) if tag != "svg" else around, depth + 1)

    def _shape(self, element: ET.Element, tag: str, matrix: Matrix, words: tuple[str, ...]) -> None:
        name = _name(element)
        place = f'<{tag}> "{name}"' if name else f"<{tag}> number {len(self.shapes) + 1}"
        if len(self.shapes) >= _MOST_SHAPES:
            raise ConfigurationError(f"{self._name}: it has more than {_MOST_SHAPES:,} shapes")
        try:
            points, closed, curved = _outline(element, tag)
        except TooManyCornersError as error:
            self.left_out.append(f"{place}: {error}")
            return
        except (PathError, ValueError) as error:
            raise ConfigurationError(f"{self._name}: {place} cannot be read: {error}") from error
        if len(points) < 2:
            return
        drawn = tuple(_moved(matrix, point) for point in points)
        facts = {key[5:]: value for key, value in element.attrib.items() if key.startswith("data-")}
        self.shapes.append(Shape(drawn, closed, curved, name, words, facts, place))

    def _text(self, element: ET.Element, matrix: Matrix) -> None:
        text = " ".join("".join(element.itertext()).split())
        first = next((each for each in element.iter() if each.get("x") and each.get("y")), element)
        if text:
            try:
                at = (_number(first.get("x")), _number(first.get("y")))
            except ValueError as error:
                raise ConfigurationError(f"{self._name}: the text {text!r} cannot be read: {error}") from error
            self.labels.append(Label(_moved(matrix, at), text))

    def _transform(self, element: ET.Element) -> Matrix:
        matrix = _SAME
        written = element.get("transform") or ""
        if len(written) > _LONGEST_TRANSFORM:
            raise ConfigurationError(
                f"{self._name}: a transform has {len(written):,} characters; at most {_LONGEST_TRANSFORM:,} are right"
            )
        for what, inside in re.findall(r"(\w+)\s*\(([^)]*)\)", written):
            numbers = [float(each) for each in re.findall(_NUMBER, inside)]
            try:
                matrix = _times(matrix, _matrix(what, numbers))
            except (IndexError, ValueError, TypeError):
                raise ConfigurationError(f"{self._name}: transform {what}({inside}) cannot be read") from None
        return matrix


def _outline(element: ET.Element, tag: str) -> tuple[list[Point], bool, bool]:
    """Corners of a shape, whether it is closed and whether it has curves."""
    if tag == "rect":
        x, y, width, height = (_number(element.get(key)) for key in ("x", "y", "width", "height"))
        return [(x, y), (x + width, y), (x + width, y + height), (x, y + height)], True, False
    if tag == "line":
        x0, y0, x1, y1 = (_number(element.get(key)) for key in ("x1", "y1", "x2", "y2"))
        return [(x0, y0), (x1, y1)], False, False
    if tag == "path":
        return path_points(element.get("d") or "")
    found = islice(re.finditer(_NUMBER, element.get("points") or ""), 2 * MOST_CORNERS + 1)
    numbers = [float(each[0]) for each in found]
    if len(numbers) > 2 * MOST_CORNERS:
        raise TooManyCornersError(f"it has more than {MOST_CORNERS:,} corners")
    if len(numbers) % 2:
        raise ValueError(f"its points are {len(numbers)} numbers; pairs would be right")
    points = list(zip(numbers[::2], numbers[1::2], strict=True))
    return points, tag == "polygon" or (len(points) > 3 and points[0] == points[-1]), False


def _words(element: ET.Element) -> tuple[str, ...]:
    """Classes first: they say what something is; then the names that programs show, then ids."""
    given = (element.get(key) for key in ("class", "data-kind", f"{_INKSCAPE}label", "data-name", "id"))
    return tuple(word for word in given if word)


def _name(element: ET.Element) -> str:
    title = next((child.text or "" for child in element if _tag(child) == "title"), "")
    named = (element.get("data-name"), element.get(f"{_INKSCAPE}label"), title, element.get("id"))
    return " ".join(next((word for word in named if word), "").split())


def _tag(element: ET.Element) -> str:
    return element.tag.rpartition("}")[2] if isinstance(element.tag, str) else ""


def _number(text: str | None) -> float:
    """A length in user units; of one in other units, the number."""
    found = re.match(_NUMBER, (text or "0").strip())
    if found is None:
        raise ValueError(f"{text!r} is no number")
    return float(found[0])


def _paper_m(root: ET.Element) -> float | None:
    """Metres of paper for one unit, where the drawing has a size on paper."""
    size = re.fullmatch(rf"\s*({_NUMBER})\s*([a-z]+)\s*", root.get("width") or "")
    box = re.findall(_NUMBER, root.get("viewBox") or "")
    if size is None or size[2] not in _PAPER_M or len(box) != 4 or float(box[2]) <= 0:
        return None
    return float(size[1]) * _PAPER_M[size[2]] / float(box[2])


def _matrix(what: str, numbers: Sequence[float]) -> Matrix:
    first, second = numbers[0], (numbers[1] if len(numbers) > 1 else None)
    if what == "translate":
        return 1.0, 0.0, 0.0, 1.0, first, second or 0.0
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


def _times(one: Matrix, other: Matrix) -> Matrix:
    a, b, c, d, e, f = one
    u, v, w, x, y, z = other
    return a * u + c * v, b * u + d * v, a * w + c * x, b * w + d * x, a * y + c * z + e, b * y + d * z + f


def _moved(matrix: Matrix, point: Point) -> Point:
    """A point on the page with y up."""
    a, b, c, d, e, f = matrix
    x, y = point
    return a * x + c * y + e, -(b * x + d * y + f)
