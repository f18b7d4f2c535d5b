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

import re
from collections.abc import Callable, Iterable

_TOKEN = re.compile(
    r"(?P<stars>\*\*?)|\[(?P<unwanted>!?)(?P<members>(?:\\.|[^]\\])*)]|\\(?P<quoted>.)|(?P<plain>.)", re.DOTALL
)
_RANGE = re.compile(r"\\?(.)(?:-\\?(.))?", re.DOTALL)
_SPECIAL = re.compile(r"[*?[{\\]")
_MAX_DEPTH = 20

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
        self._edges: list[list[tuple[Accepts | None, int]]] = [[]]
        """Of each state, the ways to others; those without a test take no character."""
        self._end = self._parse()
        self._start = self._closure({0})

    def matches(self, path: str) -> bool:
        """Whether a path matches, as a whole."""
        return self._end in self._after(path)

    def may_match_below(self, folder: str) -> bool:
        """Whether a path that begins with a folder's path and `/` could match."""
        return bool(self._after(f"{folder}/"))

    @property
    def fixed_folder(self) -> str:
        """The folder that all matches are in: what is in front of the last `/` before anything special."""
        return _SPECIAL.split(self.text, maxsplit=1)[0].rpartition("/")[0]

    def _after(self, text: str) -> frozenset[int]:
        """The states that are reached by a text from the start."""
        states = self._start
        for character in text:
            edges = (edge for state in states for edge in self._edges[state])
            states = self._closure({target for accepts, target in edges if accepts is not None and accepts(character)})
            if not states:
                break
        return states

    def _closure(self, states: Iterable[int]) -> frozenset[int]:
        """States, and those that are reached from them without a character."""
        found, waiting = set(states), list(states)
        while waiting:
            for accepts, target in self._edges[waiting.pop()]:
                if accepts is None and target not in found:
                    found.add(target)
                    waiting.append(target)
        return frozenset(found)

    def _parse(self) -> int:
        """Builds the automaton from left to right; returns the state at the end."""
        state = 0
        groups: list[tuple[int, int]] = []  # of each open `{`: the states before and behind it
        for token in _TOKEN.finditer(self.text):
            character = token["plain"] or ""
            if character in {"{", "}"} or (character == "," and groups):
                state = self._group(state, character, groups)
            elif token["stars"]:
                state = self._to_new(state, None)
                self._edges[state].append((_any if token["stars"] == "**" else _within_folder, state))
            else:
                state = self._to_new(state, self._one(token))
        self._require(not groups, "has a '{' without a '}'")
        return state

    def _group(self, state: int, character: str, groups: list[tuple[int, int]]) -> int:
        """Begins alternatives, goes on to the next, or ends them."""
        if character == "{":
            self._require(len(groups) < _MAX_DEPTH, f"has more than {_MAX_DEPTH} '{{' within each other")
            self._edges.append([])
            groups.append((state, len(self._edges) - 1))
            return state
        self._require(groups, "has a '}' without a '{'; write '\\}' for the character")
        before, behind = groups[-1] if character == "," else groups.pop()
        self._edges[state].append((None, behind))
        return before if character == "," else behind

    def _one(self, token: re.Match[str]) -> Accepts:
        """The test of a token that stands for one character."""
        if token["members"] is not None:
            self._require(token["members"], "has a '[]' without characters")
            return self._class(token["members"], unwanted=token["unwanted"] == "!")
        self._require(token["plain"] != "[", "has a '[' without a ']'")
        self._require(token["plain"] != "\\", "ends with a backslash")
        return _within_folder if token["plain"] == "?" else (token["plain"] or token["quoted"]).__eq__

    def _class(self, members: str, *, unwanted: bool) -> Accepts:
        ranges = [(low, high or low) for low, high in _RANGE.findall(members)]
        for low, high in ranges:
            self._require(low <= high, f"has the range {low}-{high}, which is the wrong way round")
        return lambda character: any(low <= character <= high for low, high in ranges) is not unwanted

    def _to_new(self, state: int, accepts: Accepts | None) -> int:
        """Leads from a state to a new one."""
        self._edges.append([])
        self._edges[state].append((accepts, len(self._edges) - 1))
        return len(self._edges) - 1

    def _require(self, is_so: object, problem: str) -> None:
        if not is_so:
            raise GlobError(f"{self.text!r} {problem}")


def _any(character: str) -> bool:
    del character
    return True


def _within_folder(character: str) -> bool:
    return character != "/"
