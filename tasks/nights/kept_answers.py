"""Responses of a run's finished requests, kept in its folder so that a resumed run does not repeat them."""

import json
import os
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

from ...schemas.specs.specification import CheckedStep
from ..inspection.pipeline_parts import Permit
from ..operations.step_operations import step_registry

ANSWERS = "answers.jsonl"
"""Name of the file in a run's folder with one response a line, which exists until the run has ended."""


class KeptAnswers:
    """Stores the response of each request of a run, so that a resumed run does not repeat requests.

    A process that dies in the moment between an answer and its line leaves an application that the next one makes
    again; all else has the client token of its step.

    Args:
        folder: The run's.
        permit: Carries requests out.
    """

    def __init__(self, folder: Path, permit: Permit) -> None:
        self._path = folder / ANSWERS
        self._permit = permit
        self._kept = _read(self._path)
        self._answered = Counter[str]()

    def has(self, step: str) -> bool:
        """Whether the next request of a step has a stored response."""
        return self._place(step) in self._kept

    def __call__(
        self, step: CheckedStep, request: dict[str, Any], carry_out: Callable[[], dict[str, Any]]
    ) -> dict[str, Any]:
        """Sends a step's request and stores the response, or returns the response that an earlier process stored.

        Of a job only its ARN is stored. Errors of the request are raised, and nothing is stored then.
        """
        place = self._place(step.name)
        if place not in self._kept:
            answer = self._permit(step, request, carry_out)
            # Of a job the rest is in the catalog, and may be a megabyte for each batch of a campaign.
            is_job = step_registry()[step.operation].run_job is not None
            self._write(place, {"arn": answer["arn"]} if is_job else answer)
            self._kept[place] = answer
        self._answered[step.name] += 1
        return self._kept[place]

    def _place(self, step: str) -> str:
        # A step of many requests asks in parts, always in the same order, and again where one was not answered.
        return f"{step} {self._answered[step] + 1}"

    def _write(self, place: str, answer: dict[str, Any]) -> None:
        with os.fdopen(os.open(self._path, os.O_RDWR | os.O_CREAT | os.O_APPEND, 0o600), "r+b") as file:
            size = file.seek(0, os.SEEK_END)
            is_torn = size > 0 and os.pread(file.fileno(), 1, size - 1) != b"\n"
            file.write(b"\n" * is_torn + json.dumps({place: answer}, default=str).encode() + b"\n")
            file.flush()
            os.fsync(file.fileno())


def answered_requests(folder: Path) -> list[tuple[str, dict[str, Any]]]:
    """Returns the stored responses of a run that has not ended, in order.

    Args:
        folder: The run's.

    Returns:
        The step and the response of each request; of a job only its ARN.
    """
    return [(place.rpartition(" ")[0], answer) for place, answer in _read(folder / ANSWERS).items()]


def _read(path: Path) -> dict[str, dict[str, Any]]:
    kept: dict[str, dict[str, Any]] = {}
    with suppress(OSError):
        for line in path.read_text(encoding="utf-8").splitlines():
            with suppress(ValueError):  # the last one may be torn
                kept |= json.loads(line)
    return kept
