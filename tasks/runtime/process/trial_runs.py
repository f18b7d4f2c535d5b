"""Runs the trials of a job one after the other in the job's process.

Environment and agent of each trial begin in exactly the state that those of a job with its seed alone would begin in:
they are made anew, unless they offer `renew` (see `Renewable`), which saves compiling the model.
"""

import os
import shutil
from collections.abc import Callable
from contextlib import closing, suppress
from typing import TypeVar

from ....schemas.runs.plan import RunPlan
from ....schemas.runs.trial_rows import plan_of_trial, trial_folder
from ....schemas.runs.trials import Trial, Trials
from ..episode.progress import Phase, Progress
from ..episode.stops import RunStopped, Stop
from ..limits.run_notes import add_note
from ..states.provenance import note_run
from ..states.trial_checkpoints import TrialCheckpoints
from ..trials.completion import complete_trials
from ..trials.journal import TrialJournal, journal_path
from ..trials.tally import Tally
from .attempt import applications_of, attempt, seed_globals
from .run_request import RunRequest
from .trial_stage import TrialStage

_SEED_VARIABLE = "ROBOMAKER_SEED"
_Row = TypeVar("_Row")


def run_trials(run: RunRequest, progress: Progress, stop: Stop) -> None:
    """Runs the trials of a run, those that have finished in an earlier attempt left out, to table and `result.json`.

    Args:
        run: What to do; its plan has trials.
        progress: Where to say how far it is and how it ended.
        stop: Whether to stop.

    Raises:
        CheckpointError: Another process runs the run.
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
        _record_some(run, plan.trials, tally, stop)
    result = complete_trials(plan, stop.reason, tally)
    note_run(plan, () if result.ended_by == "canceled" else applications_of(plan), result.ended_by)
    progress.write_report({"ended_by": result.ended_by})


def _in_its_environment(run: RunRequest, trial: Trial, play: Callable[[], _Row]) -> _Row:
    """Calls something with the environment variables of a trial, and the generators of Python and numpy seeded.

    Environment and working directory are put back in case that the trial before has changed them.
    """
    os.environ[_SEED_VARIABLE] = str(trial.seed)
    wanted = {**run.environment, **trial.parameters, _SEED_VARIABLE: str(trial.seed)}
    if dict(os.environ) != wanted:
        os.environ.clear()
        os.environ.update(wanted)
    os.chdir(run.plan.work_dir)
    seed_globals(trial.seed)
    return play()


# Recordings


def _record_some(run: RunRequest, trials: Trials, tally: Tally, stop: Stop) -> None:
    """Runs trials once more, now recorded: those that are asked for, and the first that did not pass."""
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


def _record(run: RunRequest, plan: RunPlan, stop: Stop) -> None:
    """Runs one trial as a run of its own; that it fails again is no failure of the job."""
    try:
        attempt(run.model_copy(update={"plan": plan}), Progress(), stop)
    except Exception as error:
        add_note(run.plan.output_dir, f"robomaker: trial {plan.trial} was recorded until it broke: {error}")
