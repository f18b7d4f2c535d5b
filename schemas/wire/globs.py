r"""Globs as upload configurations have them: those of the Go library gobwas/glob, with `/` between folders.

| in a glob | matches |
| --- | --- |
| `*` | any characters but `/`, or none |
| `**` | any characters, or none: crosses folders |
| `?` | one character that is not `/` |
| `[abc]`, `[a-z]`, `[!abc]`, `[!a-z]` | one character of these, or none of these |
| `{one,two*}` | one of several globs, which may hold others |
| `\*` | the character behind the backslash as it is |

A glob becomes a nondeterministic automaton that is followed for all its states at once, so that no glob, however
twisted, takes longer than its length times that of the path.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

_SPECIAL = frozenset("*?[{\\")

Accepts = Callable[[str], bool]
"""Whether a character leads on."""


class GlobError(ValueError):
    """A glob that is none; the message says what is wrong with it."""


class Glob:
    """A compiled glob.

    Args:
      text: the glob.

    Raises:
      GlobError: it is none.
    """

    def __init__(self, text: str) -> None:
        self.text = text
        self._automaton = _Automaton()
        self._end = _Parser(text, self._automaton).parse()
        self._start = self._automaton.closure({0})

    def matches(self, path: str) -> bool:
        """Whether a path matches, as a whole."""
        return self._end in self._after(path)

    def may_match_below(self, folder: str) -> bool:
        """Whether a path that begins with a folder's path and `/` could match."""
        return bool(self._after(f"{folder}/"))

    def _after(self, text: str) -> frozenset[int]:
        states = self._start
        for character in text:
            states = self._automaton.step(states, character)
            if not states:
                break
        return states

    @property
    def fixed_folder(self) -> str:
        """The folder that all matches are in: what is in front of the last `/` before anything special."""
        end = next((place for place, character in enumerate(self.text) if character in _SPECIAL), len(self.text))
        return self.text[:end].rpartition("/")[0]


@dataclass(frozen=True)
class _Edge:
    """A way from one state to another."""

    accepts: Accepts | None
    """`None`: without a character."""
    target: int


class _Automaton:
    """States by number, from 0, and the ways between them."""

    def __init__(self) -> None:
        self._edges: list[list[_Edge]] = [[]]

    def state(self) -> int:
        """Adds a state."""
        self._edges.append([])
        return len(self._edges) - 1

    def lead(self, source: int, target: int, accepts: Accepts | None = None) -> None:
        """Adds a way."""
        self._edges[source].append(_Edge(accepts, target))

    def closure(self, states: set[int]) -> frozenset[int]:
        """The states, and those that are reached from them without a character."""
        found, open_states = set(states), list(states)
        while open_states:
            for edge in self._edges[open_states.pop()]:
                if edge.accepts is None and edge.target not in found:
                    found.add(edge.target)
                    open_states.append(edge.target)
        return frozenset(found)

    def step(self, states: frozenset[int], character: str) -> frozenset[int]:
        """The states that a character leads to."""
        edges = (edge for state in states for edge in self._edges[state])
        return self.closure({edge.target for edge in edges if edge.accepts is not None and edge.accepts(character)})


class _Parser:
    """Builds the automaton of a glob, from left to right."""

    def __init__(self, text: str, automaton: _Automaton) -> None:
        self._text = text
        self._place = 0
        self._automaton = automaton

    def parse(self) -> int:
        """Returns the state at the end."""
        state = self._sequence(0, depth=0)
        if self._place < len(self._text):
            raise GlobError(f"{self._text!r} has a '}}' without a '{{'; write '\\}}' for the character")
        return state

    def _sequence(self, state: int, depth: int) -> int:
        while self._place < len(self._text):
            character = self._text[self._place]
            if character == "}" or (depth and character == ","):
                break
            self._place += 1
            state = self._piece(state, character, depth)
        return state

    def _piece(self, state: int, character: str, depth: int) -> int:
        if character == "*":
            crosses = self._text[self._place : self._place + 1] == "*"
            self._place += crosses
            return self._repeat(state, _any if crosses else _within_folder)
        if character == "?":
            return self._one(state, _within_folder)
        if character == "[":
            return self._one(state, self._character_class())
        if character == "{":
            return self._alternatives(state, depth + 1)
        return self._one(state, self._next("\\").__eq__ if character == "\\" else character.__eq__)

    def _one(self, state: int, accepts: Accepts) -> int:
        after = self._automaton.state()
        self._automaton.lead(state, after, accepts)
        return after

    def _repeat(self, state: int, accepts: Accepts) -> int:
        again = self._automaton.state()
        self._automaton.lead(state, again)
        self._automaton.lead(again, again, accepts)
        return again

    def _alternatives(self, state: int, depth: int) -> int:
        if depth > 20:
            raise GlobError(f"{self._text!r} has more than 20 '{{' within each other")
        after = self._automaton.state()
        while True:
            start = self._automaton.state()
            self._automaton.lead(state, start)
            self._automaton.lead(self._sequence(start, depth), after)
            if self._next("{") == "}":
                return after

    def _character_class(self) -> Accepts:
        unwanted = self._text[self._place : self._place + 1] == "!"
        self._place += unwanted
        ranges = list(self._ranges())
        if not ranges:
            raise GlobError(f"{self._text!r} has a '[]' without characters")
        return lambda character: any(low <= character <= high for low, high in ranges) is not unwanted

    def _ranges(self) -> Iterator[tuple[str, str]]:
        while (low := self._next("[")) != "]":
            low = self._next("\\") if low == "\\" else low
            high = low
            if (
                self._text[self._place : self._place + 1] == "-"
                and self._text[self._place + 1 : self._place + 2] != "]"
            ):
                self._place += 1
                high = self._next("[")
                high = self._next("\\") if high == "\\" else high
            if high < low:
                raise GlobError(f"{self._text!r} has the range {low}-{high}, which is the wrong way round")
            yield low, high

    def _next(self, opened: str) -> str:
        if self._place >= len(self._text):
            closing = {"[": "]", "{": "}"}.get(opened)
            raise GlobError(
                f"{self._text!r} has a {opened!r} without a {closing!r}"
                if closing
                else f"{self._text!r} ends with a backslash"
            )
        self._place += 1
        return self._text[self._place - 1]


def _any(character: str) -> bool:
    del character
    return True


def _within_folder(character: str) -> bool:
    return character != "/"
