"""Observers of a run: provenance, video, requirements, log of states, driven path."""

# MuJoCo ships no types for its compiled module.
# pyright: reportAttributeAccessIssue=false, reportInvalidTypeForm=false

import os
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import mujoco

from ....schemas.runs.plan import ApplicationPlan, RunPlan
from ..episode.physics import raw_physics, robot_body
from ..episode.progress import PATH_FILE, RunEnded, line_of
from ..episode.run_results import Observer
from ..requirements.observer import RequirementsObserver
from ..states.failure_state import FailureRecorder
from ..states.provenance import Actions, ProvenanceRecorder
from ..states.state_log import StateLogger
from ..video.live_view import LiveView
from ..video.video import VideoWatcher
from ..video.video_settings import STATE_LOG_FOLDER, settings_of
from .timeline_recorder import TimelineRecorder

_PERIOD_S = 0.5
"""Simulated seconds between two points of the path at the beginning."""

_SLOWER_AFTER = 2_000
"""Number of points after which the period doubles, again and again; the file of a ten-hour run has 250 kB."""

_WRITE_EVERY_S = 0.5
_FLAGS = os.O_WRONLY | os.O_APPEND | os.O_CREAT | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC


class PathNote(Observer):
    """Observer that writes the robot's path to a file for the live view, at most twice a second."""

    def __init__(self, work_dir: Path, clock: Callable[[], float] = time.monotonic) -> None:
        """Prepares to write the robot's path to a file for the live view.

        Args:
            work_dir: Work folder of the run.
            clock: Monotonic clock, in seconds.
        """
        self._path, self._clock = work_dir / PATH_FILE, clock
        self._model: mujoco.MjModel | None = None
        self._body: int | None = None
        self._period_s, self._noted = _PERIOD_S, 0
        self._lines: list[str] = []
        self._due_s = clock() + _WRITE_EVERY_S

    def watch(self, environment: Any, time_s: float) -> None:
        """Notes the robot's current position for the live view's path file, which is written now and then.

        Positions become rarer in long runs; without a robot body nothing is noted.
        """
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


class EndAt(Observer):
    """Observer that ends a rerun at the simulated time at which the original run was stopped."""

    def __init__(self, time_s: float) -> None:
        self.next_time_s = time_s

    def watch(self, environment: Any, time_s: float) -> None:
        """Ends the rerun, by raising `RunEnded`, at the time at which the original run was stopped."""
        del environment, time_s
        raise RunEnded("duration limit")

    def hear(self, state: bytes, time_s: float) -> None:
        """Ends the rerun in an environment without physics, by raising `RunEnded`, once its time has come."""
        del state
        if time_s >= self.next_time_s - 5e-7:  # half a microsecond forgives rounding in sums of time steps
            self.watch(None, time_s)


def make_observers(
    plan: RunPlan,
    video_backend: str | None,
    applications: Sequence[ApplicationPlan] = (),
    actions: Actions | None = None,
) -> list[Observer]:
    """Makes the observers (recorders, video, checks) that a run's plan asks for, in order.

    Args:
        plan: Plan of the run.
        video_backend: Name of the rendering backend; None: no video.
        applications: Applications that make environment and agent, built-in ones included.
        actions: Function that summarises a robot program's action log at the end; None: the robot is no program.
    """
    found: list[Observer] = [ProvenanceRecorder(plan, applications, actions), FailureRecorder(plan.output_dir)]
    if plan.video != "none":  # also for videos that are made afterwards (`failure_videos`)
        found.append(StateLogger(plan.work_dir / STATE_LOG_FOLDER, settings_of(plan).rate_hz))
    video = VideoWatcher(plan.output_dir, video_backend, settings_of(plan)) if plan.video == "always" else None
    if video is not None:  # before the requirements, so that it shows the state that ended the run
        found.append(video)
    requirements = RequirementsObserver(plan)
    found += [requirements, TimelineRecorder(plan.output_dir, requirements, video.times if video is not None else dict)]
    if plan.live_view_port is not None:
        found.append(LiveView(plan, video_backend, settings_of(plan)))
    if plan.world_dir is not None:  # for plans of worlds with the path so far
        found.append(PathNote(plan.work_dir))
    if plan.end_at_s is not None:
        found.append(EndAt(plan.end_at_s))
    return found
