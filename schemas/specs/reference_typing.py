"""Type system of references: types of members and of JMESPath expressions, to reject invalid ones before a run."""

import types
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import datetime
from typing import Annotated, Any, Literal, TypeAlias, Union, get_args, get_origin

from jmespath.functions import Functions
from pydantic import BaseModel

from ..wire.json_values import is_list, is_object
from ..wire.request_problems import nearest


@dataclass(frozen=True)
class Anything:
    """Type of an expression's value that cannot be determined before the run."""

    def __str__(self) -> str:
        return "a value"


@dataclass(frozen=True)
class Scalar:
    """Type of a single value (string, number, boolean or null) in a specification's expressions."""

    name: str

    def __str__(self) -> str:
        return self.name


@dataclass(frozen=True)
class ListOf:
    """Type of a list in a specification's expressions: all items have one type."""

    item: "Kind"

    def __str__(self) -> str:
        return "a list"


@dataclass(frozen=True)
class MapOf:
    """Type of a mapping with arbitrary keys in a specification's expressions."""

    value: "Kind"

    def __str__(self) -> str:
        return "a mapping"


@dataclass(frozen=True)
class Structure:
    """Type of a mapping that has the members of a pydantic model, in a specification's expressions."""

    model: type[BaseModel]

    def __str__(self) -> str:
        return f"a mapping ({self.model.__name__})"


@dataclass(frozen=True)
class Record:
    """Type of a mapping with known members that no model describes, in a specification's expressions."""

    members: Mapping[str, "Kind"]
    lacks: str = "this mapping has no member"
    """Beginning of the error text about a missing member."""

    def __str__(self) -> str:
        return "a mapping"


Kind: TypeAlias = Anything | Scalar | ListOf | MapOf | Structure | Record

ANYTHING = Anything()
TEXT = Scalar("text")
WHOLE_NUMBER = Scalar("a whole number")
NUMBER = Scalar("a number")
BOOLEAN = Scalar("true or false")
TIME = Scalar("a time")

_SCALARS: dict[Any, Kind] = {str: TEXT, int: WHOLE_NUMBER, float: NUMBER, bool: BOOLEAN, datetime: TIME}


def without_none(annotation: Any) -> Any:
    """Strips `None` and value bounds from a type annotation; a union of several other types stays one."""
    if get_origin(annotation) is Annotated:
        return without_none(get_args(annotation)[0])
    if get_origin(annotation) in (Union, types.UnionType):
        present = [each for each in get_args(annotation) if each is not type(None)]
        return without_none(present[0]) if len(present) == 1 else annotation
    return annotation


def kind_of(annotation: Any) -> Kind:
    """Converts the type annotation of a model member to the type of an expression."""
    annotation = without_none(annotation)
    origin, arguments = get_origin(annotation), get_args(annotation)
    if origin is Literal:
        return kind_of_value(arguments[0])
    if origin is list:
        return ListOf(kind_of(arguments[0]))
    if origin is dict:
        return MapOf(kind_of(arguments[1]))
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return Structure(annotation)
    return _SCALARS.get(annotation, ANYTHING)


def kind_of_value(value: Any) -> Kind:
    """Returns the expression type of a plain value."""
    if is_list(value):
        return ListOf(common(*(kind_of_value(item) for item in value)))
    if is_object(value):
        return Record({key: kind_of_value(item) for key, item in value.items()})
    return _SCALARS.get(type(value), ANYTHING)


def common(*kinds: Kind) -> Kind:
    """Returns the type that all given types agree on, or `Anything` if they differ."""
    return kinds[0] if kinds and all(kind == kinds[0] for kind in kinds) else ANYTHING


def members_of(kind: Kind) -> Mapping[str, Kind] | None:
    """Returns the members and their types of a mapping type; `None` if they are not known."""
    if isinstance(kind, Structure):
        return {name: kind_of(field.annotation) for name, field in kind.model.model_fields.items()}
    return kind.members if isinstance(kind, Record) else None


def fits(source: Kind, target: Kind) -> bool:
    """Returns whether a value of type `source` is acceptable where `target` is required; `True` if unknown."""
    if isinstance(source, Anything) or isinstance(target, Anything) or source == target:
        return True
    if isinstance(source, Scalar) or isinstance(target, Scalar):
        # A number may turn out to be a whole one.
        return {source, target} == {NUMBER, WHOLE_NUMBER}
    if isinstance(source, ListOf) or isinstance(target, ListOf):
        return isinstance(source, ListOf) and isinstance(target, ListOf) and fits(source.item, target.item)
    return _mapping_fits(source, target)


def _mapping_fits(source: Kind, target: Kind) -> bool:
    have, want = members_of(source), members_of(target)
    if have is None:
        return True
    if want is None:
        return not isinstance(target, MapOf) or all(fits(kind, target.value) for kind in have.values())
    return all(name in want and fits(kind, want[name]) for name, kind in have.items())


class ReferenceMistake(ValueError):
    """Raised when a `${...}` reference in a specification cannot work; the message says why."""


def infer(tree: Mapping[str, Any], scope: Kind) -> Kind:
    """Determines the type of a JMESPath expression's value without evaluating it.

    Args:
        tree: Parsed expression, `jmespath.compile(…).parsed`.
        scope: Type of the value on which it is evaluated.

    Raises:
        ReferenceMistake: The expression cannot work: unknown member, index into something that is no list, ….
    """
    return _RULES[tree["type"]](tree, scope)


def _field(tree: Mapping[str, Any], scope: Kind) -> Kind:
    name = tree["value"]
    if isinstance(scope, Anything):
        return ANYTHING
    if isinstance(scope, MapOf):
        return scope.value
    members = members_of(scope)
    if members is None:
        hint = "; choose entries with [0] or [*]" if isinstance(scope, ListOf) else ""
        raise ReferenceMistake(f"{name!r} is asked of {scope}, which has no members{hint}")
    if name not in members:
        hint = nearest(name, members) or f"; there are {', '.join(members) or 'none'}"
        lacks = (
            f"{scope.model.__name__} has no member" if isinstance(scope, Structure) else "this mapping has no member"
        )
        raise ReferenceMistake(f"{scope.lacks if isinstance(scope, Record) else lacks} {name!r}{hint}")
    return members[name]


def _chain(tree: Mapping[str, Any], scope: Kind) -> Kind:
    for part in tree["children"]:
        scope = infer(part, scope)
    return scope


def _item(scope: Kind, what: str) -> Kind:
    if isinstance(scope, ListOf):
        return scope.item
    if isinstance(scope, Anything):
        return ANYTHING
    raise ReferenceMistake(f"{what} is asked of {scope}, which is no list")


def _index(tree: Mapping[str, Any], scope: Kind) -> Kind:
    return _item(scope, f"[{tree['value']}]")


def _slice(_tree: Mapping[str, Any], scope: Kind) -> Kind:
    return ListOf(_item(scope, "a slice"))


def _projection(tree: Mapping[str, Any], scope: Kind) -> Kind:
    left, right = tree["children"]
    return ListOf(infer(right, _item(infer(left, scope), "every entry")))


def _filter(tree: Mapping[str, Any], scope: Kind) -> Kind:
    left, right, condition = tree["children"]
    item = _item(infer(left, scope), "a filter")
    infer(condition, item)
    return ListOf(infer(right, item))


def _values(tree: Mapping[str, Any], scope: Kind) -> Kind:
    left, right = tree["children"]
    kind = infer(left, scope)
    members = members_of(kind)
    if isinstance(kind, MapOf):
        return ListOf(infer(right, kind.value))
    if members is not None:
        return ListOf(infer(right, common(*members.values())))
    if isinstance(kind, Anything):
        return ListOf(ANYTHING)
    raise ReferenceMistake(f".* is asked of {kind}, which is no mapping")


def _flatten(tree: Mapping[str, Any], scope: Kind) -> Kind:
    item = _item(infer(tree["children"][0], scope), "[]")
    return item if isinstance(item, ListOf) else ListOf(item)


def _either(tree: Mapping[str, Any], scope: Kind) -> Kind:
    return common(*(infer(part, scope) for part in tree["children"]))


def _condition(tree: Mapping[str, Any], scope: Kind) -> Kind:
    for part in tree["children"]:
        infer(part, scope)
    return BOOLEAN


def _list(tree: Mapping[str, Any], scope: Kind) -> Kind:
    return ListOf(common(*(infer(part, scope) for part in tree["children"])))


def _mapping(tree: Mapping[str, Any], scope: Kind) -> Kind:
    return Record({part["value"]: infer(part["children"][0], scope) for part in tree["children"]})


def _same(_tree: Mapping[str, Any], scope: Kind) -> Kind:
    return scope


def _literal(tree: Mapping[str, Any], _scope: Kind) -> Kind:
    return kind_of_value(tree["value"])


def _function(tree: Mapping[str, Any], scope: Kind) -> Kind:
    name, arguments = tree["value"], tree["children"]
    known: Mapping[str, Any] = Functions.FUNCTION_TABLE  # type: ignore[attr-defined] # set by its metaclass
    if name not in known:
        raise ReferenceMistake(f"there is no function {name}(){nearest(name, known)}")
    signature = known[name]["signature"]
    variadic = any(parameter.get("variadic") for parameter in signature)
    if len(arguments) < len(signature) or (len(arguments) > len(signature) and not variadic):
        raise ReferenceMistake(f"{name}() takes {len(signature)} argument(s), not {len(arguments)}")
    kinds = [ANYTHING if part["type"] == "expref" else infer(part, scope) for part in arguments]
    if name == "map":
        return ListOf(infer(arguments[0]["children"][0], _item(kinds[1], "map()")))
    if name.endswith("_by"):
        infer(arguments[1]["children"][0], _item(kinds[0], f"{name}()"))
    return _RESULTS[name](kinds)


def _first(kinds: list[Kind]) -> Kind:
    return kinds[0]


def _first_item(kinds: list[Kind]) -> Kind:
    return _item(kinds[0], "an entry")


_RESULTS: dict[str, Callable[[list[Kind]], Kind]] = {
    **dict.fromkeys(("abs", "avg", "sum", "to_number"), lambda _: NUMBER),
    **dict.fromkeys(("ceil", "floor", "length"), lambda _: WHOLE_NUMBER),
    **dict.fromkeys(("contains", "ends_with", "starts_with"), lambda _: BOOLEAN),
    **dict.fromkeys(("join", "to_string", "type"), lambda _: TEXT),
    **dict.fromkeys(("reverse", "sort", "sort_by"), _first),
    **dict.fromkeys(("max", "min", "max_by", "min_by"), _first_item),
    **dict.fromkeys(("merge", "values"), lambda _: ANYTHING),
    "keys": lambda _: ListOf(TEXT),
    "not_null": lambda kinds: common(*kinds),
    "to_array": lambda kinds: kinds[0] if isinstance(kinds[0], ListOf) else ListOf(kinds[0]),
}

_RULES: dict[str, Callable[[Mapping[str, Any], Kind], Kind]] = {
    "field": _field,
    "subexpression": _chain,
    "index_expression": _chain,
    "pipe": _chain,
    "index": _index,
    "slice": _slice,
    "projection": _projection,
    "filter_projection": _filter,
    "value_projection": _values,
    "flatten": _flatten,
    "or_expression": _either,
    "and_expression": _either,
    "not_expression": _condition,
    "comparator": _condition,
    "multi_select_list": _list,
    "multi_select_dict": _mapping,
    "literal": _literal,
    "current": _same,
    "identity": _same,
    "function_expression": _function,
}
