"""Parser of signal temporal logic formulas, and their output as text.

Example: `always (clearance < 0.5 -> speed < 0.3)`. Formulas are comparisons of numbers, joined by `not`, `and`, `or`,
`->`, and by `always`, `eventually` and `until`, which may have bounds in seconds, `eventually[0, 3]`. Precedence from
high to low: arithmetic, comparisons, `not` with `always` and `eventually`, `until`, `and`, `or`, `->`.
"""

import re
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, field
from typing import TypeAlias

from ..wire.request_problems import nearest

MAX_DEPTH = 30
"""Maximum depth of nested formulas, since parsing and judging use the stack."""

_TOKEN = re.compile(
    r"\s*(?:(?P<number>(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d{1,2})?)|(?P<name>[a-zA-Z_]\w*)"
    r"|(?P<sign>->|<=|>=|==|!=|[-+*<>()\[\],:=&|!/]))"
)
_WORDS = ("not", "and", "or", "always", "eventually", "until", "abs")
_COMPARISONS = ("<", "<=", ">", ">=")
_OTHERS = {"=": "<= or >=", "==": "abs(a - b) < 0.1", "!=": "abs(a - b) > 0.1", "&": "and", "|": "or", "!": "not"}
"""Operators of other languages, each with its replacement here. Two measured numbers are never equal."""
_OTHERS["/"] = "* 0.5 for / 2"

Bounds: TypeAlias = tuple[float, float]
"""Begin and end of a time interval in seconds from now, both included."""


class FormulaError(ValueError):
    """Raised for a temporal logic formula (requirement) that cannot be parsed; says where and what would be right."""


@dataclass(frozen=True)
class Number:
    """Node of a formula: a number, or the value of a signal."""

    value: float | str


@dataclass(frozen=True)
class Arithmetic:
    """Node of a formula: `+`, `-` or `*` of two numbers, or `abs` of one."""

    sign: str
    parts: tuple["Number | Arithmetic", ...]


@dataclass(frozen=True)
class Comparison:
    """Node of a formula: a comparison of two numbers."""

    sign: str
    left: Number | Arithmetic
    right: Number | Arithmetic


@dataclass(frozen=True)
class Join:
    """Node of a formula: `not`, `and`, `or` or `->`."""

    word: str
    parts: tuple["Formula", ...]


@dataclass(frozen=True)
class Temporal:
    """Node of a formula: `always`, `eventually` or `until`, with time bounds or until the run ends."""

    word: str
    parts: tuple["Formula", ...]
    bounds: Bounds | None = None


Formula: TypeAlias = Comparison | Join | Temporal
_Node: TypeAlias = Number | Arithmetic | Comparison | Join | Temporal


def read_formula(text: str, signals: Collection[str]) -> Formula:
    """Parses a temporal logic formula over signals of a run.

    Args:
        text: The formula.
        signals: Names of the signals that it may use.

    Raises:
        FormulaError: The text is not a formula, uses an unknown signal, or uses no signal, so that it does not depend
            on the run.
    """
    formula = _Reader(text, signals).read()
    if not set(signals_of(formula)):
        raise FormulaError(f"it uses no signal, so it could not be missed; there are {', '.join(signals)}")
    return formula


def signals_of(node: _Node) -> Iterator[str]:
    """Yields the names of the signals in a formula, each as often as it is used."""
    if isinstance(node, Number):
        if isinstance(node.value, str):
            yield node.value
        return
    for part in (node.left, node.right) if isinstance(node, Comparison) else node.parts:
        yield from signals_of(part)


def bounds_of(formula: Formula) -> Iterator[Bounds]:
    """Yields all time bounds in a temporal logic formula."""
    if isinstance(formula, Comparison):
        return
    if isinstance(formula, Temporal) and formula.bounds is not None:
        yield formula.bounds
    for part in formula.parts:
        yield from bounds_of(part)


def in_words(node: _Node) -> str:
    """Formats a temporal logic formula as text, with all brackets: `always[0, 10] ((x + y) < 2)`."""
    if isinstance(node, Number):
        return node.value if isinstance(node.value, str) else f"{node.value:g}"
    if isinstance(node, Comparison):
        return f"{in_words(node.left)} {node.sign} {in_words(node.right)}"
    parts = [in_words(part) for part in node.parts]
    if isinstance(node, Arithmetic):
        return f"abs({parts[0]})" if node.sign == "abs" else f"({parts[0]} {node.sign} {parts[1]})"
    bounds = getattr(node, "bounds", None)
    word = node.word if bounds is None else f"{node.word}[{bounds[0]:g}, {bounds[1]:g}]"
    return f"{word} ({parts[0]})" if len(parts) == 1 else f"({parts[0]}) {word} ({parts[1]})"


@dataclass
class _Reader:
    """Recursive-descent parser of a formula, which reads each token once."""

    text: str
    signals: Collection[str]
    depth: int = 0
    at: int = 0
    tokens: list[tuple[str, str, int]] = field(default_factory=list[tuple[str, str, int]])
    """Kind, text and column of each token."""

    def read(self) -> Formula:
        place = 0
        end = len(self.text.rstrip())
        while place < end:
            found = _TOKEN.match(self.text, place)
            if found is None:
                column = place + len(self.text[place:]) - len(self.text[place:].lstrip())
                raise FormulaError(f"column {column + 1}: {self.text[column]!r} is no part of a formula")
            self.tokens.append((str(found.lastgroup), found[str(found.lastgroup)], found.start(str(found.lastgroup))))
            place = found.end()
        self.tokens.append(("end", "", end))
        formula = self.formula(self.implication())
        if self.tokens[self.at][0] != "end":
            raise self.wrong("the formula is over here", "join its parts by and, or, until or ->")
        return formula

    def wrong(self, what: str, remedy: str, token: tuple[str, str, int] | None = None) -> FormulaError:
        _, text, column = token or self.tokens[self.at]
        found = f"{text!r}" if text else "the end"
        if text in _OTHERS and token is None:
            remedy = f"write {_OTHERS[text]}"
        return FormulaError(f"column {column + 1}, {found}: {what}; {remedy}")

    def take(self, *texts: str) -> str | None:
        """Returns the next token and advances if it is one of the given texts; else `None`."""
        kind, text, _ = self.tokens[self.at]
        if kind != "end" and text in texts:
            self.at += 1
            return text
        return None

    def formula(self, node: _Node) -> Formula:
        if isinstance(node, Number | Arithmetic):
            said = f"{in_words(node)} is a number, and a formula says yes or no"
            raise self.wrong(said, f"compare it, as in {in_words(node)} < 1")
        return node

    def number(self, node: _Node) -> Number | Arithmetic:
        if not isinstance(node, Number | Arithmetic):
            raise self.wrong(f"{in_words(node)} is no number", "compare and calculate with numbers only")
        return node

    def deeper(self) -> None:
        self.depth += 1
        if self.depth > MAX_DEPTH:
            raise self.wrong(f"it is nested more than {MAX_DEPTH} deep", "make two requirements of it")

    def closed(self, node: _Node) -> _Node:
        if not self.take(")"):
            raise self.wrong("a bracket is open", "close it with )")
        return node

    def implication(self) -> _Node:
        self.deeper()
        node = self.joined("or", lambda: self.joined("and", self.until))
        if self.take("->"):
            node = Join("->", (self.formula(node), self.formula(self.implication())))
        self.depth -= 1
        return node

    def joined(self, word: str, part: Callable[[], _Node]) -> _Node:
        parts = [part()]
        while self.take(word):
            parts[0] = self.formula(parts[0])
            parts.append(self.formula(part()))
        return parts[0] if len(parts) == 1 else Join(word, tuple(self.formula(each) for each in parts))

    def until(self) -> _Node:
        node = self.prefixed()
        if self.take("until"):
            bounds = self.bounds()
            node = Temporal("until", (self.formula(node), self.formula(self.prefixed())), bounds)
            if self.tokens[self.at][1] == "until":
                raise self.wrong("which until comes first is not clear", "put one of them in brackets")
        return node

    def prefixed(self) -> _Node:
        word = self.take("not", "always", "eventually")
        if word is None:
            return self.comparison()
        self.deeper()
        bounds = None if word == "not" else self.bounds()
        part = self.formula(self.prefixed())
        self.depth -= 1
        return Join(word, (part,)) if word == "not" else Temporal(word, (part,), bounds)

    def bounds(self) -> Bounds | None:
        if not self.take("["):
            return None
        first = self.bound()
        if not self.take(",", ":"):
            raise self.wrong("bounds have two numbers", "write [0, 3], seconds from now")
        opening, last = self.tokens[self.at], self.bound()
        if not self.take("]"):
            raise self.wrong("bounds end with ]", "write [0, 3], seconds from now")
        if last < first:
            raise self.wrong(f"the bounds end before they begin, at {first:g}", "write the smaller one first", opening)
        return first, last

    def bound(self) -> float:
        kind, text, _ = self.tokens[self.at]
        if kind != "number":
            raise self.wrong("a bound is a number of seconds", "write [0, 3], or no bounds for the rest of the run")
        self.at += 1
        return float(text)

    def comparison(self) -> _Node:
        left = self.sum()
        sign = self.take(*_COMPARISONS)
        if sign is None:
            if self.tokens[self.at][1] in ("=", "==", "!="):
                raise self.wrong("two measured numbers are never the same", "compare them")
            return left
        comparison = Comparison(sign, self.number(left), self.number(self.sum()))
        if self.tokens[self.at][1] in _COMPARISONS:
            raise self.wrong("a comparison has two sides", "join two of them by and")
        return comparison

    def sum(self) -> _Node:
        node = self.product()
        while (sign := self.take("+", "-")) is not None:
            node = Arithmetic(sign, (self.number(node), self.number(self.product())))
        return node

    def product(self) -> _Node:
        node = self.factor()
        while self.take("*"):
            node = Arithmetic("*", (self.number(node), self.number(self.factor())))
        return node

    def factor(self) -> _Node:
        token = self.tokens[self.at]
        kind, text, _ = token
        if self.take("-"):
            self.deeper()
            node = Arithmetic("-", (Number(0.0), self.number(self.factor())))
            self.depth -= 1
            return node
        if self.take("("):
            return self.closed(self.implication())
        if self.take("abs"):
            if not self.take("("):
                raise self.wrong("abs needs brackets", "write abs(x)")
            return self.closed(Arithmetic("abs", (self.number(self.implication()),)))
        if kind == "number":
            self.at += 1
            return Number(float(text))
        if kind == "name" and text not in _WORDS:
            if text not in self.signals:
                there = nearest(text, [*self.signals, *_WORDS]) or f"; there are {', '.join(self.signals)}"
                raise FormulaError(f"column {token[2] + 1}: there is no signal {text!r}{there}")
            self.at += 1
            return Number(text)
        raise self.wrong("a signal, a number or a bracket has to be here", "write a comparison, as in speed < 1")


def off_grid(formula: Formula, period_s: float) -> Sequence[float]:
    """Returns the time bounds of a formula that are no multiples of the sampling period."""
    ends = [end for bounds in bounds_of(formula) for end in bounds]
    return [end for end in ends if abs(end / period_s - round(end / period_s)) > 1e-6]  # sums of floats are not exact
