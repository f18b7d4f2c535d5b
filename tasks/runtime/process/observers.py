"""Observers of a run: provenance, video, requirements, log of states (see `results.Observer`)."""

from collections.abc import Sequence
from typing import Any

from ....schemas.runs.plan import ApplicationPlan, RunPlan
from ..episode.results import Observer
from ..episode.stops import RunEnded
from ..requirements.observer import RequirementsObserver
from ..states.failure_state import FailureRecorder
from ..states.provenance import Actions, ProvenanceRecorder
from ..states.state_log_writer import StateLogger
from ..video.live_view import LiveView
from ..video.video import VideoWatcher
from ..video.video_files import STATE_LOG_FOLDER
from ..video.video_settings import settings_of
from .path_note import PathNote


class EndAt(Observer):
    """Ends a rerun where the first run was stopped from outside."""

    def __init__(self, time_s: float) -> None:
        self.next_time_s = time_s

    def watch(self, environment: Any, time_s: float) -> None:
        """End the run, like the run that is repeated."""
        del environment, time_s
        raise RunEnded("duration limit")


def make_observers(
    plan: RunPlan,
    video_backend: str | None,
    applications: Sequence[ApplicationPlan] = (),
    actions: Actions | None = None,
) -> list[Observer]:
    """Returns the observers that a plan asks for, in the order in which they look.

    Args:
        plan: The run.
        video_backend: How to render; None: no video.
        applications: What makes environment and agent, built-in ones included.
        actions: See `ProvenanceRecorder`.
    """
    found: list[Observer] = [ProvenanceRecorder(plan, applications, actions), FailureRecorder(plan.output_dir)]
    if plan.video != "none":  # also for videos that are made afterwards (`failure_videos`)
        found.append(StateLogger(plan.work_dir / STATE_LOG_FOLDER, settings_of(plan).rate_hz))
    if plan.video == "always":  # before the requirements, so that it shows the state that ended the run
        found.append(VideoWatcher(plan.output_dir, video_backend, settings_of(plan)))
    found.append(RequirementsObserver(plan))
    if plan.live_view_port is not None:
        found.append(LiveView(plan, video_backend, settings_of(plan)))
    if plan.world_dir is not None:  # for plans of worlds with the path so far
        found.append(PathNote(plan.work_dir))
    if plan.end_at_s is not None:
        found.append(EndAt(plan.end_at_s))
    return found
