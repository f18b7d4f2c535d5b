"""Specifications of visitors: those that come with this package, and the check that all have to pass."""

import os
from functools import cache
from pathlib import Path

from ...schemas.settings import max_worlds_per_job
from ...schemas.specs.check import load_spec
from ...schemas.specs.model import CheckedSpec
from ...schemas.specs.rooms import check_world_counts

SHIPPED = Path(__file__).parents[1] / "specs"
"""Folder of the specifications that come with this package."""


def checked(text: str, filename: str) -> CheckedSpec:
    """Checks the text of a specification, including the limit on worlds.

    Args:
        text: YAML or JSON.
        filename: file name for the messages of problems.

    Raises:
        SpecError: the specification is invalid; the error lists all its problems.
    """
    spec = load_spec(text, filename)
    check_world_counts(spec, max_worlds_per_job(os.environ))
    return spec


@cache
def shipped_specs() -> dict[str, str]:
    """Returns the texts of the example specifications in this package, by name."""
    return {path.stem: path.read_text(encoding="utf-8") for path in sorted(SHIPPED.glob("*.yaml"))}
