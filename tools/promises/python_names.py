"""Facts of the Python names that users import: parameters of functions and flows, members of classes."""

import inspect
import json
import re
from collections.abc import Iterable, Iterator
from functools import cached_property
from pathlib import Path
from types import ModuleType, UnionType
from typing import Any, Literal, Union, get_args, get_origin

from prefect.flows import Flow
from pydantic import BaseModel

from .facts import Fact

_PLACED = (inspect.Parameter.POSITIONAL_ONLY, inspect.Parameter.POSITIONAL_OR_KEYWORD)
_HOW = {
    inspect.Parameter.POSITIONAL_ONLY: "by place only",
    inspect.Parameter.POSITIONAL_OR_KEYWORD: None,
    inspect.Parameter.KEYWORD_ONLY: None,
    inspect.Parameter.VAR_POSITIONAL: "any number",
    inspect.Parameter.VAR_KEYWORD: "any names",
}
_GOT = ("Job", "ResultRow", "Run", "RunInterrupted", "Service", "World")
"""Classes whose objects users get, and do not make: parameters for making one may change."""
_USED = {"Service": ("activated", "arn", "catalog", "current", "folder", "open", "opened", "settings", "store")}
"""Members of a class that are for users, where the others serve this program."""


def facts_of_names(module: ModuleType, operations: Iterable[str]) -> dict[str, Fact]:
    """Returns the facts of the names in a module's `__all__`.

    Args:
        module: The module.
        operations: Names of flows whose parameters are requests: their types are promised as the wire.
    """
    names, facts = set(operations), dict[str, Fact]()
    for name in module.__all__:
        value = getattr(module, name)
        if isinstance(value, Flow):
            facts[name] = Fact(form="flow")
            facts |= _of_signature(name, value.fn, with_types=name not in names)
        elif inspect.isclass(value):
            facts |= _of_class(name, value, module.__name__)
        elif callable(value):
            facts[name] = Fact(form="function", given=_types(inspect.signature(value).return_annotation))
            facts |= _of_signature(name, value)
        else:
            facts[name] = Fact(given=frozenset({type(value).__name__}))
    return facts


def _of_signature(name: str, function: Any, *, with_types: bool = True) -> Iterator[tuple[str, Fact]]:
    """Yields the facts of the parameters that callers may give."""
    parameters = inspect.signature(function).parameters.values()
    for place, each in enumerate(parameters):
        if each.name.startswith("_") or each.name in ("self", "cls"):
            continue
        has_default = each.default is not inspect.Parameter.empty
        yield (
            f"{name}.({each.name})",
            Fact(
                form=_HOW[each.kind],
                taken=_types(each.annotation) if with_types else frozenset({"as on the wire"}),
                required=not has_default and each.kind not in (each.VAR_POSITIONAL, each.VAR_KEYWORD),
                default=_default(each.default) if has_default else None,
                place=place if each.kind in _PLACED else None,
            ),
        )


def _of_class(name: str, kind: type, package: str) -> Iterator[tuple[str, Fact]]:
    """Yields the facts of a class: its promised bases, how it is made, and its members."""
    bases = [each for each in kind.__mro__ if each.__module__.startswith(package)]
    yield name, Fact(form="class")
    for base in kind.__mro__[1:]:
        if issubclass(base, Exception | KeyboardInterrupt):
            yield f"{name} is {base.__name__}", Fact(form="base class")
    if name not in _GOT and _has_own_signature(kind):
        yield from _of_signature(name, kind)
    members = {member: value for base in reversed(bases) for member, value in vars(base).items()}
    fields = {
        # Settings say in `settings.json` what they may be.
        member: "as the setting" if issubclass(kind, BaseModel) else hint
        for base in reversed(bases)
        for member, hint in inspect.get_annotations(base).items()
    }
    for member in sorted(_USED.get(name, {**members, **fields})):
        if member.startswith("_") or member == "model_config":
            continue
        yield from _of_member(f"{name}.{member}", members.get(member), fields.get(member, inspect.Parameter.empty))


def _has_own_signature(kind: type) -> bool:
    try:
        inspect.signature(kind)
    except ValueError:  # an exception that is made as `Exception` is
        return False
    # Settings are read from variables: `settings.json` has them.
    return not issubclass(kind, BaseModel)


def _of_member(place: str, value: Any, hint: Any) -> Iterator[tuple[str, Fact]]:
    function = value.__func__ if isinstance(value, classmethod | staticmethod) else value
    getter = value.fget if isinstance(value, property) else value.func if isinstance(value, cached_property) else None
    if getter is not None:
        yield place, Fact(given=_types(inspect.signature(getter).return_annotation), required=True)
    elif inspect.isfunction(function):
        yield place, Fact(form="method", given=_types(inspect.signature(function).return_annotation))
        yield from _of_signature(place, function)
    elif hint is not inspect.Parameter.empty:
        yield place, Fact(given=_types(hint), required=True)
    elif value is not None:
        yield place, Fact(given=frozenset({type(value).__name__}), required=True)


def _types(annotation: Any) -> frozenset[str]:
    """Returns the types of an annotation's union, single values as JSON; names come without their modules."""
    if annotation is inspect.Parameter.empty:
        return frozenset({"anything"})
    if get_origin(annotation) in (Union, UnionType):
        return frozenset[str]().union(*map(_types, get_args(annotation)))
    if get_origin(annotation) is Literal:
        return frozenset(map(json.dumps, get_args(annotation)))
    if isinstance(annotation, str):
        text = annotation
    elif isinstance(annotation, type) and get_origin(annotation) is None:
        text = annotation.__qualname__
    else:
        text = inspect.formatannotation(annotation)
    return frozenset({re.sub(r"\b(?:\w+\.)+(?=\w)", "", text)})  # modules may move


def _default(value: Any) -> str:
    if isinstance(value, Path):
        return str(value)
    return getattr(value, "__qualname__", None) or re.sub(r" at 0x[0-9a-f]+", "", repr(value))
