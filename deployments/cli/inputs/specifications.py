"""Files that the user names: specifications, and requests of operations."""

import sys
from pathlib import Path
from typing import Any

from ....schemas.operations.registry import OPERATIONS
from ....schemas.specs.model import CheckedSpec
from ....schemas.wire.errors import ConfigurationError, Place, Problem, SpecError
from ...spec_runs.visitor_specifications import SHIPPED, checked


class InputFileError(ConfigurationError):
    """Raised for a file named by the user that cannot be read."""


def read_text(path: str) -> str:
    """Reads a text file that the user named.

    Raises:
        InputFileError: the file cannot be opened.
        SpecError: the file is not UTF-8 text.
    """
    try:
        return Path(path).read_bytes().decode("utf-8-sig")
    except OSError as error:
        raise InputFileError(f"{path}: {(error.strerror or str(error)).lower()}") from error
    except UnicodeDecodeError as error:
        problem = Problem(Place(path, 1, 1), "", f"this is not UTF-8 text: {error.reason} at byte {error.start}")
        raise SpecError([problem]) from error


def read_spec(path: str) -> CheckedSpec:
    """Reads and checks a specification file.

    Args:
        path: a file; or `quickstart` or `nightly`, if no such file exists: these are built in.

    Raises:
        InputFileError: the file cannot be opened.
        SpecError: the specification is invalid; the error lists all its problems.
    """
    shipped = SHIPPED / f"{path}.yaml"
    is_shipped = "." not in path and "/" not in path and not Path(path).exists() and shipped.is_file()
    return checked(read_text(str(shipped) if is_shipped else path), path)


def read_request(given: str, operation: str) -> dict[str, Any]:
    """Reads the members of an API request from a file, JSON or YAML text, or standard input.

    Args:
        given: a file's path or `file://` address, JSON or YAML text that begins with `{`, or `-` for standard input.
        operation: the operation's name.

    Raises:
        ServiceError: the text is not a valid request of this operation.
    """
    from ....schemas.specs.check import load_request
    from ....schemas.specs.resolving import resolve_input

    text, name = _text(given)
    checked = load_request(text, name, operation)
    return resolve_input(checked.steps[checked.order[0]], {})


def _text(given: str) -> tuple[str, str]:
    """Returns the request's text, and its name for error messages."""
    if given == "-":
        return sys.stdin.read(), "standard input"
    if given.lstrip().startswith("{"):
        return given, "--input"
    path = given.removeprefix("file://")
    return read_text(path), path


def operation_name(word: str) -> str:
    """Converts an operation's name from the AWS CLI's spelling (`describe-world`) to the service's.

    A word that names no operation is returned unchanged; the check of the request suggests a similar name.
    """
    folded = word.replace("-", "").lower()
    return next((name for name in OPERATIONS if name.lower() == folded), word)
