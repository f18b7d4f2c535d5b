"""Parameters of a specification: their declarations, allowed values, and the values of a run.

```yaml
parameters:
  robot: {type: string, default: scout, description: "Robot application that drives."}
  worlds: {type: integer, minimum: 1, default: 4}
  arm: {enum: [a, b]}
```

Declarations use the keywords of JSON Schema. `folding.fold_parameters` replaces references by the values.
"""

import keyword
import math
import re
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Annotated, Any, Literal

from pydantic import Field, TypeAdapter, ValidationError, WithJsonSchema
from pydantic_core import SchemaError

from ..runs.variables import secret_names
from ..wire.base import Model, optional
from ..wire.errors import Place
from ..wire.json_values import is_list, is_object
from ..wire.request_problems import Location, first_words, nearest
from .parameter_values import ParameterValue, value_in_words
from .reference_typing import BOOLEAN, NUMBER, TEXT, WHOLE_NUMBER, Kind, Record
from .references import PARAMETERS
from .yaml_nodes import ListNode, MappingNode, ScalarNode, plain

ValueType = Literal["string", "integer", "number", "boolean"]

MAX_PARAMETERS = 100
"""Maximum number of parameters: people fill them in as a form, and Prefect stores a deployment's parameters in 512 kB.
"""

MAX_CHARACTERS = 2000
"""Maximum number of characters of a text value, such as an ARN or a sentence. A long one in thousands of places would
fill the memory.
"""

OWN_NAMES = ("spec", "text", "origin", "reuse", "continues", PARAMETERS)
"""Names of the parameters of the flow `RunPipeline`; in a deployment a specification's parameters are next to them."""

# pragma: allowlist nextline secret
NO_SECRETS = "values of parameters are in records, reports and Prefect, so write it where it is used"

_NOT_OF_FLOWS = ("_", "model_", "wait_for", "return_state")
"""Prefixes of names that pydantic or Prefect reserve for themselves in a flow's parameters."""

_KINDS: Mapping[ValueType, Kind] = {"string": TEXT, "integer": WHOLE_NUMBER, "number": NUMBER, "boolean": BOOLEAN}
_WANTED: Mapping[ValueType, str] = {
    "string": "text",
    "integer": "a whole number",
    "number": "a finite number",
    "boolean": "true or false",
}
_FOR_TYPES: Mapping[str, tuple[ValueType, ...]] = {
    **dict.fromkeys(("minimum", "maximum"), ("integer", "number")),
    "pattern": ("string",),
}
"""Members of a declaration that apply only to some types, with those types."""

_NODES = (ScalarNode, ListNode, MappingNode)
_INTEGER = re.compile(r"[-+]?[0-9]{1,400}")
_NUMBER = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?")
_Scalar = Annotated[Any, WithJsonSchema({"type": ["string", "integer", "number", "boolean"]})]
_Bound = Annotated[int | float, WithJsonSchema({"type": "number"})]


class Parameter(Model):
    """Declaration of a specification's parameter: type, default, and which values are allowed."""

    type: ValueType | None = optional(
        "Type of the value; absent: that of the values in `enum`, else that of `default`, else `string`."
    )
    default: _Scalar = optional("Value where none is given; absent: each run has to be given one.")
    description: str = Field(default="", description="Meaning of the parameter, in words, for forms.")
    enum: list[_Scalar] | None = Field(
        default=None, min_length=1, max_length=1000, description="The allowed values; absent: all of the type."
    )
    minimum: _Bound | None = optional("Smallest allowed number.")
    maximum: _Bound | None = optional("Largest allowed number.")
    pattern: str | None = optional("Regular expression that a text has to match somewhere; `^…$`: as a whole.")

    @property
    def value_type(self) -> ValueType:
        """Type of the parameter's values, derived from its choices or default if not given."""
        if self.type is not None:
            return self.type
        known = self.enum or ([] if self.default is None else [self.default])
        types: set[ValueType | None] = {_type_of(value) for value in known}
        if types == {"integer", "number"}:
            return "number"
        return (types.pop() or "string") if len(types) == 1 else "string"

    @property
    def kind(self) -> Kind:
        """Type of the parameter's values in the type system of references."""
        return _KINDS[self.value_type]

    @property
    def choices(self) -> list[str]:
        """Allowed values as text; empty if they are not listed."""
        choices = ["true", "false"] if self.value_type == "boolean" else []
        return [value_in_words(each) for each in self.enum] if self.enum else choices

    @property
    def form(self) -> dict[str, Any]:
        """The parameter's JSON schema, for forms."""
        members = self.model_dump(exclude_none=True, exclude={"type"})
        return {"type": self.value_type, **{name: value for name, value in members.items() if value != ""}}


@dataclass(frozen=True)
class AsText:
    """Value of a parameter as text from a command line or a form; the parameter's type decides how it is parsed."""

    text: str


@dataclass(frozen=True)
class ValueProblem:
    """A problem of the declaration or the value of a parameter."""

    location: Location
    """Keys of the specification that lead to the problem: `("parameters", "worlds")`."""

    message: str
    about_key: bool = False
    place: Place | None = None
    """Place in another file, where the value was given; `None`: `location` is the place."""


@dataclass(frozen=True)
class Settled:
    """Parameter values of a run, and their problems."""

    values: Mapping[str, ParameterValue] = field(default_factory=dict[str, ParameterValue])
    missing: tuple[str, ...] = ()
    """Names of parameters that have neither a value nor a default."""

    problems: tuple[ValueProblem, ...] = ()


def declaration_problems(name: str, declared: Parameter) -> Iterator[ValueProblem]:
    """Yields problems of a parameter's declaration beyond its schema: contradicting members.

    Args:
        name: The parameter's name.
        declared: Its declaration.
    """
    location = (PARAMETERS, name)
    if name in OWN_NAMES:
        words = f"may not be named {name!r}, as a parameter of the flow RunPipeline is; choose another name"
        yield ValueProblem(location, words, about_key=True)
    elif keyword.iskeyword(name) or name.startswith(_NOT_OF_FLOWS):
        words = f"may not be named {name!r}: no flow of Prefect can have a parameter of this name; choose another one"
        yield ValueProblem(location, words, about_key=True)
    if secret_names({}, [name]):
        yield ValueProblem(location, f"is a secret by its name; {NO_SECRETS}", about_key=True)
    problems = [*_unfit_members(declared)] or [*_wrong_values(declared)]
    for inside, message in problems:
        yield ValueProblem((*location, *inside), message)


def _unfit_members(declared: Parameter) -> Iterator[tuple[Location, str]]:
    """Yields members that do not apply to the type, or that no value can satisfy."""
    kind = declared.value_type
    for name, types in _FOR_TYPES.items():
        if getattr(declared, name) is not None and kind not in types:
            yield (name,), f"is for the type {' or '.join(types)}, and this is {kind}; remove it, or change the type"
    if declared.minimum is not None and declared.maximum is not None and declared.minimum > declared.maximum:
        yield ("minimum",), f"is {declared.minimum}; it may be at most the maximum, {declared.maximum}"
    if declared.pattern is not None and (trouble := _why_no_pattern(declared.pattern)):
        yield ("pattern",), f"is {declared.pattern!r}; {trouble}"


def _wrong_values(declared: Parameter) -> Iterator[tuple[Location, str]]:
    """Yields choices, and a default, that are not allowed values themselves."""
    choices, without_choices = declared.enum or [], declared.model_copy(update={"enum": None})
    for index, value in enumerate(choices):
        if wrong := why_wrong(value, without_choices):
            yield ("enum", index), wrong
        elif value in choices[:index]:
            yield ("enum", index), f"is {_shown(value)}, which is there twice; remove one"
    if declared.default is not None and (wrong := why_wrong(declared.default, declared)):
        yield ("default",), wrong


def settle(
    declared: Mapping[str, Parameter], given: Mapping[str, Any], *, is_complete: bool, others: Iterable[str] = ()
) -> Settled:
    """Determines the value of each parameter: the given one, else the default.

    Args:
        declared: Parameters with valid declarations.
        given: Values by name: plain ones, `AsText`, or nodes of the file from which they are.
        is_complete: Whether each parameter needs a value; otherwise those without are listed as missing.
        others: Names of parameters with invalid declarations, for messages.
    """
    known = (*declared, *others)
    problems = [_unknown(name, value, known) for name, value in given.items() if name not in declared]
    values: dict[str, ParameterValue] = {}
    missing: list[str] = []
    for name, each in declared.items():
        if name not in given:
            if each.default is None:
                missing.append(name)
            else:
                values[name] = _converted(each.default, each)
            continue
        value = _converted(given[name], each)
        if wrong := why_wrong(value, each):
            problems.append(ValueProblem((PARAMETERS, name), f"the value given {wrong}", place=_place_of(given[name])))
        else:
            values[name] = value
    if is_complete:
        for name in missing:
            words = f"has neither a value nor a default; give it one: --set {name}=…, or {name}=… in Python"
            problems.append(ValueProblem((PARAMETERS, name), words, about_key=True))
    return Settled(values, tuple(missing), tuple(problems))


def why_wrong(value: Any, declared: Parameter) -> str:
    """Describes why a value is not allowed, as `is 3; it has to be true or false`; empty if it is allowed."""
    wanted = _wanted(value, declared)
    return f"is {_shown(value)}; {wanted}" if wanted else ""


def kind_of_parameters(declared: Mapping[str, Parameter], others: Mapping[str, Kind] | None = None) -> Record:
    """Returns the type of `parameters` in references.

    Args:
        declared: The parameters.
        others: Types of parameters with invalid declarations.
    """
    return Record({**{name: each.kind for name, each in declared.items()}, **(others or {})}, "there is no parameter")


def _unknown(name: str, value: Any, known: Collection[str]) -> ValueProblem:
    there = f"; there are {first_words(known)}" if known else "; the specification declares none"
    words = f"there is no parameter {name!r}{nearest(name, known) or there}"
    return ValueProblem((PARAMETERS,), words, about_key=True, place=_place_of(value))


def _place_of(given: Any) -> Place | None:
    return given.place if isinstance(given, _NODES) else None


def _converted(given: Any, declared: Parameter) -> Any:
    """Converts a value to its parameter's type if possible; otherwise returns it unchanged."""
    if isinstance(given, AsText):
        return _read(given.text, declared.value_type)
    value = plain(given) if isinstance(given, _NODES) else given
    if declared.value_type == "integer" and isinstance(value, float) and value.is_integer():
        return int(value)  # JSON has one kind of number, and JSON Schema takes 4.0 for a whole one
    return value


def _read(text: str, kind: ValueType) -> ParameterValue:
    if kind == "boolean":
        return {"true": True, "false": False}.get(text.lower(), text)
    if kind in ("integer", "number") and _INTEGER.fullmatch(text):
        return int(text)
    if kind == "number" and _NUMBER.fullmatch(text) and math.isfinite(number := float(text)):
        return number
    return text


def _wanted(value: Any, declared: Parameter) -> str:
    """Describes all values that would be allowed, as `it has to be true or false`; empty if the value is allowed."""
    kind = declared.value_type
    if not _is_of_type(value, kind):
        is_other = kind == "string" and isinstance(value, int | float)
        hint = f'; put it in quotes: "{value_in_words(value)}"' if is_other else ""
        return f"it has to be {_allowed(declared)}{hint}"
    if isinstance(value, str) and len(value) > MAX_CHARACTERS:
        return f"its length may be at most {MAX_CHARACTERS}"
    if isinstance(value, str) and "\0" in value:
        return "it may not hold the character U+0000"
    if declared.enum is not None and value not in declared.enum:
        hint = nearest(value, declared.choices) if isinstance(value, str) else ""
        return f"it has to be {_allowed(declared)}{hint}"
    if isinstance(value, str):
        fits = declared.pattern is None or _matches(value, declared.pattern)
    else:
        is_low = declared.minimum is not None and value < declared.minimum
        fits = not is_low and (declared.maximum is None or value <= declared.maximum)
    return "" if fits else f"it has to be {_allowed(declared)}"


def _allowed(declared: Parameter) -> str:
    """Describes all allowed values of a parameter: `control or treatment`, `a whole number from 1 to 50`."""
    if choices := declared.choices:
        return " or ".join(choices) if len(choices) <= 3 else f"one of {first_words(choices)}"
    low, high = declared.minimum, declared.maximum
    wanted = _WANTED[declared.value_type]
    if low is not None and high is not None:
        return f"{wanted} from {low} to {high}"
    if low is not None or high is not None:
        return f"{wanted}, {f'at least {low}' if low is not None else f'at most {high}'}"
    return f"{wanted} that matches {declared.pattern}" if declared.pattern is not None else wanted


def _is_of_type(value: Any, kind: ValueType) -> bool:
    found = _type_of(value)
    if isinstance(value, float) and not math.isfinite(value):
        return False
    return found == kind or (kind == "number" and found == "integer")


def _type_of(value: Any) -> ValueType | None:
    if isinstance(value, bool):
        return "boolean"
    types: tuple[tuple[type, ValueType], ...] = ((str, "string"), (int, "integer"), (float, "number"))
    return next((name for each, name in types if isinstance(value, each)), None)


@lru_cache(maxsize=256)
def _pattern(pattern: str) -> TypeAdapter[str]:
    # The engine of pydantic's core takes time in proportion to the text: a specification may be a stranger's.
    return TypeAdapter(Annotated[str, Field(pattern=pattern)])


def _why_no_pattern(pattern: str) -> str:
    try:
        _pattern(pattern)
    except SchemaError as error:
        reason = [line.strip() for line in str(error).splitlines() if line.strip()][-1]
        return f"it is no regular expression: {reason.removeprefix('error: ')}"
    return ""


def _matches(value: str, pattern: str) -> bool:
    try:
        _pattern(pattern).validate_python(value)
    except ValidationError:
        return False
    return True


def _shown(value: Any) -> str:
    if value is None or isinstance(value, bool):
        return {None: "null", True: "true", False: "false"}[value]
    if is_list(value) or is_object(value):
        return "a list" if is_list(value) else "a mapping"
    text = repr(getattr(value, "text", value))
    return text if len(text) <= 80 else f"{text[:70]}… ({len(text)} characters)"
