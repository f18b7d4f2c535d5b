"""Observers of a run: video, requirements, log of states.

An observer looks at the physics from time to time and says at the end what it found. It must not change
the run: with and without it, the same seed gives the same states.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

from ....schemas.runs.plan import ApplicationPlan, RunPlan
from ..episode.results import Findings
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


class Observer(Protocol):
    """A watcher of the run's loop (see `loop.PhysicsWatcher`) with something to say at its end."""

    next_time_s: float
    """Simulated time at which it wants to look next."""

    def watch(self, environment: Any, time_s: float) -> None:
        """Looks, and moves `next_time_s` on.

        Raises:
            RunEnded: The run is to end now.
        """
        ...

    def close(self, ended_by: str | None) -> Findings:
        """Finishes its files and returns what it found.

        Called once, also when the run failed.

        Args:
            ended_by: What ended the run; None when it failed.
        """
        ...


class EndAt:
    """Ends a rerun where the first run was stopped from outside."""

    def __init__(self, time_s: float) -> None:
        self.next_time_s = time_s

    def watch(self, environment: Any, time_s: float) -> None:
        """Ends the run, like the run that is repeated."""
        del environment, time_s
        raise RunEnded("duration limit")

    def state(self) -> None:
        """Has nothing to keep."""

    def restore(self, state: None, environment: Any) -> None:
        """Has nothing to put back."""

    def close(self, ended_by: str | None) -> Findings:
        """Has found nothing."""
        del ended_by
        return Findings()


@dataclass(frozen=True)
class _Watched:
    """Parts of the run that observers are made from; see `make_observers`."""

    plan: RunPlan
    video_backend: str | None
    applications: Sequence[ApplicationPlan]
    actions: Actions | None


def _provenance(run: _Watched) -> Observer:
    return ProvenanceRecorder(run.plan, run.applications, run.actions)


def _failure_state(run: _Watched) -> Observer:
    return FailureRecorder(run.plan.output_dir)


def _state_log(run: _Watched) -> Observer | None:
    """For videos that are made afterwards (`failure_videos`), too."""
    if run.plan.video == "none":
        return None
    return StateLogger(run.plan.work_dir / STATE_LOG_FOLDER, settings_of(run.plan).rate_hz)


def _video(run: _Watched) -> Observer | None:
    if run.plan.video != "always":
        return None
    return VideoWatcher(run.plan.output_dir, run.video_backend, settings_of(run.plan))


def _requirements(run: _Watched) -> Observer:
    return RequirementsObserver(run.plan)


def _live_view(run: _Watched) -> Observer | None:
    if run.plan.live_view_port is None:
        return None
    return LiveView(run.plan, run.video_backend, settings_of(run.plan))


def _path_note(run: _Watched) -> Observer | None:
    """For plans of worlds with the path so far."""
    return None if run.plan.world_dir is None else PathNote(run.plan.work_dir)


def _end(run: _Watched) -> Observer | None:
    return None if run.plan.end_at_s is None else EndAt(run.plan.end_at_s)


# In the order in which they look: video before requirements, so that it shows the state that ended the run.
_MAKERS: tuple[Callable[[_Watched], Observer | None], ...] = (
    _provenance,
    _failure_state,
    _state_log,
    _video,
    _requirements,
    _live_view,
    _path_note,
    _end,
)


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
    run = _Watched(plan, video_backend, applications, actions)
    return [observer for make in _MAKERS if (observer := make(run)) is not None]
