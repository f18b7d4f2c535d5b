"""What Prefect's forms show of a flow's parameters: descriptions, and choices that are seen at once."""

import inspect
import types
import typing
from collections.abc import Callable
from typing import Any

from ..schemas.wire.base import Model, Shape


def describe_parameters(function: Callable[..., Any], request: type[Shape]) -> None:
    """Gives a function what Prefect makes a deployment's form of: docstring and signature.

    The docstring gets the section `Args` from the descriptions of the request's members. In the signature, an optional
    parameter has the type of its values alone. With `None` among its types, the form would ask for a type first and
    show the choices only behind it. Optional objects stay so: their own required members are asked for only then.
    A parameter that is left out is `None`, as before.

    Args:
        function: the flow's function; its parameters are members of the request.
        request: the request.
    """
    signature = inspect.signature(function, eval_str=True)
    lines = [f"    {name}: {request.model_fields[name].description}" for name in signature.parameters]
    if lines:
        function.__doc__ = "\n".join((inspect.cleandoc(function.__doc__ or ""), "", "Args:", *lines))
    shown = [
        each.replace(annotation=_present(each.annotation)) if each.default is None else each
        for each in signature.parameters.values()
    ]
    setattr(function, "__signature__", signature.replace(parameters=shown))  # noqa: B010 - functions declare no such name


def _present(annotation: Any) -> Any:
    """A type without `None`, unless it is an object."""
    if typing.get_origin(annotation) not in (typing.Union, types.UnionType):
        return annotation
    kinds = [kind for kind in typing.get_args(annotation) if kind is not types.NoneType]
    if any(isinstance(kind, type) and issubclass(kind, Model) for kind in kinds):
        return annotation
    return typing.Union[tuple(kinds)]  # noqa: UP007 - there may be any number
