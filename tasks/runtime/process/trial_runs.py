"""Runs with trials: one process runs all trials, writes each trial's results, and records some again."""

import os
import shutil
from collections.abc import Callable, Mapping
from contextlib import closing, suppress
from typing import Any, Protocol, TypeVar

import dm_env
import numpy as np

from ....schemas.runs.plan import RunPlan, RunResult
from ....schemas.runs.provenance import StateDigestSummary
from ....schemas.runs.trial_rows import TrialRow, plan_of_trial, trial_folder
from ....schemas.runs.trials import Trial, TrialRecordings, Trials, number_axes
from ....schemas.runs.variables import without_secrets
from ....schemas.wire.errors import LaunchError
from ..axes.variation import Variation
from ..episode.context import SimulationContext
from ..episode.health import PhysicsHealth
from ..episode.loading import LoadError
from ..episode.physics import raw_physics
from ..episode.progress import Phase, Progress, RunStopped, Stop
from ..episode.run_results import Episode, Observer, make_result
from ..limits.logs import add_note, own_logs
from ..recording.recording import Recorder
from ..requirements.observer import RequirementsObserver
from ..states.checkpoint_files import TrialCheckpoints
from ..states.digest import LOOK_EVERY_S, ModelDigests, StateDigest
from ..states.failure_state import FailureRecorder
from ..states.provenance import note_run
from ..trials.completion import TrialJournal, complete_trials, journal_path
from ..trials.tally import Tally
from .attempt import applications_of, attempt, contexts_of, factory_of, log_failure, read_world, report_of, seed_globals
from .run_loop import Agent, run_episode
from .run_request import RunRequest

_STOPPED = ("duration limit", "canceled")
_CRASH_CODES = {"robot": "RobotApplicationCrash", "simulation": "SimulationApplicationCrash"}


class RenewableEnvironment(Protocol):
    """Interface of an environment that can be reused for several trials of a job."""

    def renew(self, context: SimulationContext) -> None:
        """Prepares the environment for the next trial's seed, as if it were made anew; `reset` follows.

        Environment variables and world are those that it was made with; seed and random generator are new. Numeric
        values of the trial's axes have already been applied.
        """
        ...


class RenewableAgent(Protocol):
    """Interface of an agent that can be reused for several trials of a job."""

    def renew(self, context: SimulationContext, environment: dm_env.Environment) -> None:
        """Prepares the agent for the next trial, as if it were made anew."""
        ...


def renews(part: RenewableEnvironment | RenewableAgent | None) -> bool:
    """Returns whether an environment or agent has a method `renew` for several trials; false if there is none."""
    return callable(getattr(part, "renew", None))


class TrialStage:
    """Environment and agent that run the trials of a job one after the other.

    Args:
        plan: Plan of the job's run.
        progress: Memory for the phase that begins.
        stop: Tells whether the run has to stop.

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
        self._variables: Mapping[str, str] = {}
        """Environment variables with which the environment was made."""
        self._variation = Variation(number_axes(plan.trials)) if plan.trials is not None else Variation({})
        self.unanswered = ""
        """Message about code that did not answer when a trial was stopped; empty: none."""
        self._between_substeps: Any = None
        """Function that the environment's physics called between substeps when it was made."""

    def play(self, trial: Trial) -> TrialRow | None:
        """Runs one trial to its end, and returns its results.

        Args:
            trial: Trial to run.

        Returns:
            Row of results; None if the trial was stopped from outside.

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
                watchers=(self._variation, digest, failures, requirements),
                health=health,
                keep_open=True,
            )
        except Exception as error:
            self._environment = self._agent = None
            if where := failures.explain():
                error.add_note(where)
            if plan.failure_behavior != "Continue" or isinstance(error, LaunchError | LoadError):
                error.add_note(f"in {self._with_hidden_secrets(trial)}")
                failures.close(None)
                raise
            log_failure(error)
            return _broken(self._with_hidden_secrets(trial), report_of(error, self._progress))
        if episode.ended_by in _STOPPED:
            self.unanswered = episode.unanswered
            return None
        summary = digest.finish()
        findings = [observer.close(episode.ended_by) for observer in (health, failures, requirements)]
        row = _row(self._with_hidden_secrets(trial), make_result(episode, plan.seed, findings), episode, summary)
        return row.model_copy(update={"model_sha256": digest.model_sha256})

    def _with_hidden_secrets(self, trial: Trial) -> Trial:
        """Returns the trial for logs and tables, with secret values of its axes removed."""
        trials = self._without_secrets
        return trials.trial(trial.number, self._plan.seed) if trials is not None else trial

    def close(self) -> None:
        """Closes the environment that the trials run in, if there is one, and forgets it and its agent.

        The next trial makes new ones.
        """
        environment, self._environment, self._agent = self._environment, None, None
        if environment is not None:
            environment.close()

    def _environment_for(self, trial: Trial, context: SimulationContext) -> Any:
        environment, axes = self._environment, context.plan.axes
        if renews(environment) and trial.variables == self._variables:
            physics: Any = getattr(environment, "physics", None)
            if hasattr(physics, "between_substeps"):  # requirements of the trial before have added theirs
                physics.between_substeps = self._between_substeps
            self._variation.set(axes)
            environment.renew(context)
            return environment
        self.close()  # and with it the agent, which may have taken something from the environment
        environment = self._make_environment(context)
        self._environment, self._variables = environment, trial.variables
        self._variation.applied(environment, axes)
        self._between_substeps = getattr(getattr(environment, "physics", None), "between_substeps", None)
        return environment

    def _agent_for(self, context: SimulationContext, environment: dm_env.Environment) -> Agent:
        if renews(self._agent):
            self._agent.renew(context, environment)
        else:
            self._agent = self._make_agent(context, environment)
        return self._agent


class _TrialDigest(Observer):
    """Keeps the hash of a trial's simulation states; see `ProvenanceRecorder`."""

    def __init__(self, digests: ModelDigests) -> None:
        self._digest = StateDigest(None, digests.of)
        self._data: Any = None

    def watch(self, environment: Any, time_s: float) -> None:
        model, self._data = raw_physics(environment.physics)
        self._digest.look(model, self._data)
        self.next_time_s = time_s + LOOK_EVERY_S

    def hear(self, state: bytes, time_s: float) -> None:
        self._digest.look_at(state, time_s)

    def finish(self) -> StateDigestSummary | None:
        return self._digest.finish(self._data)

    @property
    def model_sha256(self) -> str | None:
        return self._digest.model_sha256


def _row(trial: Trial, result: RunResult, episode: Episode, digest: StateDigestSummary | None) -> TrialRow:
    return TrialRow(
        trial=trial.number,
        seed=trial.seed,
        axes=dict(trial.axes),
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
    """Returns the result row of a trial that ended with an exception: verdict ERROR, reason and failure code."""
    role = Phase(report["phase"]).role
    return TrialRow(
        trial=trial.number,
        seed=trial.seed,
        axes=dict(trial.axes),
        verdict="ERROR",
        reason=report["error"],
        failure_code=_CRASH_CODES[role] if role else "InternalServiceError",
    )


_SEED_VARIABLE = "ROBOMAKER_SEED"
_Row = TypeVar("_Row")


def run_trials(run: RunRequest, progress: Progress, stop: Stop) -> None:
    """Runs a job's unfinished trials, and writes the table of their results and `result.json`.

    Args:
        run: Request with the run's plan, which has trials.
        progress: Memory for the run's progress and final report.
        stop: Tells whether the run has to stop.

    Raises:
        CheckpointError: Another process executes the run.
        OSError: The outputs cannot be written.
        Exception: Any exception of the applications, unless the run's failure behaviour is `Continue`.
    """
    plan = run.plan
    assert plan.trials is not None
    note_run(plan)
    tally = Tally(plan.trials)
    checkpoints = TrialCheckpoints(plan)
    journal = TrialJournal(journal_path(plan), tally.take)
    progress.finish_trials(journal.rows)
    with closing(journal), closing(checkpoints), suppress(RunStopped):  # it may be stopped between two trials
        stage = TrialStage(plan, progress, stop)
        for number in range(journal.rows, plan.trials.count):
            if stop.reason:
                break
            trial = plan.trials.trial(number, plan.seed)
            row = _in_its_environment(run, trial, lambda trial=trial: stage.play(trial))
            progress.mark(Phase.FINISHING)
            if row is None:
                tally.unanswered = stage.unanswered
                break
            journal.append(row)
            tally.take(row)
            progress.finish_trials(journal.rows)
            checkpoints.save_if_due(journal.rows, tally.sim_time_s)
        else:
            # Not closed when a trial breaks: its environment is in no state to be.
            stage.close()
    progress.mark(Phase.FINISHING)
    if tally.is_whole:
        _record_some(run, plan.trials, tally, progress, stop)
    result = complete_trials(plan, stop.reason, tally)
    note_run(plan, () if result.ended_by == "canceled" else applications_of(plan), result.ended_by)
    progress.write_report({"ended_by": result.ended_by})


def _in_its_environment(run: RunRequest, trial: Trial, play: Callable[[], _Row]) -> _Row:
    """Calls a function with a trial's environment variables and with seeded generators, and returns its result.

    Environment variables and working directory are restored first, in case the trial before has changed them.
    """
    os.environ[_SEED_VARIABLE] = str(trial.seed)
    wanted = {**run.environment, **trial.variables, _SEED_VARIABLE: str(trial.seed)}
    if dict(os.environ) != wanted:
        os.environ.clear()
        os.environ.update(wanted)
    os.chdir(run.plan.work_dir)
    seed_globals(trial.seed)
    return play()


# Recordings


def _record_some(run: RunRequest, trials: Trials, tally: Tally, progress: Progress, stop: Stop) -> None:
    """Runs some trials again with a recording: the requested ones, and the first ones that did not pass.

    Replaces the folders of these trials. Once the job has to stop, the others are left out, and a note in the outputs
    says so.
    """
    plan = run.plan
    failed = tally.first_failing[: trials.record_failed]
    if not plan.record and plan.video == "none":
        failed = []  # their rows say all there is
    wanted = sorted({*failed, *(trials.record or ())})
    for place, number in enumerate(wanted):
        if stop.reason:
            left = ", ".join(map(str, wanted[place:]))
            add_note(
                plan.output_dir, f"robomaker: not recorded, since the job was stopped ({stop.reason}): trials {left}"
            )
            return
        trial = trials.trial(number, plan.seed)
        is_filmed = plan.video == "always" or (plan.video == "on-failure" and number in failed)
        told = TrialRecordings(finished=place, total=len(wanted), trial=number, filmed=is_filmed)
        progress.record_trial(told)
        changes = {"video": "always" if is_filmed else "none", "live_view_port": None, "checkpoint_dir": None}
        folder = plan.output_dir / trial_folder(number)
        again = plan_of_trial(plan, trial).model_copy(update={**changes, "output_dir": folder})
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
        _in_its_environment(run, trial, lambda again=again: _record(run, again, stop))
        if stop.reason:
            add_note(
                plan.output_dir, f"robomaker: trial {number} was recorded until the job was stopped ({stop.reason})"
            )
        progress.record_trial(told.model_copy(update={"finished": place + 1}))


def _record(run: RunRequest, plan: RunPlan, stop: Stop) -> None:
    """Runs one trial again as a separate recorded run.

    An error of it is noted in the outputs, and does not fail the job.
    """
    try:
        with own_logs(plan.output_dir):
            attempt(run.model_copy(update={"plan": plan}), Progress(), stop)
    except Exception as error:
        add_note(run.plan.output_dir, f"robomaker: trial {plan.trial} was recorded until it broke: {error}")
