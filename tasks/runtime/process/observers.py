"""Observers of a run: video, requirements, log of states.

An observer looks at the physics from time to time and says at the end what it found. It must not change
the run: with and without it, the same seed gives the same states.
"""

from collections.abc import Sequence
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
    # Videos come before requirements, so that they show the state that ended the run.
    video_observers = _video_observers(plan, video_backend)
    recorders = [ProvenanceRecorder(plan, applications, actions), FailureRecorder(plan.output_dir)]
    observers: list[Observer] = [*recorders, *video_observers, RequirementsObserver(plan)]
    if plan.live_view_port is not None:
        observers.append(LiveView(plan, video_backend, settings_of(plan)))
    if plan.end_at_s is not None:
        observers.append(EndAt(plan.end_at_s))
    return observers


def _video_observers(plan: RunPlan, video_backend: str | None) -> list[Observer]:
    """What a video policy needs while the run goes on; the rest is made afterwards (`failure_films`)."""
    if plan.video == "none":
        return []
    settings = settings_of(plan)
    log = StateLogger(plan.work_dir / STATE_LOG_FOLDER, settings.rate_hz)
    return [log, VideoWatcher(plan.output_dir, video_backend, settings)] if plan.video == "always" else [log]
