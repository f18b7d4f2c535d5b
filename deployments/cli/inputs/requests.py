"""Requests of operations as people give them: a file, JSON or YAML text, or standard input."""

import sys
from typing import Any

from .specifications import read_text


def read_request(given: str, operation: str) -> dict[str, Any]:
    """The members of a request.

    Args:
        given: a file's path or `file://` address, JSON or YAML text that begins with `{`, or `-` for standard input.
        operation: the operation's name.

    Raises:
        ServiceError: it is no request of this operation.
    """
    from ....schemas.specs.check import load_request
    from ....schemas.specs.resolving import resolve_input

    text, name = _text(given)
    checked = load_request(text, name, operation)
    return resolve_input(checked.steps[checked.order[0]], {})


def _text(given: str) -> tuple[str, str]:
    """The request's text and what to call it in messages."""
    if given == "-":
        return sys.stdin.read(), "standard input"
    if given.lstrip().startswith("{"):
        return given, "--input"
    path = given.removeprefix("file://")
    return read_text(path), path
