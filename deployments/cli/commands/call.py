"""`robomaker call`: one operation, as an SDK would call it."""

import argparse
import os
import sys
from typing import Any

from ....schemas.operations.registry import OPERATIONS
from ....schemas.settings import Settings
from ....schemas.specs.check import load_request
from ....schemas.specs.model import resolve_input
from ..inputs.specifications import read_text
from ..output.answers import print_answer
from .perform import perform


def execute(arguments: argparse.Namespace) -> int:
    """Calls the operation and prints its response."""
    operation = operation_name(arguments.operation)
    text, name = _input(arguments.input)
    checked = load_request(text, name, operation)
    request = resolve_input(checked.steps[checked.order[0]], {})
    settings = Settings.from_environment(os.environ)
    if arguments.wait and OPERATIONS[operation].is_job:
        return perform(operation, _stored(operation, request, settings)["arn"], settings, arguments.output)
    answer = _stored(operation, request, settings)
    print_answer(answer, arguments.output)
    if OPERATIONS[operation].is_job:
        sys.stderr.write(f"The job is stored; `robomaker perform {answer['arn']}` carries it to its end.\n")
    return 0


def operation_name(word: str) -> str:
    """The service's name of an operation, also from the AWS CLI's spelling: `describe-world`."""
    folded = word.replace("-", "").lower()
    return next((name for name in OPERATIONS if name.lower() == folded), word)


def _input(given: str) -> tuple[str, str]:
    """The request's text and what to call it in messages."""
    if given == "-":
        return sys.stdin.read(), "standard input"
    if given.lstrip().startswith("{"):
        return given, "--input"
    path = given.removeprefix("file://")
    return read_text(path), path


def _stored(operation: str, request: dict[str, Any], settings: Settings) -> dict[str, Any]:
    from ....tasks.operations.registry import call
    from ....tasks.service.service import Service

    return call(operation, request, Service.open(settings))
