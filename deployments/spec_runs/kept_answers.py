"""Responses of a run's finished steps, kept in the run folder so that a resumed run does not repeat requests."""

import json
import os
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

from ...schemas.specs.model import CheckedStep
from ...tasks.inspection.pipeline_parts import Permit

ANSWERS = "answers.json"
"""File with the responses in the folder of an ordered run, present until the run has ended."""


class KeptAnswers:
    """Carries out each request of a run once, also when its process dies and another goes on.

    A process that dies in the moment between an answer and its file leaves an application that the next one makes
    again; all else has the client token of its step.

    Args:
        folder: the run's.
        permit: carries requests out.
    """

    def __init__(self, folder: Path, permit: Permit) -> None:
        self._path = folder / ANSWERS
        self._permit = permit
        self._kept: dict[str, dict[str, Any]] = {}
        self._answered = Counter[str]()
        with suppress(OSError, ValueError):
            self._kept = json.loads(self._path.read_bytes())

    def __call__(
        self, step: CheckedStep, request: dict[str, Any], carry_out: Callable[[], dict[str, Any]]
    ) -> dict[str, Any]:
        """Carries out a step's request, or tells what it was answered before."""
        # A step of many requests asks in parts, always in the same order, and again where one was not answered.
        place = f"{step.name} {self._answered[step.name] + 1}"
        if place not in self._kept:
            self._kept[place] = self._permit(step, request, carry_out)
            self._write()
        self._answered[step.name] += 1
        return self._kept[place]

    def _write(self) -> None:
        part = self._path.with_name(f".{ANSWERS}.part")
        with os.fdopen(os.open(part, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600), "w") as file:
            json.dump(self._kept, file, default=str)
        part.replace(self._path)
