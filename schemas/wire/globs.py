r"""Globs of upload configurations: the syntax of the Go library gobwas/glob, with `/` between folders.

| in a glob | matches |
| --- | --- |
| `*` | any characters but `/`, or none |
| `**` | any characters, or none: crosses folders |
| `?` | one character that is not `/` |
| `[abc]`, `[a-z]`, `[!abc]`, `[!a-z]` | one character of these, or none of these |
| `{one,two*}` | one of several globs, which may hold others |
| `\*` | the character behind the backslash as it is |

A glob becomes a regular expression for RE2, which never goes back in a text: no glob, however twisted, takes longer
than its length times that of the path (docs/decisions/0005-globs-and-junit.md).
"""

import re
from collections.abc import Iterator

import re2

_TOKEN = re.compile(
    r"(?P<stars>\*\*?)|\[(?P<unwanted>!?)(?P<members>(?:\\.|[^]\\])*)]|\\(?P<quoted>.)|(?P<plain>.)", re.DOTALL
)
_RANGE = re.compile(r"\\?(.)(?:-\\?(.))?", re.DOTALL)
_SPECIAL = re.compile(r"[*?[{\\]")
_UNENCODABLE = re.compile("[\ud800-\udfff]")
_STARS = {"*": "[^/]*", "**": ".*"}
_MAX_DEPTH = 20
_OPTIONS = re2.Options()
_OPTIONS.log_errors = False
_OPTIONS.dot_nl = True

Piece = tuple[str, str]
"""Regular expressions for a part of a glob, and for the beginnings of its matches."""


class GlobError(ValueError):
    """Raised for an invalid glob pattern; the message says what is wrong with it."""


class Glob:
    """A compiled glob pattern for file paths, as `uploadConfigurations` use it.

    Args:
        text: Glob pattern.

    Raises:
        GlobError: The pattern is not a valid glob.
    """

    def __init__(self, text: str) -> None:
        self.text = text
        self._whole, self._beginning = (re2.compile(each, _OPTIONS) for each in self._parse())

    def matches(self, path: str) -> bool:
        """Whether the whole path matches the pattern."""
        return self._whole.fullmatch(_encodable(path)) is not None

    def may_match_below(self, folder: str) -> bool:
        """Whether some path below a folder could match the pattern, so that the folder has to be searched."""
        return self._beginning.fullmatch(_encodable(f"{folder}/")) is not None

    @property
    def fixed_folder(self) -> str:
        """Folder that contains all matches: the pattern up to the last `/` before its first wildcard."""
        return _SPECIAL.split(self.text, maxsplit=1)[0].rpartition("/")[0]

    def _parse(self) -> Piece:
        """Translates the glob to a regular expression, from left to right.

        Raises an error if its brackets do not match or are nested too deeply.
        """
        groups: list[list[list[Piece]]] = [[[]]]  # of the glob and each open `{`, the alternatives
        for token in _TOKEN.finditer(_encodable(self.text)):
            character = token["plain"]
            if character == "{":
                self._require(len(groups) <= _MAX_DEPTH, f"has more than {_MAX_DEPTH} '{{' within each other")
                groups.append([[]])
            elif character == "}":
                self._require(len(groups) > 1, "has a '}' without a '{'; write '\\}' for the character")
                alternatives = _either(groups.pop())
                groups[-1][-1].append(alternatives)
            elif character == "," and len(groups) > 1:
                groups[-1].append([])
            elif token["stars"]:
                stars = _STARS[token["stars"]]
                groups[-1][-1].append((stars, stars))
            else:
                groups[-1][-1].append((self._one(token), ""))
        self._require(len(groups) == 1, "has a '{' without a '}'")
        return _either(groups[0])

    def _one(self, token: re.Match[str]) -> str:
        """Returns the regular expression of a token that matches one character."""
        if token["members"] is not None:
            self._require(token["members"], "has a '[]' without characters")
            return f"[{'^' if token['unwanted'] else ''}{''.join(self._ranges(token['members']))}]"
        self._require(token["plain"] != "[", "has a '[' without a ']'")
        self._require(token["plain"] != "\\", "ends with a backslash")
        return "[^/]" if token["plain"] == "?" else re.escape(token["plain"] or token["quoted"])

    def _ranges(self, members: str) -> Iterator[str]:
        for low, high in _RANGE.findall(members):
            self._require(not high or low <= high, f"has the range {low}-{high}, which is the wrong way round")
            yield f"{re.escape(low)}-{re.escape(high or low)}"

    def _require(self, is_so: object, problem: str) -> None:
        if not is_so:
            raise GlobError(f"{self.text!r} {problem}")


def _either(alternatives: list[list[Piece]]) -> Piece:
    whole, beginning = zip(*map(_joined, alternatives), strict=True)
    return f"(?:{'|'.join(whole)})", f"(?:{'|'.join(beginning)})"


def _joined(pieces: list[Piece]) -> Piece:
    beginnings = ""
    for whole, beginning in reversed(pieces):
        beginnings = f"(?:{beginning}|{whole}{beginnings})"
    return "".join(whole for whole, _ in pieces), beginnings


def _encodable(text: str) -> str:
    """Replaces invalid bytes of a file name by replacement characters, so that UTF-8 can encode the text."""
    return _UNENCODABLE.sub("\ufffd", text)
