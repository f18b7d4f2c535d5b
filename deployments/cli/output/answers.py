"""Responses as text: JSON or YAML, times in ISO 8601."""

import json
import sys
from datetime import UTC, datetime
from typing import Any


def print_answer(answer: dict[str, Any], form: str) -> None:
    """Prints a response as JSON or YAML."""
    sys.stdout.write(_as_yaml(answer) if form == "yaml" else _as_json(answer))


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
