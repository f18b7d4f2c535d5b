"""What Prefect's forms say of a flow's parameters."""

import inspect
from collections.abc import Callable
from typing import Any

from ..schemas.wire.base import Shape


def describe_parameters(function: Callable[..., Any], request: type[Shape]) -> None:
    """Puts the descriptions of a request's members into a function's docstring, where Prefect's forms get them.

    Args:
        function: the flow's function; its parameters are members of the request.
        request: the request.
    """
    lines = [f"    {name}: {request.model_fields[name].description}" for name in inspect.signature(function).parameters]
    if lines:
        function.__doc__ = "\n".join((inspect.cleandoc(function.__doc__ or ""), "", "Args:", *lines))
