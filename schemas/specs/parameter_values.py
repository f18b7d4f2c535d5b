"""Formatting of parameter values: for people, and as command line options."""

import json
import shlex
from collections.abc import Mapping
from typing import TypeAlias

ParameterValue: TypeAlias = str | int | float | bool


def set_options(values: Mapping[str, ParameterValue]) -> list[str]:
    """Returns command line options that set parameters: `["--set", "worlds=20"]`."""
    return [word for name, value in values.items() for word in ("--set", f"{name}={value_in_words(value)}")]


def param_options(values: Mapping[str, ParameterValue]) -> list[str]:
    """Returns options of `prefect deployment run` that set parameters; their values are JSON."""
    return [f"--param={name}={value_in_words(value, as_json=True)}" for name, value in values.items()]


def value_in_words(value: ParameterValue, *, as_json: bool = False) -> str:
    """Returns a parameter's value as people write it: `true`, `20`, `scout`.

    Args:
        value: The value.
        as_json: Whether a text that JSON would read as another type, such as `20`, gets quotes.
    """
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str) and as_json and _is_read_by_json(value):
        return json.dumps(value)
    return str(value)


def _is_read_by_json(text: str) -> bool:
    try:
        json.loads(text)
    except ValueError:
        return False
    return True


def values_in_words(values: Mapping[str, ParameterValue]) -> str:
    """Returns values with their names in one line, as a shell has them: `robot=scout worlds=20`."""
    return " ".join(f"{name}={shlex.quote(value_in_words(value))}" for name, value in values.items())
