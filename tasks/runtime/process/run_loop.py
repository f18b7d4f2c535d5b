"""Simulation loop of a run: environment and agent, step by step, with clock and joint states for the recording."""

import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from typing import Any, cast

import dm_env
import numpy as np

from ....schemas.runs.programs import RunStop
from ..episode.context import ActionError, ObservationError
from ..episode.health import PhysicsHealth
from ..episode.physics import raw_physics
from ..episode.progress import Phase, RunEnded, RunStopped, Stop, unanswered
from ..episode.run_results import (
    EnvironmentReport,
    Episode,
    NotingAgent,
    Observer,
    ReportingEnvironment,
    read_notes,
    read_report,
)
from ..recording.recording import Recorder
from ..recording.state_series import STATE_RATE_HZ, StateSeries, hinges_and_slides
from ..states.checkpoints import Checkpointer, LoopState, RunParts


class JointStateWatcher(Observer):
    """Observer that records `/clock` and `/joint_states` for environments that record nothing themselves."""

    def __init__(self, recorder: Recorder) -> None:
        self._recorder = recorder
        self._series: StateSeries | None = None

    def watch(self, environment: Any, time_s: float) -> None:
        """Records the positions, velocities and efforts of the model's hinge and slide joints at the present time."""
        model, data = raw_physics(environment.physics)
        series = self._series
        if series is None or data is not series.data:
            # Environments may make a new model with every episode.
            if series is not None:
                self._recorder.remove_series(series)
            series = self._series = StateSeries(model, data, hinges_and_slides(model).tolist())
            self._recorder.add_series(series)
        series.sample(self._recorder)
        # From now rather than from the time it was due: control steps may be longer than the interval.
        self.next_time_s = time_s + 1.0 / STATE_RATE_HZ


Agent = Callable[[dm_env.TimeStep], Any]


def run_episode(
    make_environment: Callable[[], dm_env.Environment],
    make_agent: Callable[[dm_env.Environment], Agent],
    *,
    mark: Callable[[int], None],
    stop: Stop,
    recorder: Recorder,
    watchers: Sequence[Observer] = (),
    health: PhysicsHealth | None = None,
    checkpoints: Checkpointer | None = None,
    keep_open: bool = False,
    count_step: Callable[[int, float], None] = lambda *_: None,
    wall_clock: Callable[[], float] = time.perf_counter,
) -> Episode:
    """Makes environment and agent, and runs the loop of actions and observations until the episode ends.

    The environment ends the run with a last time step, the agent by raising `StopIteration`, both by `sys.exit(0)`.

    Args:
        make_environment: Function that makes the environment.
        make_agent: Function that makes the agent for the environment.
        mark: Called with the phase that begins (`Phase`), so that a crash can be attributed.
        stop: Tells whether the run has to stop.
        recorder: Gets clock and joint states of environments with a `physics` that do not set
            `records_itself`.
        watchers: Look at the physics of environments that have one; hear the states that others give. Those with a
            `last_look` are asked once more at the end, before the environment is closed, whatever the environment.
        health: Looks at every step, before the watchers; absent: one that only fails diverged physics.
        checkpoints: Makes checkpoints, and continues from one if there is one.
        count_step: Told after each step how many are done, and the simulated time.
        keep_open: Whether the environment is not closed, because other episodes follow.
        wall_clock: Seconds of real time.

    Returns:
        Outcome of the episode, with the environment's report.

    Raises:
        PhysicsError: The physics diverged.
        CheckpointError: The last checkpoint cannot be continued from.
        Exception: Any exception of environment or agent.
    """
    health = health or PhysicsHealth()
    loop = _Loop(mark, stop, wall_clock, health, count_step)
    environment: dm_env.Environment | None = None
    agent: Agent | None = None
    try:
        mark(Phase.MAKE_ENVIRONMENT)
        environment = make_environment()
        _check_environment(environment)
        mark(Phase.MAKE_AGENT)
        loop.agent_runs = True
        agent = make_agent(environment)
        loop.agent_runs = False
        if not callable(agent):
            raise TypeError(f"the agent is {_shown(agent)}; it has to be a function of a time step")
        if recorder.enabled and not getattr(environment, "records_itself", False):
            watchers = (JointStateWatcher(recorder), *watchers)
        watchers = (health, *watchers)
        parts = RunParts(environment, agent, watchers, recorder)
        if checkpoints is not None:
            checkpoints.begin(parts)
        loop.run(parts, checkpoints)
    except RunStopped as stopped:
        loop.ended_by, loop.interrupted = stop.reason, stopped.phase
    except RunEnded as end:
        loop.ended_by = end.ended_by
    except SystemExit as request:
        if request.code not in (None, 0):
            raise
        loop.ended_by = "agent" if loop.agent_runs else "environment"
    except Exception as error:
        loop.annotate(error)
        raise
    return loop.finish(environment, agent, watchers, keep_open=keep_open)


class _Loop:
    """State of one episode of the simulation loop (steps, time, stop reason), with the loop itself."""

    def __init__(
        self,
        mark: Callable[[int], None],
        stop: Stop,
        wall_clock: Callable[[], float],
        health: PhysicsHealth,
        count_step: Callable[[int, float], None],
    ) -> None:
        self.ended_by = ""
        self.interrupted: Phase | None = None
        """Phase that was interrupted because code did not return after the run was told to stop."""
        self.agent_runs = False
        self._mark = mark
        self._stop = stop
        self._wall_clock = wall_clock
        self._health = health
        self._count_step = count_step
        self._steps = 0
        self._clock = _SimulatedClock(None, ())
        self._wall_time_s = 0.0
        self._earlier_s = 0.0
        """Wall-clock time of earlier attempts, in seconds."""

    def run(self, parts: RunParts, checkpoints: Checkpointer | None = None) -> None:
        mark, stop, environment, agent = self._mark, self._stop, parts.environment, parts.agent
        agent_phase, step_phase, look = int(Phase.AGENT), int(Phase.STEP), self._health.look_at_timestep
        count_step = self._count_step
        mark(Phase.RESET)
        began = self._wall_clock()
        try:
            timestep = _checked_timestep(environment.reset(), "reset")
            self._clock = clock = _SimulatedClock(environment, parts.watchers)
            if checkpoints is not None and checkpoints.resumes:
                timestep = self._resume(checkpoints.resume(parts))
            else:
                clock.tick()
            while not timestep.last():
                if stop.reason:
                    self.ended_by = stop.reason
                    return
                if checkpoints is not None and checkpoints.due(clock.time_s):
                    wall_time_s = self._earlier_s + self._wall_clock() - began
                    checkpoints.save(parts, LoopState(timestep, self._steps, clock.time_s, wall_time_s))
                mark(agent_phase)
                self.agent_runs = True
                try:
                    action = agent(timestep)
                except StopIteration:
                    self.ended_by = "agent"
                    return
                except ObservationError:
                    mark(step_phase)  # noticed by the agent, made by the environment
                    raise
                self.agent_runs = False
                mark(step_phase)
                try:
                    timestep = _checked_timestep(environment.step(action), "step")
                except ActionError:
                    mark(agent_phase)  # noticed by the environment, made by the agent
                    raise
                except Exception as error:
                    if _has_bad_numbers(action):  # looked at now only: at each step it would cost microseconds
                        mark(agent_phase)
                        raise ActionError(f"the action {repr(action)[:80]} has numbers that are not finite") from error
                    raise
                self._steps += 1
                clock.tick()
                count_step(self._steps, clock.time_s)
                look(timestep)
            self.ended_by = "environment"
        finally:
            self._wall_time_s = self._earlier_s + self._wall_clock() - began

    def _resume(self, state: LoopState) -> dm_env.TimeStep:
        """Restores the counters from a checkpoint of an earlier attempt, and returns the time step to go on from."""
        self._steps, self._clock.time_s, self._earlier_s = state.steps, state.time_s, state.wall_time_s
        return state.timestep

    def annotate(self, error: Exception) -> None:
        """Adds a note to an exception that says in which step, and at which simulated time, it was raised."""
        if self._steps:
            time_s = self._clock.time_s
            error.add_note(f"in step {self._steps + 1}" + (f", at {time_s:.3f} s simulated" if time_s else ""))

    def _notes_of(self, agent: Agent | None) -> list[str]:
        """Returns what an agent says of its run; an error in that takes nothing from the run, which has ended."""
        if self.interrupted is not None or not callable(getattr(agent, "run_notes", None)):
            return []
        try:
            return read_notes(cast("NotingAgent", agent))
        except Exception as error:
            return [f"no notes of the agent: its run_notes raised {type(error).__name__}: {error}"]

    def finish(
        self,
        environment: dm_env.Environment | None,
        agent: Agent | None,
        watchers: Sequence[Any],
        *,
        keep_open: bool,
    ) -> Episode:
        report, notes = EnvironmentReport(), list[str]()
        if environment is not None:
            try:
                self._mark(Phase.REPORT)
                for watcher in watchers:
                    if hasattr(watcher, "last_look") and self.ended_by != "canceled":
                        watcher.last_look(environment)
                report = read_report(environment)
                if not keep_open:
                    environment.close()
                notes = self._notes_of(agent)
            except RunStopped as stopped:
                self.interrupted = self.interrupted or stopped.phase
            except Exception:
                # An environment that was stopped before it began need not know how to report.
                if self._steps:
                    raise
        time_s = self._clock.time_s or self._steps * _control_timestep(environment)
        judges = isinstance(environment, ReportingEnvironment)
        is_cut = self.interrupted is not None and self._stop.reason == RunStop.DURATION_LIMIT
        silence = unanswered(self.interrupted, self._steps, time_s) if is_cut and self.interrupted else ""
        records = bool(getattr(environment, "records_itself", False))
        return Episode(self.ended_by, report, self._steps, time_s, self._wall_time_s, judges, silence, notes, records)


def _has_bad_numbers(action: Any) -> bool:
    """Whether an action, or a value of a mapping, has NaN or infinite numbers."""
    parts = action.values() if isinstance(action, Mapping) else (action,)
    with suppress(TypeError, ValueError):  # what is no array of numbers
        arrays = [np.asarray(part) for part in parts]
        return any(array.dtype.kind == "f" and not np.isfinite(array).all() for array in arrays)
    return False


def _check_environment(environment: Any) -> None:
    if not all(callable(getattr(environment, method, None)) for method in ("reset", "step")):
        raise TypeError(f"the environment is {_shown(environment)}; it has to be a dm_env.Environment")


def _checked_timestep(timestep: Any, method: str) -> dm_env.TimeStep:
    if isinstance(timestep, dm_env.TimeStep):
        return timestep
    raise TypeError(f"environment.{method}() returned {_shown(timestep)}; it has to return a dm_env.TimeStep")


def _shown(value: object) -> str:
    return "None" if value is None else f"of type {type(value).__name__}"


class _SimulatedClock:
    """Follows the time of an environment's physics, or else of its steps where it gives its states as bytes."""

    def __init__(self, environment: Any, watchers: Sequence[Observer]) -> None:
        self.time_s = 0.0
        self._environment = environment
        self._watchers = watchers
        self._has_physics = hasattr(getattr(environment, "physics", None), "data")
        self._step_s = 0.0 if self._has_physics else _control_timestep(environment)
        self._gives_states = self._step_s > 0 and _gives_bytes(environment)
        self._steps = 0

    def tick(self) -> None:
        """Takes over the simulated time in seconds from the physics, and calls the observers that are due.

        Without physics no observer is called.
        """
        if not self._has_physics:
            if self._gives_states:
                self._hear()
            return
        time_s = self._environment.physics.data.time
        self.time_s = time_s
        for watcher in self._watchers:
            # Half a microsecond forgives rounding in sums of time steps.
            if time_s >= watcher.next_time_s - 5e-7:
                watcher.watch(self._environment, time_s)

    def _hear(self) -> None:
        state = self._environment.state()
        if not isinstance(state, bytes):
            raise TypeError(
                f"environment.state() returned {_shown(state)}; it returned bytes before, and has to go on so"
            )
        self.time_s = self._steps * self._step_s
        self._steps += 1
        for watcher in self._watchers:
            watcher.hear(state, self.time_s)


def _gives_bytes(environment: Any) -> bool:
    """Whether `state()` is for the digest: one that gives anything else is for checkpoints only."""
    state = getattr(environment, "state", None)
    return callable(state) and isinstance(state(), bytes)


def _control_timestep(environment: Any) -> Any:
    """Returns the simulated seconds of a step of an environment without physics; 0 if it has no such attribute."""
    timestep = getattr(environment, "control_timestep", None)
    return timestep() if callable(timestep) else 0.0
