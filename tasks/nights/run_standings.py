"""Current state of runs (ended, running or interrupted), with their jobs and the table of results so far."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from ...schemas.reports.run_record import JobRecord, Order, RunRecord, RunState, StepRecord
from ...schemas.reports.run_states import count_outcomes, counts_in_words, state_in_words
from ...schemas.wire.errors import ConfigurationError
from ..inspection.job_outputs import places_of, results_of
from ..inspection.reports import job_records, jobs_of
from ..inspection.run_records import RECORD_NAME, read_record
from ..results.table import RESULTS_FILE, ResultTable
from ..service.service import Service
from .kept_answers import answered_requests
from .open_runs import is_going, read_order
from .run_orders import ordered_spec

RunOutcome = RunState | Literal["running", "broken off"]
"""Outcome of a whole run; or that it is still running, or was interrupted."""


@dataclass(frozen=True)
class StandingRun:
    """Current state of a run, with its record if it has ended, else with its order."""

    run_id: str
    name: str
    """Name of the specification of a run."""
    folder: Path
    outcome: RunOutcome
    steps: Sequence[StepRecord]
    """Steps of a run that were ordered so far, in order."""
    jobs: Sequence[JobRecord]
    """Simulation jobs of a run known so far, and requests that have no job (yet)."""
    record: RunRecord | None = None
    order: Order | None = None

    @property
    def has_ended(self) -> bool:
        """Whether the run has ended, with any outcome: its record is stored. A run whose process died has not."""
        return self.record is not None

    @property
    def passed(self) -> bool:
        """Whether the run succeeded, and has jobs, each of which was judged and passed."""
        return self.shown_state == "passed"

    def in_words(self) -> str:
        """Describes the run's state in one line: `failed: 3 of 4 jobs passed`."""
        return ": ".join(filter(None, (self.shown_state, counts_in_words(self.jobs))))

    @property
    def shown_state(self) -> str:
        """State of the run in the word for its jobs: `passed` if it succeeded and each of them passed."""
        return state_in_words(self.outcome, count_outcomes(self.jobs))


def stand_of(folder: Path, service: Service) -> StandingRun:
    """Returns the current state of a run.

    Args:
        folder: The run's.
        service: The service, with its catalog and object store.

    Raises:
        ConfigurationError: The folder is no run's, or its record cannot be read.
    """
    if (found := _ended(folder)) is not None:
        return found
    goes_on, order = is_going(folder), read_order(folder)
    if (found := _ended(folder)) is not None:  # just now
        return found
    if order is None:
        raise ConfigurationError(f"{folder} is no run's folder: it has neither {RECORD_NAME} nor an order")
    steps = _steps_so_far(folder, order)
    reported = jobs_of(steps, service, has_ended=False)
    return StandingRun(
        run_id=order.run_id,
        name=order.name or order.run_id.rpartition("-")[0],
        folder=folder,
        outcome="running" if goes_on else "broken off",
        steps=steps,
        jobs=job_records(reported, places_of(reported, service), service),
        order=order,
    )


def table_of(run: StandingRun, service: Service) -> ResultTable:
    """Returns a run's table of results: the one in its folder, or a new one made from its jobs.

    Args:
        run: The run.
        service: The service, with its catalog and object store.

    Raises:
        CatalogAwayError: The catalog does not answer.
    """
    if run.has_ended:
        try:
            return ResultTable.read(run.folder / RESULTS_FILE)
        except (OSError, ValueError):
            pass  # earlier releases wrote none, and a damaged one can be made again
    return results_of(run.jobs, service)


def _ended(folder: Path) -> StandingRun | None:
    if not (folder / RECORD_NAME).is_file():
        return None
    record = read_record(folder / RECORD_NAME)
    return StandingRun(
        record.run_id, record.name, folder, record.state, steps=record.steps, jobs=record.jobs, record=record
    )


def _steps_so_far(folder: Path, order: Order) -> list[StepRecord]:
    """Returns the steps that have responses, without the states of the resources that they created."""
    operations = {name: step.operation for name, step in ordered_spec(order).steps.items()}
    return [
        StepRecord(name=step, operation=operations[step], status="InProgress", arn=answer.get("arn"), output=answer)
        for step, answer in answered_requests(folder)
        if step in operations
    ]
