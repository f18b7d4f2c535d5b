"""References in a specification: `${{ expression }}`, JMESPath over the outputs of earlier steps.

A text that is one reference becomes the value it refers to, of any kind; inside a longer text
a reference is replaced by the value's text. `$${{` stands for `${{` itself.
"""

import json
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from datetime import datetime
from functools import lru_cache
from typing import Any

import jmespath
from jmespath.exceptions import JMESPathError
from jmespath.visitor import TreeInterpreter

from ..wire.json_values import is_list, is_mapping
from ..wire.request_problems import first_words, nearest_ones
from .reference_typing import TEXT, Anything, Kind, Record, ReferenceMistake, Scalar, infer

MAX_WORK = 1_000_000
"""Maximum number of evaluation steps and values of an expression: a second or two, a hundred times what normal ones
need.
"""

PARAMETERS = "parameters"
"""Name of a specification's member that declares parameters, and by which references reach their values."""

_CHARACTERS = 64  # of text that count as one value


class TooMuchWorkError(Exception):
    """Raised when evaluating a JMESPath expression takes too many steps or makes too much data."""


def bounded_search(tree: Mapping[str, Any], scope: Mapping[str, Any], interpreter: "Interpreter | None" = None) -> Any:
    """Evaluates a JMESPath expression with a limit on the work, for expressions from untrusted files.

    Args:
        tree: Parsed expression, `jmespath.compile(…).parsed`.
        scope: Value on which it is evaluated.
        interpreter: Interpreter that limits several expressions together; `None`: a new one.

    Raises:
        JMESPathError: The expression cannot be evaluated.
        TooMuchWorkError: The evaluation would need more than `MAX_WORK` steps.
    """
    return (interpreter or Interpreter()).visit(tree, scope)


class Interpreter(TreeInterpreter):  # pyright: ignore[reportUntypedBaseClass] - jmespath has no types
    """JMESPath interpreter with a limit of `MAX_WORK` evaluation steps and values in total."""

    def __init__(self) -> None:
        super().__init__()
        self._left = MAX_WORK

    def visit(self, node: Any, *args: Any, **kwargs: Any) -> Any:
        """Evaluates a node of a JMESPath expression, and counts it as work."""
        self._spend(1)
        value: Any = super().visit(node, *args, **kwargs)
        # Only these make values that were not there before; a list of one value twice counts it twice.
        if node["type"] in ("multi_select_list", "multi_select_dict", "flatten", "function_expression"):
            self._count(value)
        return value

    def _count(self, value: Any) -> None:
        waiting = [value]
        while waiting:
            each = waiting.pop()
            self._spend(1 + len(each) // _CHARACTERS if isinstance(each, str) else 1)
            if is_mapping(each):
                waiting.extend(each.values())
            elif is_list(each):
                waiting.extend(each)

    def _spend(self, work: int) -> None:
        self._left -= work
        if self._left < 0:
            raise TooMuchWorkError


MAX_EXPRESSION_CHARACTERS = 2000
_OPENING = re.compile(r"\$?\$\{\{")


@dataclass(frozen=True)
class Reference:
    """A `${...}` reference in a specification's text: a JMESPath expression over the outputs of earlier steps."""

    expression: str
    tree: Mapping[str, Any]

    def names(self) -> set[str]:
        """Returns the names of the steps and variables that a reference's expression uses."""
        return set(_names(self.tree, outermost=True))

    def kind(self, scope: Mapping[str, Kind]) -> Kind:
        """Returns the type of the reference's value, given the types of the steps and variables.

        Raises:
            ReferenceMistake: It cannot work.
        """
        if unknown := sorted(self.names() - scope.keys()):
            if unknown[0] == PARAMETERS:
                raise ReferenceMistake("there are no parameters: the specification declares none")
            hint = nearest_ones(unknown[0], scope)
            if not hint:
                steps = [name for name in scope if name != PARAMETERS]
                hint = f"; there are {first_words(steps)}" if steps else "; this file has no steps to refer to"
            raise ReferenceMistake(f"there is no step or variable {unknown[0]!r}{hint}")
        return infer(self.tree, Record(scope))

    def value(self, scope: Mapping[str, Any], interpreter: Interpreter | None = None) -> Any:
        """Evaluates the reference, given the values of the steps and variables.

        Args:
            scope: Values of the steps and variables.
            interpreter: Interpreter that limits several references together; `None`: a new one.

        Raises:
            ReferenceMistake: The expression has no value, or cannot be evaluated.
        """
        try:
            found = bounded_search(self.tree, scope, interpreter)
        except JMESPathError as error:
            raise ReferenceMistake(f"{self.expression}: {_first_line(error)}") from error
        except TooMuchWorkError:
            raise ReferenceMistake(f"{self.expression}: it makes too much; use less of what it refers to") from None
        if found is None:
            raise ReferenceMistake(f"{self.expression} gives nothing: the output has no such value")
        return found


@dataclass(frozen=True)
class Template:
    """A text of a specification, split into plain text and `${...}` references."""

    parts: tuple[str | Reference, ...]

    @property
    def references(self) -> tuple[Reference, ...]:
        """The `${{ }}` references in the text, in order."""
        return tuple(part for part in self.parts if isinstance(part, Reference))

    @property
    def whole(self) -> Reference | None:
        """The single reference if the text consists of nothing else; `None` otherwise."""
        return part if len(self.parts) == 1 and isinstance(part := self.parts[0], Reference) else None

    def kind(self, scope: Mapping[str, Kind]) -> Kind:
        """Returns the type of the text's value, given the types of the steps and variables.

        Raises:
            ReferenceMistake: It cannot work.
        """
        if self.whole:
            return self.whole.kind(scope)
        for reference in self.references:
            kind = reference.kind(scope)
            if not isinstance(kind, Scalar | Anything):
                raise ReferenceMistake(f"{reference.expression} is {kind}; only single values can stand inside text")
        return TEXT

    def value(self, scope: Mapping[str, Any], interpreter: Interpreter | None = None) -> Any:
        """Replaces the references by their values; a text that is one single reference keeps its value's type.

        Args:
            scope: Values of the steps and variables.
            interpreter: Interpreter that limits several texts together; `None`: a new one for each reference.

        Raises:
            ReferenceMistake: A reference gives nothing, or something that cannot stand inside text.
        """
        if self.whole:
            return self.whole.value(scope, interpreter)
        return "".join(
            part if isinstance(part, str) else _as_text(part.expression, part.value(scope, interpreter))
            for part in self.parts
        )


@lru_cache(maxsize=4096)
def parse_template(text: str) -> Template:
    """Splits a specification's text into plain text and `${...}` references.

    Raises:
        ReferenceMistake: A reference is not closed, or is no JMESPath expression.
    """
    parts: list[str | Reference] = []
    position = 0
    while opening := _OPENING.search(text, position):
        parts.append(text[position : opening.start()])
        if opening.group().startswith("$$"):
            parts.append("${{")
            position = opening.end()
        else:
            reference, position = _reference(text, opening.end())
            parts.append(reference)
    parts.append(text[position:])
    return Template(tuple(_joined(parts)))


def _joined(parts: list[str | Reference]) -> Iterator[str | Reference]:
    """Removes empty parts; an empty text keeps one."""
    kept = [part for part in parts if part != ""]
    yield from kept or [""]


def _reference(text: str, start: int) -> tuple[Reference, int]:
    """Parses a reference up to its `}}`, and returns it with the position after it.

    The first `}}` that completes an expression ends it, as `}}` may be part of it. Raises ReferenceMistake if none
    does.
    """
    mistake: JMESPathError | None = None
    end = text.find("}}", start)
    while 0 <= end <= start + MAX_EXPRESSION_CHARACTERS:
        expression = text[start:end].strip()
        try:
            return Reference(expression, jmespath.compile(expression).parsed), end + 2
        except JMESPathError as error:
            mistake = mistake or error
        except RecursionError:
            raise ReferenceMistake("the JMESPath expression is nested too deeply") from None
        end = text.find("}}", end + 1)
    if mistake is None:
        limit = f" within {MAX_EXPRESSION_CHARACTERS} characters"
        raise ReferenceMistake(f"a reference begins with ${{{{ and is not closed with }}}}{limit if end >= 0 else ''}")
    hint = (
        '; a name with other characters than letters, digits and _ needs quotes: "…"' if "'-'" in str(mistake) else ""
    )
    raise ReferenceMistake(f"not a JMESPath expression: {_first_line(mistake)}{hint}") from mistake


def _first_line(error: JMESPathError) -> str:
    return str(error).splitlines()[0].removeprefix("Bad jmespath expression: ").removesuffix(":")


def _names(tree: Mapping[str, Any], *, outermost: bool) -> Iterator[str]:
    """Yields the fields that are looked up in the outermost scope: not those after a dot, a pipe or a projection."""
    if outermost and tree["type"] in ("field", "current"):
        yield tree.get("value", "@")
    inner = tree["type"] in _NARROWING
    for position, part in enumerate(tree["children"]):
        if is_mapping(part):
            yield from _names(part, outermost=outermost and not (inner and position > 0) and part["type"] != "expref")


# In these, only the first part sees the outermost scope.
_NARROWING = {
    "subexpression",
    "index_expression",
    "pipe",
    "projection",
    "filter_projection",
    "value_projection",
}


def _as_text(expression: str, value: Any) -> str:
    if isinstance(value, str):
        return value
    if isinstance(value, datetime):
        return value.isoformat()
    if isinstance(value, bool | int | float):
        return json.dumps(value)
    raise ReferenceMistake(f"{expression} is a {type(value).__name__}; only single values can stand inside text")
