"""Parser from YAML text to a tree of nodes with their places (line and column).

Scalars are those of YAML 1.2's core schema, so `no` is text and `010` is ten; JSON is valid YAML, too. These are
errors, with their place: duplicate keys, keys that are not text, tags, several documents, numbers that JSON does not
have, and texts that are too large or nested too deeply. Anchors and aliases work; the total number of nodes from
aliases is limited.
"""

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any, NoReturn, Protocol, TypeAlias, TypeGuard, cast

from ruamel.yaml import YAML
from ruamel.yaml.error import MarkedYAMLError, YAMLError
from ruamel.yaml.events import AliasEvent, MappingStartEvent, NodeEvent, ScalarEvent, SequenceStartEvent

from ..wire.errors import Place, Problem, SpecError
from ..wire.request_problems import Location

MAX_BYTES = 1024 * 1024
MAX_DEPTH = 64
MAX_NODES = 100_000

_INTEGER = re.compile(r"[-+]?[0-9]+")
_BASED_INTEGER = re.compile(r"0o[0-7]+|0x[0-9a-fA-F]+")
_FLOAT = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?")
_NOT_FINITE = re.compile(r"[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN)")
_WORDS: dict[str, bool | None] = {
    **dict.fromkeys(("", "~", "null", "Null", "NULL")),
    **dict.fromkeys(("true", "True", "TRUE"), True),
    **dict.fromkeys(("false", "False", "FALSE"), False),
}


class _Mark(Protocol):
    """Used attributes of a position in the text; ruamel's classes have no attribute types."""

    line: int
    column: int


class _Event(Protocol):
    """Used attributes of a parser event that begins a node."""

    anchor: str | None
    start_mark: _Mark


class _ScalarEvent(_Event, Protocol):
    value: str
    style: str | None


class _Mistake(Protocol):
    """Used attributes of ruamel's `MarkedYAMLError`."""

    context: str | None
    context_mark: _Mark | None
    problem: str | None
    problem_mark: _Mark | None


class _Parser(Protocol):
    def parse(self, stream: str, /) -> Iterator[object]: ...


@dataclass(frozen=True)
class ScalarNode:
    """A scalar of a parsed YAML or JSON file (text, number, boolean or null), with its line and column."""

    place: Place
    value: str | int | float | bool | None
    source: str
    """Original characters, without quotes."""


@dataclass(frozen=True)
class ListNode:
    """A list of a parsed YAML or JSON file, with its line and column."""

    place: Place
    items: tuple["Node", ...]


@dataclass(frozen=True)
class MappingNode:
    """A mapping of a parsed YAML or JSON file with text keys, with its line and column."""

    place: Place
    entries: dict[str, "Node"]
    key_places: dict[str, Place]


Node: TypeAlias = ScalarNode | ListNode | MappingNode


def plain(node: Node) -> Any:
    """Converts a parsed node to plain Python values."""
    if isinstance(node, MappingNode):
        return {key: plain(value) for key, value in node.entries.items()}
    if isinstance(node, ListNode):
        return [plain(item) for item in node.items]
    return node.value


def child(node: Node, step: str | int) -> Node | None:
    """Returns a mapping's entry or a list's item; `None` if the node has none."""
    if isinstance(node, MappingNode) and isinstance(step, str):
        return node.entries.get(step)
    if isinstance(node, ListNode) and isinstance(step, int) and 0 <= step < len(node.items):
        return node.items[step]
    return None


def node_at(node: Node | None, location: Location) -> Node | None:
    """Returns the value at a location below a node; `None` if there is none."""
    for step in location:
        node = child(node, step) if node is not None else None
    return node


def value_place(node: Node, location: Location) -> Place:
    """Returns the line and column of the value at a location; if the value is missing, those of its parent's key."""
    place = node.place
    for step in location:
        following = child(node, step)
        if following is None:
            return place
        place, node = key_place(node, (step,)), following
    return node.place


def key_place(node: Node, location: Location) -> Place:
    """Returns the line and column of the key at a location; for list items, those of the item."""
    for step in location[:-1]:
        following = child(node, step)
        if following is None:
            return node.place
        node = following
    last = location[-1] if location else ""
    if isinstance(node, MappingNode) and last in node.key_places:
        return node.key_places[str(last)]
    following = child(node, last)
    return following.place if following is not None else node.place


def parse(text: str, filename: str) -> Node:
    """Parses a YAML or JSON document into nodes that know their line and column.

    Args:
        text: The document.
        filename: File name for places.

    Raises:
        SpecError: The text cannot be read; reading stops at the first problem.
    """
    start = Place(filename, 1, 1)
    if len(text.encode(errors="surrogatepass")) > MAX_BYTES:
        raise SpecError([Problem(start, "", f"the file is larger than {MAX_BYTES // 1024} KiB")])
    try:
        # The parser in C follows YAML 1.1 and takes no `arn:aws:…` without quotes inside braces.
        return _Reader(filename, cast("_Parser", YAML(typ="safe", pure=True)).parse(text)).document()
    except MarkedYAMLError as error:
        mistake = cast("_Mistake", error)
        mark = mistake.problem_mark or mistake.context_mark
        place = Place(filename, mark.line + 1, mark.column + 1) if mark else start
        message = ", ".join(part for part in (mistake.context, mistake.problem) if part)
        if "'\\t'" in message:
            message += "; indent with spaces, not with tabs"
        if "${{" in "".join(text.splitlines()[place.line - 1 : place.line]):  # the mark may be behind the last line
            message += '; inside braces or brackets a reference needs quotes: "${{ … }}"'
        raise SpecError([Problem(place, "", f"this is not YAML: {message}")]) from error
    except YAMLError as error:
        first_line = str(error).splitlines()[0]
        raise SpecError([Problem(start, "", f"this is not YAML: {first_line}")]) from error


class _Reader:
    """Builder of nodes from the YAML parser's events."""

    def __init__(self, filename: str, events: Iterator[object]) -> None:
        self._filename = filename
        self._events = events
        self._anchors: dict[str, tuple[Node, int]] = {}
        self._count = 0

    def document(self) -> Node:
        """Reads the file's only document.

        Raises SpecError if the file is empty or has several documents.
        """
        root: Node | None = None
        for event in self._events:
            if _is_node(event):
                if root is not None:
                    self._refuse(event, "a file holds one document; remove what follows the second '---'")
                root = self._node(event, 0)
        if root is None:
            raise SpecError([Problem(Place(self._filename, 1, 1), "", "the file is empty")])
        return root

    def _node(self, event: _Event, depth: int) -> Node:
        if isinstance(event, AliasEvent):
            return self._alias(event)
        anchor, before = event.anchor, self._count
        self._add(1, event)
        if depth > MAX_DEPTH:
            self._refuse(event, f"nested more than {MAX_DEPTH} deep")
        if (tag := getattr(event, "tag", None)) is not None:
            self._refuse(event, f"tags such as {tag} are not allowed")
        if isinstance(event, MappingStartEvent):
            node: Node = self._mapping(event, depth)
        elif isinstance(event, SequenceStartEvent):
            node = ListNode(self._place(event), tuple(self._node(each, depth + 1) for each in self._children()))
        else:
            node = self._scalar(cast("_ScalarEvent", event))  # nothing else begins a node
        if anchor is not None:
            self._anchors[anchor] = (node, self._count - before)
        return node

    def _children(self) -> Iterator[_Event]:
        """Yields the events that begin the children of a collection, up to its end."""
        while _is_node(event := next(self._events)):
            yield event

    def _mapping(self, event: _Event, depth: int) -> MappingNode:
        entries: dict[str, Node] = {}
        places: dict[str, Place] = {}
        for key_event in self._children():
            key = self._key(key_event)
            if key in entries:
                self._refuse(key_event, f"{key!r} is there twice; the first is at line {places[key].line}")
            places[key] = self._place(key_event)
            value = cast("_Event", next(self._events))  # the parser gives each key one
            node = self._node(value, depth + 1)
            # YAML places a value that is not there at whatever comes next, perhaps lines below.
            if isinstance(node, ScalarNode) and node.value is None and not node.source:
                node = replace(node, place=places[key])
            entries[key] = node
        return MappingNode(next(iter(places.values()), self._place(event)), entries, places)

    def _key(self, event: _Event) -> str:
        if not _is_scalar(event):
            is_braced = isinstance(event, MappingStartEvent) and bool(getattr(event, "flow_style", False))
            hint = "; a reference is written ${{ … }}, with the dollar" if is_braced else ""
            self._refuse(event, f"a key has to be plain text{hint}")
        if event.value == "<<" and event.style is None:
            self._refuse(event, "merge keys (<<) are not part of YAML 1.2; repeat the entries, or alias a whole value")
        return self._text(event)

    def _alias(self, event: _Event) -> Node:
        if event.anchor not in self._anchors:
            self._refuse(event, f"there is no anchor &{event.anchor} before this alias")
        node, size = self._anchors[event.anchor]
        self._add(size, event)
        return node

    def _scalar(self, event: _ScalarEvent) -> ScalarNode:
        text = self._text(event)
        value = self._plain_value(event, text) if event.style is None else text
        return ScalarNode(self._place(event), value, text)

    def _text(self, event: _ScalarEvent) -> str:
        """Returns the text of a scalar, with JSON's surrogate escape pairs combined to one character.

        Raises SpecError if it holds half of a surrogate pair.
        """
        try:
            return event.value.encode("utf-16", "surrogatepass").decode("utf-16")
        except UnicodeDecodeError:
            self._refuse(event, "holds half of a surrogate pair, which is no character")

    def _plain_value(self, event: _Event, text: str) -> str | int | float | bool | None:
        if text in _WORDS:
            return _WORDS[text]
        if len(text) <= 400:
            if _INTEGER.fullmatch(text):
                return int(text)
            if _BASED_INTEGER.fullmatch(text):
                return int(text[2:], 8 if text[1] == "o" else 16)
            if _FLOAT.fullmatch(text) and math.isfinite(number := float(text)):
                return number
        if _NOT_FINITE.fullmatch(text) or _FLOAT.fullmatch(text):
            self._refuse(event, f"{text[:40]} is not a number that JSON has")
        return text

    def _add(self, count: int, event: _Event) -> None:
        self._count += count
        if self._count > MAX_NODES:
            self._refuse(event, f"more than {MAX_NODES} values, aliases counted in full")

    def _place(self, event: _Event) -> Place:
        mark = event.start_mark
        return Place(self._filename, mark.line + 1, mark.column + 1)

    def _refuse(self, event: _Event, message: str) -> NoReturn:
        raise SpecError([Problem(self._place(event), "", message)])


def _is_node(event: object) -> TypeGuard[_Event]:
    return isinstance(event, NodeEvent)


def _is_scalar(event: object) -> TypeGuard[_ScalarEvent]:
    return isinstance(event, ScalarEvent)
