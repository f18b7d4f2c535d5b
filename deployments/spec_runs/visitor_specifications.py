"""Specifications that come with this package, and the check that all visitors' specifications must pass."""

import os
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

from ...schemas.settings import max_worlds_per_job
from ...schemas.specs.check import load_spec, read_as_far_as_possible
from ...schemas.specs.specification import CheckedSpec
from ...schemas.wire.errors import Problem

SHIPPED = Path(__file__).parents[1] / "specs"
"""Folder of the specifications that come with this package."""


def checked(
    text: str, filename: str, parameters: Mapping[str, Any] | None = None, *, is_complete: bool = True
) -> CheckedSpec:
    """Checks the text of a specification, including the limit on worlds.

    Args:
        text: YAML or JSON.
        filename: Name of the file in error messages.
        parameters: Values of its parameters, as `load_spec` takes them.
        is_complete: Whether each parameter has to have a value, as for a run.

    Raises:
        SpecError: The specification is invalid; the error lists all its problems.
    """
    most_worlds = max_worlds_per_job(os.environ)
    return load_spec(text, filename, parameters, is_complete=is_complete, most_worlds=most_worlds)


def checked_as_far_as_possible(
    text: str, filename: str, parameters: Mapping[str, Any] | None = None, *, is_complete: bool = True
) -> tuple[CheckedSpec, list[Problem]]:
    """Checks the text of a specification as `checked` does; returns what can be read of it, and all its problems.

    Raises:
        SpecError: The text is no YAML, or no mapping.
    """
    most_worlds = max_worlds_per_job(os.environ)
    return read_as_far_as_possible(text, filename, parameters, is_complete=is_complete, most_worlds=most_worlds)


@cache
def shipped_specs() -> dict[str, str]:
    """Returns the texts of the example specifications in this package, by name."""
    return {path.stem: path.read_text(encoding="utf-8") for path in sorted(SHIPPED.glob("*.yaml"))}
