"""Kinds of values: of members, and of JMESPath expressions without evaluating them.

The kinds are JSON's, with models in place of objects. `Anything` stands for all that cannot be told
beforehand; it fits everywhere.
"""

import types
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime
from typing import Annotated, Any, Literal, TypeAlias, Union, get_args, get_origin

from pydantic import BaseModel

from ..wire.json_values import is_list, is_object


@dataclass(frozen=True)
class Anything:
    """Cannot be told."""

    def __str__(self) -> str:
        return "a value"


@dataclass(frozen=True)
class Scalar:
    """A single value; `name` is one of those below."""

    name: str

    def __str__(self) -> str:
        return self.name


@dataclass(frozen=True)
class ListOf:
    """A list of items of one kind."""

    item: "Kind"

    def __str__(self) -> str:
        return "a list"


@dataclass(frozen=True)
class MapOf:
    """A mapping with any keys."""

    value: "Kind"

    def __str__(self) -> str:
        return "a mapping"


@dataclass(frozen=True)
class Structure:
    """A mapping with the members of a model."""

    model: type[BaseModel]

    def __str__(self) -> str:
        return f"a mapping ({self.model.__name__})"


@dataclass(frozen=True)
class Record:
    """A mapping with known members that no model describes."""

    members: Mapping[str, "Kind"]

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
    """An annotation without bounds and without `None`; a choice between several stays one."""
    if get_origin(annotation) is Annotated:
        return without_none(get_args(annotation)[0])
    if get_origin(annotation) in (Union, types.UnionType):
        present = [each for each in get_args(annotation) if each is not type(None)]
        return without_none(present[0]) if len(present) == 1 else annotation
    return annotation


def kind_of(annotation: Any) -> Kind:
    """The kind of a model's member."""
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
    """The kind of a plain value."""
    if is_list(value):
        return ListOf(common(*(kind_of_value(item) for item in value)))
    if is_object(value):
        return Record({key: kind_of_value(item) for key, item in value.items()})
    return _SCALARS.get(type(value), ANYTHING)


def common(*kinds: Kind) -> Kind:
    """The kind that all are of, if there is one."""
    return kinds[0] if kinds and all(kind == kinds[0] for kind in kinds) else ANYTHING


def members_of(kind: Kind) -> Mapping[str, Kind] | None:
    """The members of a mapping whose members are known."""
    if isinstance(kind, Structure):
        return {name: kind_of(field.annotation) for name, field in kind.model.model_fields.items()}
    return kind.members if isinstance(kind, Record) else None


def fits(source: Kind, target: Kind) -> bool:
    """Whether a value of one kind may stand where another is asked for; `True` where it cannot be told."""
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
