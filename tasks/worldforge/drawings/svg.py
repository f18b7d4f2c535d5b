"""Reads the shapes and texts of an SVG file, with the classes, names and layers of the groups around them."""

import re
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from typing import NamedTuple, TypeVar
from xml.etree import ElementTree as ET

from ....schemas.wire.errors import ConfigurationError
from .door_symbols import MOST_PARTS, SymbolPart, symbols
from .drawn_shapes import Drawing, Kind, Label, Shape, counted, is_given, is_ifc_container, kind_of_words, names_one
from .svg_paths import (
    MOST_CORNERS,
    SAME,
    Matrix,
    Outline,
    Size,
    TooManyCornersError,
    moved,
    number,
    outlines,
    paper_m,
    times,
    transform,
    translation,
    view_box,
    viewport,
    viewport_size,
)

T = TypeVar("T")

_SVG = "{http://www.w3.org/2000/svg}"
_INKSCAPE = "{http://www.inkscape.org/namespaces/inkscape}"
_HREFS = ("href", "{http://www.w3.org/1999/xlink}href")
_SHAPES = ("rect", "polygon", "polyline", "line", "path")
_GROUPS = ("svg", "g", "a", "switch", "use", "symbol")
_SILENT = (
    *("defs", "symbol", "clipPath", "mask", "pattern", "marker", "linearGradient", "radialGradient", "filter"),
    *("style", "script", "metadata", "title", "desc", "view", "animate", "animateTransform", "animateMotion", "set"),
)
"""SVG elements that draw nothing at their own position."""
_WAYS: tuple[Kind, ...] = ("door", "opening", "window")

_DEEPEST = 100
"""Limit of nested groups around a shape; drawing programs nest a handful."""

_MOST_REPEATED = 20_000
"""Limit of elements that `<use>` draws in total, each counted as often as drawn: a second.

Offices have a thousand doors and chairs.
"""
_MOST_SHAPES = 100_000
_MOST_POINTS = 500_000
"""Limit of the corners of all shapes of a drawing together: a second and 100 MB of memory."""
_MOST_WORDS = 50
"""Limit of the classes and names around a shape that are considered; ten groups up, none says what a shape is."""
_LONGEST = 60
"""Limit of the characters of a class or link that messages repeat; a file may have some of a megabyte."""


def read_svg(content: bytes, name: str) -> Drawing:
    """Reads the floor plan shapes and texts of an SVG file.

    Args:
        content: The file's bytes.
        name: Name of the file in error messages.

    Raises:
        ConfigurationError: The file is not an SVG drawing, or a shape in it cannot be read.
    """
    try:
        root = ET.fromstring(content)  # noqa: S314 (expat bounds entities since 2.4)
    except ET.ParseError as error:
        raise ConfigurationError(f"{name}: this is not XML: {error}") from error
    if _tag(root) != "svg":
        raise ConfigurationError(f"{name}: its root is <{root.tag.rpartition('}')[2]}>; an SVG file's is <svg>")
    reader = _Reader(name, root)
    reader.read()
    stated = root.get("data-metres-per-unit") or root.get("data-meters-per-unit")
    try:
        metres = float(stated) if stated else None
    except ValueError:
        raise ConfigurationError(f"{name}: data-metres-per-unit is {stated!r}; a number would be right") from None
    return Drawing(reader.shapes, reader.labels, metres, paper_m(root), left_out=counted(reader.unread), y_up=-1)


@dataclass(frozen=True)
class _Around:
    """Properties that an element inherits from the groups around it."""

    matrix: Matrix = SAME
    words: tuple[str, ...] = ()
    """Classes, names and layers of the groups around an SVG element, those of the innermost group first."""
    facts: dict[str, str] = field(default_factory=dict[str, str])
    size: Size = (0.0, 0.0)
    """Width and height of the SVG viewport that percentages refer to."""
    is_visible: bool = True
    """Whether `visibility`, which is inherited from groups, shows the element."""
    depth: int = 0
    symbol: "_Symbol | None" = None
    using: tuple[ET.Element, ...] = ()
    """Stack of `<use>` elements that are being drawn, the outermost first."""


class _Symbol(NamedTuple):
    """Group whose class or name says that it draws doors, openings or windows."""

    kind: Kind
    depth: int
    parts: list[SymbolPart]


class _Element(NamedTuple):
    """Properties of one SVG element itself, read once however often `<use>` shows it."""

    tag: str
    matrix: Matrix
    words: tuple[str, ...]
    facts: dict[str, str]
    kind: Kind | None
    """Kind of shape (door, window, ...) that an SVG element's own names mean."""
    is_hidden: bool
    """Whether an SVG element and all its children are not drawn at all."""
    is_visible: bool | None
    """Value of an SVG element's own `visibility`; `None`: it has none."""


class _Reader:
    """Walks through the elements of a drawing."""

    def __init__(self, name: str, root: ET.Element) -> None:
        self._name = name
        self._root = root
        self._repeated = self._points = self._numbered = 0
        # Elements with an id, for `<use>`; the first of several counts, as in browsers.
        self._by_id = {key: element for element in reversed([*root.iter()]) if (key := element.get("id"))}
        self._element = cache(self._element_of)
        self._outlines = cache(self._outlines_of)
        self._text = cache(_text_of)
        self.shapes: list[Shape] = []
        self.labels: list[Label] = []
        self.unread: Counter[str] = Counter()

    def read(self) -> None:
        """Collects the shapes and texts of an SVG drawing."""
        box = view_box(self._root)
        size = box[2:] if box else self._of(self._root, lambda: viewport_size(self._root, (0.0, 0.0)))
        own = self._element(self._root)
        if own.is_hidden:
            self.unread["hidden <svg>"] += 1
        else:
            self._children(self._root, _Around(own.matrix, size=size, is_visible=own.is_visible is not False))

    def _walk(self, element: ET.Element, around: _Around, instance: ET.Element | None = None) -> None:
        """Collects the shapes of an element and its children; a `<use>` shows it as an instance.

        Hidden and unknown elements are only counted. Raises ConfigurationError if groups are nested too deeply or
        `<use>` shows too many elements.
        """
        self._repeated += bool(around.using)
        if self._repeated > _MOST_REPEATED:
            raise ConfigurationError(f"{self._name}: <use> shows more than {_MOST_REPEATED:,} elements")
        if around.depth > _DEEPEST:
            raise ConfigurationError(f"{self._name}: it has more than {_DEEPEST} groups inside one another")
        own = self._element(element)
        if not own.tag or (own.tag in _SILENT and not (own.tag == "symbol" and instance is not None)):
            return
        matrix = times(around.matrix, own.matrix)
        words = (*own.words, *around.words)[:_MOST_WORDS] if own.words else around.words
        facts = {**around.facts, **own.facts} if own.facts else around.facts
        is_visible = around.is_visible if own.is_visible is None else own.is_visible
        inside = replace(around, matrix=matrix, words=words, facts=facts, is_visible=is_visible)
        if own.is_hidden or not (is_visible or own.tag in _GROUPS):
            self.unread[f"hidden {_sort(element, around.words)}"] += 1
        elif own.tag in _SHAPES:
            self._shape(element, inside, _sort(element, around.words))
        elif own.tag in _GROUPS:
            self._group(element, own, replace(inside, depth=around.depth + 1), instance)
        elif own.tag == "text":
            self._label(element, matrix)
        else:
            self.unread[_sort(element, around.words)] += 1

    def _children(self, element: ET.Element, around: _Around) -> None:
        for child in element:
            self._walk(child, around)

    def _group(self, element: ET.Element, own: _Element, inside: _Around, instance: ET.Element | None) -> None:
        """Collects the shapes of a group; those of a door's group become one shape for each door.

        Raises ConfigurationError if a group of doors or windows has too many shapes.
        """
        before = len(self.shapes)
        # What a `<use>` shows is mostly a group: the shapes in that one are its own.
        symbol = _Symbol(own.kind, inside.depth + (own.tag == "use"), []) if own.kind else None
        within = replace(inside, symbol=symbol) if symbol else inside
        if own.tag == "use":
            self._used(element, within)
        elif own.tag in ("svg", "symbol"):
            self._fitted(element, within, instance)
        else:
            self._children(element, within)
        if symbol:
            if len(symbol.parts) > MOST_PARTS:
                raise ConfigurationError(
                    f"{self._name}: {_sort(element, own.words)} has more than {MOST_PARTS:,} shapes of doors or "
                    "windows; one group for each would be right"
                )
            self.shapes += symbols(symbol.parts)
        # The name of a group with one shape is the shape's; each `<use>` is one thing of many.
        if len(self.shapes) == before + 1 and (name := _group_name(element, own.tag)):
            shape = self.shapes[-1]
            if own.tag == "use":
                self.shapes[-1] = shape._replace(name=name, place=f'<use> "{name}"')
            elif not is_given(shape.name):
                self.shapes[-1] = shape._replace(name=name)

    def _used(self, element: ET.Element, around: _Around) -> None:
        """Collects the shapes that a `<use>` shows, moved to its place; counts as unread what the drawing lacks.

        Raises ConfigurationError if it shows something inside of itself.
        """
        link = next((link for key in _HREFS if (link := element.get(key))), "")
        shown = self._by_id.get(link[1:]) if link.startswith("#") else None
        if shown is None:
            reason = "which the drawing does not have" if link.startswith("#") else "which is outside of the drawing"
            self.unread[f'<use> of "{link[:_LONGEST]}", {reason}'] += 1
            return
        if shown in around.using:
            chain = " in ".join(f'"{each.get("id", "")[:_LONGEST]}"' for each in (shown, *reversed(around.using)))
            raise ConfigurationError(f"{self._name}: <use> shows something inside of itself: {chain}")
        x, y = self._of(element, lambda: (number(element.get("x")), number(element.get("y"))))
        moved_there = times(around.matrix, translation(x, y))
        self._walk(shown, replace(around, matrix=moved_there, using=(*around.using, shown)), element)

    def _fitted(self, element: ET.Element, around: _Around, instance: ET.Element | None) -> None:
        """Collects the shapes of an `<svg>` or `<symbol>`, fitted into its viewport.

        `instance` is the `<use>` element that shows it, whose size counts first; `None` for one that stands itself.
        """
        size = self._of(element, lambda: viewport_size(element, around.size, instance))
        matrix = around.matrix
        if _tag(element) == "svg":
            x, y = self._of(element, lambda: (number(element.get("x")), number(element.get("y"))))
            matrix = times(matrix, translation(x, y))
        box = view_box(element)
        matrix = times(matrix, viewport(element, size))
        self._children(element, replace(around, matrix=matrix, size=box[2:] if box else size))

    def _shape(self, element: ET.Element, around: _Around, sort: str) -> None:
        name = _name(element)
        self._numbered += 1
        place = f'<{_tag(element)}> "{name}"' if name else f"<{_tag(element)}> number {self._numbered}"
        if self._numbered > _MOST_SHAPES:
            raise ConfigurationError(f"{self._name}: it has more than {_MOST_SHAPES:,} shapes")
        parts = self._outlines(element)
        if parts is None:
            self.unread[f"{sort} of more than {MOST_CORNERS:,} corners"] += 1
            return
        parts = [each for each in parts if len(each.points) > 1]
        if not parts:
            self.unread[f"{sort} without any extent"] += 1
            return
        kind = kind_of_words(around.words)
        symbol = around.symbol
        if kind not in _WAYS and len(parts) > 1:
            self.unread[f"further parts of {sort}"] += len(parts) - 1
            parts = parts[:1]
        self._points += sum(len(each.points) for each in parts)
        if self._points > _MOST_POINTS:
            raise ConfigurationError(f"{self._name}: its shapes have more than {_MOST_POINTS:,} corners together")
        made: list[SymbolPart] = []
        for each in parts:
            at = each.moved(around.matrix, is_way=kind in _WAYS)
            shape = Shape(at.points, at.closed, at.curved, name, around.words, around.facts, place, sort)
            is_direct = symbol is None or around.depth <= symbol.depth
            made.append(SymbolPart(shape, is_direct, at.swings, at.lines))
        if kind not in _WAYS:
            self.shapes += [each.shape for each in made]
        elif symbol and symbol.kind == kind:
            symbol.parts.extend(made)
        else:
            self.shapes += symbols(made)

    def _label(self, element: ET.Element, matrix: Matrix) -> None:
        text, x, y = self._text(element)
        if text:
            try:
                at = number(x), number(y)
            except ValueError as error:
                raise ConfigurationError(f"{self._name}: the text {text!r} cannot be read: {error}") from error
            self.labels.append(Label(moved(matrix, at), text))

    def _element_of(self, element: ET.Element) -> _Element:
        words = _words(element)
        facts = {key[5:]: value for key, value in element.attrib.items() if key.startswith("data-")}
        kind = kind_of_words(words)
        try:
            matrix = transform(element.get("transform") or "")
        except ValueError as error:
            raise ConfigurationError(f"{self._name}: {error}") from None
        style = element.get("style") or ""
        is_hidden = element.get("display") == "none" or re.search(r"display\s*:\s*none", style) is not None
        seen = _visibility(element, style)
        return _Element(_tag(element), matrix, words, facts, kind if kind in _WAYS else None, is_hidden, seen)

    def _outlines_of(self, element: ET.Element) -> list[Outline] | None:
        """Returns the outlines of an SVG shape; `None` if it is too large to be a part of a plan."""
        try:
            return self._of(element, lambda: outlines(element, _tag(element)))
        except TooManyCornersError:
            return None

    def _of(self, element: ET.Element, read: Callable[[], T]) -> T:
        """Calls a function that reads an SVG element, and returns its result.

        Raises ConfigurationError, which names the element, in place of the function's ValueError.
        """
        try:
            return read()
        except ValueError as error:
            name = _name(element)
            place = f'<{_tag(element)}> "{name}"' if name else f"<{_tag(element)}> number {self._numbered}"
            raise ConfigurationError(f"{self._name}: {place} cannot be read: {error}") from error


def _visibility(element: ET.Element, style: str) -> bool | None:
    """Returns whether an SVG element's own `visibility` shows it, first by its style; `None` if it does not say so."""
    said = re.search(r"(?:^|;)\s*visibility\s*:\s*(\w+)", style)
    word = said[1] if said else (element.get("visibility") or "").strip()
    return {"visible": True, "hidden": False, "collapse": False}.get(word)


def _text_of(element: ET.Element) -> tuple[str, str | None, str | None]:
    """Returns the text of a `<text>` element, and its x and y coordinates as written; `None` for missing ones."""
    text = " ".join("".join(element.itertext()).split())
    first = next((each for each in element.iter() if each.get("x") and each.get("y")), element)
    return text, first.get("x"), first.get("y")


def _words(element: ET.Element) -> tuple[str, ...]:
    """Returns the words that may name an element's kind: its classes, then names that programs show, then its id."""
    classes = element.get("class")
    if classes and is_ifc_container(classes):  # the name of a house says nothing of its beams
        return (classes,)
    label, name = element.get(f"{_INKSCAPE}label"), element.get("data-name")
    given = (classes, element.get("data-kind"), label, name, _ifc_name(element), element.get("id"))
    return tuple(word for word in given if word)


def _ifc_name(element: ET.Element) -> str | None:
    """Returns the `ifc:name` attribute that converters of IFC write; `None` without one."""
    return next((value for key, value in element.attrib.items() if _IFC_NAME.fullmatch(key)), None)


_IFC_NAME = re.compile(r"\{[^}]*ifc[^}]*\}name", re.IGNORECASE)


def _shown_names(element: ET.Element) -> tuple[str | None, ...]:
    """Returns the names that people gave an SVG element, the most important first; `None` for each it does not have."""
    title = next((child.text for child in element if _tag(child) == "title"), None)
    return element.get("data-name"), element.get(f"{_INKSCAPE}label"), title, _ifc_name(element)


def _name(element: ET.Element) -> str:
    given = (*_shown_names(element), element.get("id"))
    return " ".join(next((word for word in given if word), "").split())


def _group_name(element: ET.Element, tag: str) -> str:
    """Returns the name of a group that is one object. Ids count for `<use>` only, as others are often generated."""
    if element.get(f"{_INKSCAPE}groupmode") == "layer":
        return ""
    given = (*_shown_names(element), element.get("id") if tag == "use" else None)
    name = " ".join(next((word for word in given if word), "").split())
    return name if names_one(name) else ""


def _sort(element: ET.Element, around: Sequence[str]) -> str:
    """Returns the name under which ignored SVG elements of the same tag, and class or group, are counted."""
    said = element.get("class") or next(iter(around), "")
    return f'<{_tag(element)}> in "{" ".join(said.split())[:_LONGEST]}"' if said else f"<{_tag(element)}>"


def _tag(element: ET.Element) -> str:
    """Returns the tag of an SVG element without its namespace; empty for other vocabularies and for comments."""
    if not isinstance(element.tag, str):
        return ""
    space, _, tag = element.tag.rpartition("}")
    return tag if space + "}" == _SVG or not space else ""
