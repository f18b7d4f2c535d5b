"""Completes the outputs of a job with trials from its journal: the table, and `result.json`."""

from pathlib import Path

from ....schemas.runs.plan import RunPlan, RunResult
from ....schemas.runs.trial_rows import TRIALS_FILE, TRIALS_FOLDER
from ..episode.results import RESULT_FILE, versions, write_result
from .journal import journal_path, read_journal
from .table import write_table
from .tally import Tally

ALL_RAN = "environment"
"""Why a job ended when all of its trials ran, in the words of `RunResult.ended_by`."""


def complete_trials(plan: RunPlan, ended_by: str, tally: Tally | None = None) -> RunResult:
    """Writes table and result of a job, of as many trials as have finished.

    Args:
        plan: The job's run; it has trials.
        ended_by: Why it was stopped; does not count once all trials ran.
        tally: The count of its rows; absent: they are read.

    Returns:
        The result.

    Raises:
        OSError: The journal cannot be read, or the outputs cannot be written.
    """
    assert plan.trials is not None
    if tally is None:
        tally = Tally(plan.trials)
        for row in read_journal(journal_path(plan)):
            tally.take(row)
    recorded = recorded_trials(plan.output_dir)
    write_table(journal_path(plan), plan.output_dir / TRIALS_FILE, plan.trials, set(recorded))
    result = tally.result(ALL_RAN if tally.is_whole else ended_by, plan.seed, versions(), recorded)
    write_result(result, plan.output_dir)
    return result


def complete_after_all(plan: RunPlan, *, ended_by: str | None) -> None:
    """Writes what the run's process could not write any more; outputs that it wrote are left as they are.

    Args:
        plan: The job's run; it has trials, and none of its processes is left.
        ended_by: Why it was stopped; None: it failed, and gets no result.

    Raises:
        OSError: They cannot be written.
    """
    assert plan.trials is not None
    table, result = plan.output_dir / TRIALS_FILE, plan.output_dir / RESULT_FILE
    if ended_by is not None and not result.exists():
        complete_trials(plan, ended_by)
    elif not table.exists():
        write_table(journal_path(plan), table, plan.trials, set(recorded_trials(plan.output_dir)))


def recorded_trials(output_dir: Path) -> list[int]:
    """Numbers of trials that have a folder among the outputs of their job."""
    folder = output_dir / TRIALS_FOLDER
    if not folder.is_dir():
        return []
    return sorted(int(path.name) for path in folder.iterdir() if path.name.isdigit())
