"""Results that programs write themselves: what they say counts, also where the file is not quite as it should be."""

import json
import math
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, get_args

from pydantic import ValidationError

from ....schemas.runs.plan import RunResult, Verdict
from ..episode.results import MAX_RESULT_BYTES, RESULT_FILE, versions
from ..limits.left_files import read_left

_VERDICTS = get_args(Verdict)


@dataclass(frozen=True)
class ProgramResult:
    """Contents of the `result.json` that a program left."""

    result: RunResult | None = None
    """The result; `None`: there is no file, or it is no result."""

    problem: str | None = None
    """Why the file is no result; `None`: it is one, or there is none."""

    is_changed: bool = False
    """Whether the file does not have the result's form, so that it has to be written anew."""


def read_program_result(output_dir: Path, facts: Mapping[str, Any]) -> ProgramResult:
    """Reads the result that a program wrote.

    Only `verdict` has to be there: a byte order mark is skipped, members that a result does not have go to `extra`,
    numbers that are not finite go there as text, and what is missing is filled in.

    Args:
        output_dir: The run's output folder.
        facts: Members that the runtime knows and a program may leave out.
    """
    path = output_dir / RESULT_FILE
    if not os.path.lexists(path):
        return ProgramResult()
    try:
        content = read_left(path, MAX_RESULT_BYTES)
    except OSError as error:
        return ProgramResult(problem=f"{RESULT_FILE} cannot be read: {error.strerror or error}")
    try:
        result = RunResult.model_validate_json(content)
        if _all_finite(result):
            return ProgramResult(result)
    except ValidationError:
        pass
    try:
        return ProgramResult(_lenient(content, facts), is_changed=True)
    except ValueError as error:  # of JSON, of UTF-8, of the form
        return ProgramResult(problem=f"{RESULT_FILE} is no result: {_words(error)}")


def _lenient(content: bytes, facts: Mapping[str, Any]) -> RunResult:
    said = json.loads(content.decode("utf-8-sig"))
    if not isinstance(said, dict) or said.get("verdict") not in _VERDICTS:
        raise ValueError(f"it has no `verdict` of {', '.join(_VERDICTS)}")
    known = {name: value for name, value in said.items() if name in RunResult.model_fields}
    own = known.get("extra")
    extra: dict[str, Any] = dict(own) if isinstance(own, dict) else {}
    extra |= {name: value for name, value in said.items() if name not in known}
    metrics = known.get("metrics")
    if isinstance(metrics, dict):
        odd = {name: str(value) for name, value in metrics.items() if not _is_finite(value)}
        known["metrics"] = {name: value for name, value in metrics.items() if name not in odd}
        if odd:
            extra["not_finite"] = odd
    known["extra"] = _as_text_where_not_finite(extra)
    result = RunResult.model_validate({**facts, "versions": versions(), **known}, strict=False)
    if not _all_finite(result):
        raise ValueError("a number in it is not finite")
    return result


def _is_finite(value: Any) -> bool:
    return not isinstance(value, float) or math.isfinite(value)


def _all_finite(result: RunResult) -> bool:
    """Whether it can be written as JSON and read again."""
    try:
        json.dumps(result.model_dump(mode="python"), allow_nan=False, default=str)
    except ValueError:
        return False
    return True


def _as_text_where_not_finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {name: _as_text_where_not_finite(item) for name, item in value.items()}
    if isinstance(value, list):
        return [_as_text_where_not_finite(item) for item in value]
    return value if _is_finite(value) else str(value)


def _words(error: ValueError) -> str:
    if isinstance(error, ValidationError):
        first = error.errors()[0]
        return f"{'.'.join(map(str, first['loc']))}: {first['msg']}"
    return str(error)
