"""Finding one trial of a stored run: what the run wrote down of it, as if it were a run of its own."""

from ...schemas.documents.simulation_jobs import SimulationJobDocument
from ...schemas.runs.plan import RunPlan
from ...schemas.runs.provenance import PROVENANCE_FILE
from ...schemas.runs.trial_rows import TRIALS_FILE, TrialRow, plan_of_trial
from ...schemas.wire.errors import ConfigurationError, StorageError
from ..runtime.episode.results import RESULT_FILE
from ..runtime.replay.replay import read_outputs
from ..runtime.trials.table import read_row
from .found_runs import FoundRun


def found_trial(run: FoundRun, number: int | None) -> FoundRun:
    """One trial of a run; the run itself if that has no trials and none is asked for.

    Of a trial whose application crashed, so that its job failed, nothing is known but that.

    Args:
        run: The run; what is written down of the trial goes into a folder in its own.
        number: The trial's number.

    Raises:
        ConfigurationError: The run has no trials, or it has and none is named, or this one has not finished.
        StorageError: The table of trials cannot be read.
    """
    provenance = run.outputs.provenance
    plan = provenance.plan
    if plan.trials is None:
        if number is not None:
            raise ConfigurationError(f"{plan.job_arn} has no trials; leave --trial out")
        return run
    if number is None:
        last = plan.trials.count - 1
        raise ConfigurationError(f"{plan.job_arn} has {last + 1} trials; name one with --trial, from 0 to {last}")
    try:
        trial = plan.trials.trial(number, plan.seed)
    except IndexError as error:
        raise ConfigurationError(f"--trial {number}: {error}") from None
    row = _row(run, number)
    failure_code = _failure_code(run, number, row)
    provenance = provenance.model_copy(
        update={
            "plan": plan_of_trial(plan, trial),
            "model_sha256": row.model_sha256 if row else None,
            "digest": row.digest if row else None,
            "ended_by": row.ended_by if row else None,
        }
    )
    folder = run.folder / f"trial-{number}"
    folder.mkdir()
    (folder / PROVENANCE_FILE).write_text(provenance.model_dump_json(indent=1) + "\n")
    if row is not None and row.ended_by is not None:
        (folder / RESULT_FILE).write_text(row.result().model_dump_json(indent=2) + "\n")
    return FoundRun(read_outputs(folder), folder, run.job, run.sha256_of, failure_code)


def plan_of_found_trial(plan: RunPlan, found: RunPlan) -> RunPlan:
    """A job's plan, or that of one of its trials, whichever a run was.

    Args:
        plan: The job's.
        found: The run's.
    """
    if found.trial is None or plan.trials is None:
        return plan
    return plan_of_trial(plan, plan.trials.trial(found.trial, plan.seed))


def _row(run: FoundRun, number: int) -> TrialRow | None:
    table = run.folder / TRIALS_FILE
    try:
        return read_row(table, number) if table.exists() else None
    except (ValueError, OSError) as error:
        raise StorageError(f"its outputs cannot be read: {error}") from error


def _failure_code(run: FoundRun, number: int, row: TrialRow | None) -> str | None:
    """The failure code that a trial ended with, if it crashed."""
    if row is not None:
        return row.failure_code
    document = SimulationJobDocument.of(run.job) if run.job is not None else None
    has_begun = number == 0 or _row(run, number - 1) is not None
    if document is None or document.failure_code is None or not has_begun:
        raise ConfigurationError(f"trial {number} of {run.outputs.provenance.plan.job_arn} has not finished")
    return document.failure_code
