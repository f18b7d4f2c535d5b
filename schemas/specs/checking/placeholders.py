"""Placeholders for values that are unknown before a run, and fitting values for validation."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple, get_args, get_origin

from pydantic import BaseModel, TypeAdapter, ValidationError
from pydantic.fields import FieldInfo

from ...wire.base import NamesWorld
from ...wire.json_values import is_list, is_object
from ...wire.request_problems import closest
from ..reference_typing import (
    BOOLEAN,
    NUMBER,
    TEXT,
    WHOLE_NUMBER,
    Kind,
    ListOf,
    MapOf,
    Scalar,
    Structure,
    kind_of,
    without_none,
)

KIND = "kind"
"""Name of the member that selects one of several models for a mapping."""


class Filling(NamedTuple):
    """Values that replace all placeholders of a request during validation."""

    texts: tuple[str, ...]
    """Texts, of which the first that fits is taken."""

    numbers: tuple[int, ...]
    """Numbers, of which the first that fits is taken."""


# One of these fits every text that the requests ask for: words, files, numbers of axes, versions, roles.
FILLINGS = (
    Filling(("placeholder", "0.75", "1", "arn:aws:iam::000000000000:role/placeholder", "a.zip"), (1, 0, 100)),
    Filling(("placeholder.zip", "0.875", "2", "arn:aws:iam::000000000000:role/other", "other"), (100, 1, 0)),
)
"""Two sets of values with little in common: only errors that occur with both are certain."""

MOST_ATTEMPTS = max(len(filling.texts) for filling in FILLINGS)
"""Maximum number of values tried at a place, as rules may refuse values that the type allows."""


_NUMBER = re.compile(r"-?\d+(?:\.\d+)?")
_LIKE_KINDS = 0.7
"""Similarity of two kinds from which one is read as the other; kinds are short names, and there are few."""


@dataclass(frozen=True)
class Placeholder:
    """Placeholder for a value that is not known yet."""

    annotation: Any
    attempt: int = 0
    """Number of values that were refused before at this place."""


def inner(annotation: Any, step: str | int) -> Any:
    """Returns the type annotation of a member or an item of an annotated type."""
    core = without_none(annotation)
    if get_origin(core) is (list if isinstance(step, str) else dict):
        return Any  # the wrong kind of collection; its entries are not at fault
    if isinstance(core, type) and issubclass(core, BaseModel):
        member = core.model_fields.get(str(step))
        return member.rebuild_annotation() if member else Any
    if get_origin(core) in (list, dict):
        return get_args(core)[-1]
    return Any


def names_world(annotation: Any) -> bool:
    """Returns whether an annotation is that of the ARN of a world, which a specification may name otherwise."""
    parts = get_args(annotation)
    return any(isinstance(part, NamesWorld) or names_world(part) for part in parts if get_origin(part) is not list)


def choices_of(annotation: Any) -> Mapping[str, type[BaseModel]]:
    """Returns the models of a tagged union by their kinds; empty for other annotations."""
    models = get_args(without_none(annotation))
    choices = (model for model in models if isinstance(model, type) and issubclass(model, BaseModel))
    with_kinds = ((model, model.model_fields[KIND]) for model in choices if KIND in model.model_fields)
    return {str(kind): model for model, field in with_kinds for kind in get_args(field.annotation)}


def chosen(annotation: Any, kind: object) -> Any:
    """Returns the model of a union that a mapping's kind names, or nearly names.

    Args:
        annotation: Annotation, which is returned if it is no union, or has no such model.
        kind: Kind that the mapping names.
    """
    choices = choices_of(annotation)
    return choices.get(meant_kind(annotation, kind) or "", annotation)


def meant_kind(annotation: Any, kind: object) -> str | None:
    """Returns the kind of a union that a mapping names, or nearly names; `None` if there is none."""
    choices = choices_of(annotation)
    if not isinstance(kind, str) or not choices:
        return None
    return kind if kind in choices else closest(kind, choices, _LIKE_KINDS)


def annotation_at(annotation: Any, value: Any, location: tuple[str | int, ...]) -> Any:
    """Returns the annotation of the value at a location of a request.

    Args:
        annotation: Annotation of the request.
        value: Request, whose mappings name their kinds.
        location: Members and list positions that lead to the value.
    """
    for step in location:
        if is_object(value):
            annotation = chosen(annotation, value.get(KIND))
        annotation = inner(annotation, step)
        value = value_at(value, (step,))
    return annotation


def value_at(value: Any, location: tuple[str | int, ...]) -> Any:
    """Returns the value at a location of plain data; `None` if there is none."""
    for step in location:
        if is_list(value):
            value = value[step] if isinstance(step, int) and step < len(value) else None
        else:
            value = value.get(step) if is_object(value) and isinstance(step, str) else None
    return value


def filled(value: Any, filling: Filling) -> Any:
    """Returns plain data with fitting values in place of placeholders."""
    if isinstance(value, Placeholder):
        return _example(value.annotation, filling, value.attempt)
    if is_object(value):
        return {key: filled(item, filling) for key, item in value.items()}
    if is_list(value):
        return [filled(item, filling) for item in value]
    return value


def examples_for(annotation: Any, words: Sequence[str]) -> list[Any] | None:
    """Returns several values that fit an annotation, to see whether something depends on which it is.

    Args:
        annotation: Annotation of the value.
        words: Further texts, or numbers as text, to take where the annotation allows texts or numbers.

    Returns:
        The values; `None` for mappings, and for lists of these: a few examples say little about the others.
    """
    kind = kind_of(annotation)
    if isinstance(kind, ListOf):
        items = examples_for(inner(annotation, 0), words)
        made = None if items is None else [[each] for each in items]
    else:
        made = _scalars(annotation, kind, words) if isinstance(kind, Scalar) else None
    return made and _fitting(annotation, made)


def _scalars(annotation: Any, kind: Scalar, words: Sequence[str]) -> list[Any]:
    numbers = [float(each) for each in words if _NUMBER.fullmatch(each)]
    others: dict[Scalar, list[Any]] = {
        TEXT: [*words],
        NUMBER: numbers,
        WHOLE_NUMBER: [int(each) for each in numbers],
        BOOLEAN: [False],
    }
    examples = (_example(annotation, filling, attempt) for filling in FILLINGS for attempt in range(MOST_ATTEMPTS))
    return [*examples, *others.get(kind, [])]


def _fitting(annotation: Any, values: Sequence[Any]) -> list[Any]:
    """Returns the values that fit an annotation, each once."""
    adapter = TypeAdapter[Any](annotation)
    fitting: list[Any] = []
    for each in values:
        if each not in fitting and _fits(each, adapter):
            fitting.append(each)
    return fitting


def _example(annotation: Any, filling: Filling, attempt: int = 0) -> Any:
    """Returns a value that fits an annotation, if one is easily found; another one for each attempt, if possible."""
    if choices := choices_of(annotation):
        return _example_of_choice(choices, filling)
    kind = kind_of(annotation)
    if isinstance(kind, ListOf):
        return [_example(inner(annotation, 0), filling)]
    if isinstance(kind, MapOf):
        return {}
    if isinstance(kind, Structure):
        required = (name for name, member in kind.model.model_fields.items() if member.is_required())
        return {name: _example(inner(annotation, name), filling) for name in required}
    if kind == BOOLEAN:
        return True
    if listed := _listed(annotation):
        return listed[0 if filling == FILLINGS[0] else -1]
    candidates = _candidates(kind, filling)
    adapter = TypeAdapter[Any](annotation)
    fitting = [each for each in candidates if _fits(each, adapter)] or [*candidates, None]
    return fitting[attempt % len(fitting)]


def _listed(annotation: Any) -> Sequence[Any]:
    """Returns the values that an annotation allows, if it lists all of them; else empty."""
    metadata = getattr(annotation, "__metadata__", ())
    extras = (each.json_schema_extra for each in metadata if isinstance(each, FieldInfo))
    listed = next((extra["enum"] for extra in extras if is_object(extra) and "enum" in extra), ())
    core = without_none(annotation)
    return get_args(core) if get_origin(core) is Literal else listed


def _candidates(kind: Kind, filling: Filling) -> tuple[str | float, ...]:
    if kind == TEXT:
        return filling.texts
    if kind == WHOLE_NUMBER:
        return filling.numbers
    return tuple(map(float, filling.numbers)) if kind == NUMBER else ()


def _example_of_choice(choices: Mapping[str, type[BaseModel]], filling: Filling) -> Any:
    models = list(choices.values())
    for model in models if filling == FILLINGS[0] else reversed(models):
        example = _example(model, filling)
        if _fits(example, TypeAdapter(model)):
            return example
    return None


def _fits(value: Any, adapter: TypeAdapter[Any]) -> bool:
    try:
        adapter.validate_python(value, strict=True)
    except ValidationError:
        return False
    return True
