"""`robomaker call`: one operation, as an SDK would call it."""

import argparse
import json
import os
import sys
from datetime import UTC, datetime
from typing import Any

from ...schemas.operations import OPERATIONS
from ...schemas.settings import Settings
from ...schemas.spec import resolve_input
from ...schemas.spec_check import load_request
from .specs import read_text

_BAD_ENDS = {"Failed": 3, "Canceled": 4, "TimedOut": 5}


def execute(arguments: argparse.Namespace) -> int:
    """Calls the operation and prints its response."""
    operation = operation_name(arguments.operation)
    text, name = _input(arguments.input)
    checked = load_request(text, name, operation)
    request = resolve_input(checked.steps[checked.order[0]], {})
    settings = Settings.from_environment(os.environ)
    answer = _call(operation, request, settings, wait=arguments.wait)
    sys.stdout.write(_as_yaml(answer) if arguments.output == "yaml" else _as_json(answer))
    if OPERATIONS[operation].is_job and not arguments.wait:
        sys.stderr.write("The job is stored and waits to be performed; --wait carries it to its end here and now.\n")
        return 0
    return _BAD_ENDS.get(str(answer.get("status")), 0) if arguments.wait else 0


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


def _call(operation: str, request: dict[str, Any], settings: Settings, *, wait: bool) -> dict[str, Any]:
    if wait and OPERATIONS[operation].is_job:
        from .prefect_server import use_server

        use_server(settings)
    from ...flows.operation import call, perform_flow
    from ...tasks.service import Service

    service = Service.open(settings)
    answer = call(operation, request, service)
    if wait and OPERATIONS[operation].is_job:
        with service.activated():
            return perform_flow(operation)(answer["arn"])
    return answer


def _as_json(answer: dict[str, Any]) -> str:
    return json.dumps(answer, indent=2, ensure_ascii=False, default=_time_text) + "\n"


def _as_yaml(answer: dict[str, Any]) -> str:
    from io import StringIO

    from ruamel.yaml import YAML

    text = StringIO()
    writer = YAML()
    writer.width = 10_000  # long ARNs stay on their line
    writer.dump(json.loads(_as_json(answer)), text)
    return text.getvalue()


def _time_text(value: object) -> str:
    if isinstance(value, datetime):
        return value.astimezone(UTC).isoformat()
    raise TypeError(f"{value!r} has no JSON form")
