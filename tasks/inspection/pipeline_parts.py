"""Helpers of pipelines: reading a specification, hooks that change or permit requests, and errors as text."""

import logging
import signal
from collections.abc import Callable
from pathlib import Path
from typing import Any

from ...schemas.reports.run_record import RunRecord
from ...schemas.specs.specification import CheckedStep
from ...schemas.wire.errors import ConfigurationError, Problem, RobomakerError, ServiceError, SpecError

_logger = logging.getLogger(__name__)

Cut = Callable[[str, dict[str, Any]], dict[str, Any]]
"""Function that replaces an operation's request by another one, such as a smaller one."""

Permit = Callable[[CheckedStep, dict[str, Any], Callable[[], dict[str, Any]]], dict[str, Any]]
"""Function that runs a step's request, or refuses to: gets the step, the request, and a function that runs it."""


class RunInterrupted(KeyboardInterrupt):
    """Raised when Ctrl-C or a signal ended a run; its jobs have been cancelled, and its report is written.

    Args:
        record: Record of the run.
        signal_number: Number of the signal.
    """

    def __init__(self, record: RunRecord, signal_number: int = signal.SIGINT) -> None:
        super().__init__()
        self.record = record
        self.signal_number = signal_number


def permit_all(step: CheckedStep, request: dict[str, Any], carry_out: Callable[[], dict[str, Any]]) -> dict[str, Any]:
    """Runs a step's request without asking for permission; the default."""
    del step, request
    return carry_out()


def read_spec_file(path: Path) -> str:
    """Reads the text of a specification file.

    Raises:
        ConfigurationError: The file cannot be read.
    """
    try:
        return path.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise ConfigurationError(
            f"spec is '{path}', looked for in {Path.cwd()}: {error.strerror}; a deployment that is made by "
            "`robomaker deploy` keeps the specification itself"
        ) from error


def error_in_words(error: Exception) -> str:
    """Returns the reason for a step's failure as text; an unexpected error is also logged."""
    if isinstance(error, ServiceError):
        return f"{error.code}: {error}"
    if isinstance(error, RobomakerError):
        return str(error)
    _logger.error("a step broke", exc_info=error)
    return f"{type(error).__name__}: {error}"


_NAMES_ITS_OBJECT = ("there is no ", "'")
"""Beginnings of problems that name what they are about themselves, so that no path has to."""


def refusal_in_words(error: Exception) -> str:
    """Returns the reason for which a run was refused, in one line: `there is no robot application 'x' (a.yaml:11:45)`.

    A specification with several problems has them all.
    """
    if not isinstance(error, SpecError):
        return error_in_words(error)
    return "; ".join(dict.fromkeys(map(_problem_in_words, error.problems)))


def _problem_in_words(problem: Problem) -> str:
    is_clear = not problem.path or problem.message.startswith(_NAMES_ITS_OBJECT)
    return f"{'' if is_clear else f'{problem.path}: '}{problem.message} ({problem.place})"
