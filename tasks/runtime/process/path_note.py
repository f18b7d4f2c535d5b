"""Notes where the robot is while a run goes on, for pages that show it."""

# MuJoCo ships no types for its compiled module.
# pyright: reportAttributeAccessIssue=false, reportInvalidTypeForm=false

import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import mujoco

from ..episode.driven_path import PATH_FILE, line_of
from ..episode.physics import raw_physics
from ..episode.results import Observer
from ..episode.robot_body import robot_body

_PERIOD_S = 0.5
"""Simulated time between two moments."""

_SLOWER_AFTER = 2_000
"""Moments after which the period doubles, again and again: the file of a run of ten hours has 250 kB."""

_WRITE_EVERY_S = 0.5
_FLAGS = os.O_WRONLY | os.O_APPEND | os.O_CREAT | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC


class PathNote(Observer):
    """Adds to the file of the path, at most twice a second; a run that is over sooner writes none."""

    def __init__(self, work_dir: Path, clock: Callable[[], float] = time.monotonic) -> None:
        """Prepares.

        Args:
            work_dir: The run's.
            clock: Seconds.
        """
        self._path, self._clock = work_dir / PATH_FILE, clock
        self._model: mujoco.MjModel | None = None
        self._body: int | None = None
        self._period_s, self._noted = _PERIOD_S, 0
        self._lines: list[str] = []
        self._due_s = clock() + _WRITE_EVERY_S

    def watch(self, environment: Any, time_s: float) -> None:
        """Notes the robot's place."""
        self.next_time_s = time_s + self._period_s
        model, data = raw_physics(environment.physics)
        if model is not self._model:
            self._model, self._body = model, robot_body(model)
        if self._body is None:
            return
        x, y, _ = data.xpos[self._body]
        self._lines.append(line_of((time_s, x, y)))
        self._noted += 1
        if self._noted % _SLOWER_AFTER == 0:
            self._period_s *= 2
        if self._clock() >= self._due_s:
            self._write()

    def _write(self) -> None:
        try:
            with os.fdopen(os.open(self._path, _FLAGS, 0o644), "w") as file:
                file.write("".join(self._lines))
        except OSError:  # the disk is full, or the application has put something else there
            self.next_time_s = float("inf")
        self._lines.clear()
        self._due_s = self._clock() + _WRITE_EVERY_S
