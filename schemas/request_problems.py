"""Says in plain words what is wrong with a request: member, value, what would be right."""

import difflib
import types
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Annotated, Any, Union, get_args, get_origin

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

Location = tuple[str | int, ...]


@dataclass(frozen=True)
class RequestProblem:
    """One thing wrong with a request."""

    location: Location
    """Members and list positions that lead to the value; empty for the request as a whole."""

    message: str
    """The value and what would be right."""

    about_key: bool = False
    """Whether it is the member's name or the mapping's key that is wrong, not the value."""

    @property
    def path(self) -> str:
        """The location as people write it: `simulationApplications[0].launchConfig`."""
        steps = (f"[{step}]" if isinstance(step, int) else f".{step}" for step in self.location)
        return "".join(steps).removeprefix(".")

    def __str__(self) -> str:
        return f"{self.path}: {self.message}" if self.location else self.message


def nearest(word: str, words: Iterable[str]) -> str:
    """The most similar of some words as a question to add to a message, or nothing."""
    by_folded = {each.lower(): each for each in words}
    close = difflib.get_close_matches(word.lower(), by_folded, n=1, cutoff=0.6)
    return f"; did you mean {by_folded[close[0]]!r}?" if close else ""


def problems_of(error: ValidationError, model: type[BaseModel]) -> list[RequestProblem]:
    """Translates the validator's findings.

    Args:
      error: what validation raised.
      model: the model it was validated against.
    """
    return [_problem(details, model) for details in error.errors(include_url=False)]


def _problem(details: ErrorDetails, model: type[BaseModel]) -> RequestProblem:
    location = details["loc"]
    kind = details["type"]
    if kind == "missing":
        return RequestProblem(location, f"is missing{_described(model, location)}")
    if kind == "extra_forbidden":
        members = _members(_model_at(model, location[:-1]))
        hint = nearest(str(location[-1]), members) or f"; known are {', '.join(members)}"
        return RequestProblem(location, f"is not known{hint}", about_key=True)
    if kind == "value_error":
        return RequestProblem(location, str(details.get("ctx", {})["error"]))
    described = f"{_shown(details['input'])}; {_wanted(details)}"
    if location and location[-1] == "[key]":
        return RequestProblem(location[:-1], f"the key is {described}", about_key=True)
    return RequestProblem(location, f"is {described}")


def _shown(value: object) -> str:
    text = repr(value)
    return text if len(text) <= 80 else f"{text[:70]}… ({len(text)} characters)"


_WANTED = {
    "string_pattern_mismatch": "it has to match {pattern} as a whole",
    "string_too_short": "its length has to be at least {min_length}",
    "string_too_long": "its length may be at most {max_length}",
    "too_short": "its length has to be at least {min_length}",
    "too_long": "its length may be at most {max_length}",
    "greater_than_equal": "it has to be at least {ge}",
    "less_than_equal": "it may be at most {le}",
    "literal_error": "it has to be {expected}",
    "string_type": "it has to be text",
    "int_type": "it has to be a whole number",
    "bool_type": "it has to be true or false",
    "list_type": "it has to be a list",
    "dict_type": "it has to be a mapping",
    "model_type": "it has to be a mapping",
}


def _wanted(details: ErrorDetails) -> str:
    context = dict(details.get("ctx", {}))
    if "pattern" in context:
        context["pattern"] = context["pattern"].removeprefix("^(?:").removesuffix(")$")
    template = _WANTED.get(details["type"])
    return template.format_map(context) if template else details["msg"]


def _members(model: type[BaseModel] | None) -> list[str]:
    return list(model.model_fields) if model else []


def _described(model: type[BaseModel], location: Location) -> str:
    owner = _model_at(model, location[:-1])
    field = owner.model_fields.get(str(location[-1])) if owner else None
    return f"; it is required: {field.description}" if field and field.description else "; it is required"


def _model_at(model: type[BaseModel], location: Location) -> type[BaseModel] | None:
    """The model whose members are looked up at a location."""
    kind: Any = model
    for step in location:
        if isinstance(kind, type) and issubclass(kind, BaseModel):
            field = kind.model_fields.get(str(step))
            kind = _plain(field.annotation) if field else None
        elif get_origin(kind) in (list, dict):
            kind = _plain(get_args(kind)[-1])
    return kind if isinstance(kind, type) and issubclass(kind, BaseModel) else None


def _plain(annotation: Any) -> Any:
    """An annotation without `Annotated` and `None`."""
    origin = get_origin(annotation)
    if origin is Annotated:
        return _plain(get_args(annotation)[0])
    if origin in (Union, types.UnionType):
        return _plain(next(each for each in get_args(annotation) if each is not type(None)))
    return annotation
