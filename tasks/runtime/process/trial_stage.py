"""The stage of a job's trials: plays one after the other, and keeps the environment for the next where it may."""

from collections.abc import Mapping
from typing import Any, Protocol

import dm_env
import numpy as np

from ....schemas.runs.plan import RunPlan, RunResult
from ....schemas.runs.provenance import StateDigestSummary
from ....schemas.runs.trial_rows import TrialRow, plan_of_trial
from ....schemas.runs.trials import Trial
from ....schemas.runs.variables import without_secrets
from ....schemas.wire.errors import LaunchError
from ..episode.context import SimulationContext
from ..episode.health import PhysicsHealth
from ..episode.loading import LoadError
from ..episode.physics import raw_physics
from ..episode.progress import Phase, Progress
from ..episode.results import Episode, Observer, make_result
from ..episode.stops import Stop
from ..recording.recorder import Recorder
from ..requirements.observer import RequirementsObserver
from ..states.digest import LOOK_EVERY_S, ModelDigests, StateDigest
from ..states.failure_state import FailureRecorder
from .attempt import applications_of, contexts_of, factory_of, read_world
from .failures import log_failure, report_of
from .loop import Agent, run_episode

_STOPPED = ("duration limit", "canceled")
_CRASH_CODES = {"robot": "RobotApplicationCrash", "simulation": "SimulationApplicationCrash"}


class RenewableEnvironment(Protocol):
    """An environment that serves more than one trial."""

    def renew(self, context: SimulationContext) -> None:
        """Puts everything where making it anew with this context would; `reset` follows.

        Its parameters and its world are those that it was made with, its seed and its generator are others.
        """
        ...


class RenewableAgent(Protocol):
    """An agent that serves more than one trial."""

    def renew(self, context: SimulationContext, environment: dm_env.Environment) -> None:
        """Puts everything where making it anew would; the environment is the one that it was made for."""
        ...


def renews(part: RenewableEnvironment | RenewableAgent | None) -> bool:
    """Whether an environment or an agent serves more than one trial."""
    return callable(getattr(part, "renew", None))


class TrialStage:
    """Environment and agent of a job's trials.

    Args:
        plan: The job's run.
        progress: Told what begins.
        stop: Whether to stop.

    Raises:
        LoadError: An application cannot be imported.
    """

    def __init__(self, plan: RunPlan, progress: Progress, stop: Stop) -> None:
        self._plan, self._progress, self._stop = plan, progress, stop
        self._without_secrets = without_secrets(plan).trials
        simulation, robot = applications_of(plan)
        progress.mark(Phase.MAKE_ENVIRONMENT)
        self._make_environment = factory_of(simulation)
        progress.mark(Phase.MAKE_AGENT)
        self._make_agent = factory_of(robot)
        self._world = read_world(plan.world_dir)
        self._digests = ModelDigests()
        self._recorder = Recorder()
        self._environment: Any = None
        self._agent: Any = None
        self._parameters: Mapping[str, str] = {}
        """Those that the environment was made with."""
        self.unanswered = ""
        """Message about code that did not answer when a trial was stopped; empty: no answer was awaited."""
        self._between_substeps: Any = None
        """Function that its physics called between substeps when it was made."""

    def play(self, trial: Trial) -> TrialRow | None:
        """Plays one trial to its end.

        Args:
            trial: Which.

        Returns:
            Its row; None if it was stopped from outside.

        Raises:
            Exception: Any exception of the applications, unless the run's failure behaviour is `Continue`; then only
                those that every trial would raise.
        """
        plan = plan_of_trial(self._plan, trial)
        context, robot_context = contexts_of(plan, np.random.default_rng(plan.seed), self._world, self._recorder)
        digest, failures = _TrialDigest(self._digests), FailureRecorder(plan.output_dir, LOOK_EVERY_S)
        requirements, health = RequirementsObserver(plan, self._world), PhysicsHealth()
        try:
            episode = run_episode(
                lambda: self._environment_for(trial, context),
                lambda environment: self._agent_for(robot_context, environment),
                mark=self._progress.mark,
                stop=self._stop,
                recorder=self._recorder,
                watchers=(digest, failures, requirements),
                health=health,
                keep_open=True,
            )
        except Exception as error:
            self._environment = self._agent = None
            if where := failures.explain():
                error.add_note(where)
            if plan.failure_behavior != "Continue" or isinstance(error, LaunchError | LoadError):
                error.add_note(f"in {self._told(trial)}")
                failures.close(None)
                raise
            log_failure(error)
            return _broken(self._told(trial), report_of(error, self._progress))
        if episode.ended_by in _STOPPED:
            self.unanswered = episode.unanswered
            return None
        summary = digest.finish()
        findings = [observer.close(episode.ended_by) for observer in (health, failures, requirements)]
        row = _row(self._told(trial), make_result(episode, plan.seed, findings), episode, summary)
        return row.model_copy(update={"model_sha256": digest.model_sha256})

    def _told(self, trial: Trial) -> Trial:
        """The trial as people are told of it, without secrets among its parameters."""
        trials = self._without_secrets
        return trials.trial(trial.number, self._plan.seed) if trials is not None else trial

    def close(self) -> None:
        """Closes the environment."""
        environment, self._environment, self._agent = self._environment, None, None
        if environment is not None:
            environment.close()

    def _environment_for(self, trial: Trial, context: SimulationContext) -> Any:
        environment = self._environment
        if renews(environment) and trial.parameters == self._parameters:
            physics: Any = getattr(environment, "physics", None)
            if hasattr(physics, "between_substeps"):  # requirements of the trial before have added theirs
                physics.between_substeps = self._between_substeps
            environment.renew(context)
            return environment
        self.close()  # and with it the agent, which may have taken something from the environment
        environment = self._make_environment(context)
        self._environment, self._parameters = environment, trial.parameters
        self._between_substeps = getattr(getattr(environment, "physics", None), "between_substeps", None)
        return environment

    def _agent_for(self, context: SimulationContext, environment: dm_env.Environment) -> Agent:
        if renews(self._agent):
            self._agent.renew(context, environment)
        else:
            self._agent = self._make_agent(context, environment)
        return self._agent


class _TrialDigest(Observer):
    """Keeps the digest of a trial's states; see `ProvenanceRecorder`."""

    def __init__(self, digests: ModelDigests) -> None:
        self._digest = StateDigest(None, digests.of)
        self._data: Any = None

    def watch(self, environment: Any, time_s: float) -> None:
        model, self._data = raw_physics(environment.physics)
        self._digest.look(model, self._data)
        self.next_time_s = time_s + LOOK_EVERY_S

    def finish(self) -> StateDigestSummary | None:
        return self._digest.finish(self._data)

    @property
    def model_sha256(self) -> str | None:
        return self._digest.model_sha256


def _row(trial: Trial, result: RunResult, episode: Episode, digest: StateDigestSummary | None) -> TrialRow:
    return TrialRow(
        trial=trial.number,
        seed=trial.seed,
        parameters=dict(trial.parameters),
        verdict=result.verdict,
        reason=result.reason or "",
        ended_by=episode.ended_by,
        sim_time_s=result.sim_time_s,
        wall_time_s=result.wall_time_s,
        steps=episode.steps,
        requirements=result.requirements,
        metrics={name: value for name, value in result.metrics.items() if name != "steps"},
        notes=result.notes,
        state_digest=digest.value if digest else None,
        looks=digest.looks if digest else 0,
        digest_until_s=digest.until_s if digest else 0.0,
    )


def _broken(trial: Trial, report: Mapping[str, Any]) -> TrialRow:
    """The row of a trial that an exception ended."""
    role = Phase(report["phase"]).role
    return TrialRow(
        trial=trial.number,
        seed=trial.seed,
        parameters=dict(trial.parameters),
        verdict="ERROR",
        reason=report["error"],
        failure_code=_CRASH_CODES[role] if role else "InternalServiceError",
    )
