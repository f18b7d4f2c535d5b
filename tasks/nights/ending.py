"""Finishes a run of a specification: determines its state, writes report and record, sends notifications."""

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import datetime
from functools import partial
from pathlib import Path
from typing import Protocol, TypeVar
from uuid import UUID

from ...schemas.reports.forecast import ForecastCheck
from ...schemas.reports.live_comparison import AgainstAnswer
from ...schemas.reports.progress import Note, ProgressListener
from ...schemas.reports.report import RunState
from ...schemas.reports.run_exit_codes import EXIT_CODES
from ...schemas.reports.run_record import Interruption, JobRecord, RunRecord, SourceCommit, StepRecord
from ...schemas.reports.run_states import run_state
from ...schemas.settings import Settings
from ...schemas.specs.batch_splitting import step_of
from ...schemas.specs.specification import CheckedSpec
from ..notifications.notices import notify_of
from ..service.service import Service
from .pings import ping_end
from .wanted_runs import WantedRun

_logger = logging.getLogger(__name__)

Result = TypeVar("Result")


class Outlasting(Protocol):
    """Interface of a function that calls another one again until the catalog's database answers."""

    def __call__(self, call: Callable[[], Result], /) -> Result:
        """Calls a function, again after outages of the catalog's database, and returns its result."""
        ...


@dataclass(frozen=True)
class RunFacts:
    """Facts of a run that are known when it begins: the order, id, folder, start time."""

    wanted: WantedRun
    run_id: str
    started_at: datetime
    source: SourceCommit | None
    folder: Path


def finish_run(
    facts: RunFacts,
    steps: list[StepRecord],
    settings: Settings,
    service: Service | None,
    listener: ProgressListener,
    *,
    ended_at: datetime,
    is_canceled: bool,
    against: AgainstAnswer | None,
    interruptions: Sequence[Interruption],
    flow_run: str | None,
    outlasting: Outlasting,
) -> RunRecord:
    """Writes the report and record of a run, however it ended, and sends notifications.

    Args:
        facts: Facts of the run that are known when it begins.
        steps: Results of its steps.
        settings: Settings that say who is notified and called.
        service: The service, with its catalog and object store; `None`: it cannot be opened, and there is no report.
        listener: Called with problems.
        ended_at: End of the run, UTC.
        is_canceled: Whether somebody ended it.
        against: Result of the comparison, if the run was compared with an earlier one.
        interruptions: Times at which its processes died.
        flow_run: Id of the flow run that ends it.
        outlasting: Waits for the catalog.
    """
    # Slow to import, and not needed before.
    from ..inspection.reports import installed_versions, publish_report
    from ..inspection.run_records import write_record

    ended_early = against is not None and against.stopped_early and not is_canceled

    def state_of(jobs: list[JobRecord]) -> RunState:
        return state_of_run(facts.wanted.checked, steps, jobs, is_canceled=is_canceled, ended_early=ended_early)

    record = RunRecord(
        run_id=facts.run_id,
        name=facts.wanted.checked.name,
        spec_path=facts.wanted.spec_path,
        parameters=dict(facts.wanted.checked.parameters),
        worlds=dict(facts.wanted.checked.found_worlds),
        command=facts.wanted.repeated_by,
        state="broken",
        exit_code=EXIT_CODES["broken"],
        started_at=facts.started_at,
        ended_at=ended_at,
        steps=steps,
        versions=installed_versions(),
        rerun_of=facts.wanted.rerun_of,
        reuse=facts.wanted.reuse,
        probe=facts.wanted.is_probe,
        challenge=facts.wanted.challenge,
        interruptions=list(interruptions),
        known=list(facts.wanted.checked.known),
        against=against,
        run_dir=facts.folder,
        source=facts.source,
        flow_run=UUID(flow_run) if flow_run else None,
    )
    if service is not None:
        # A forecast is of a run that nothing interrupts.
        if not (is_canceled or interruptions or ended_early or record.refusal):
            forecast = outlasting(partial(_forecast, facts, steps, service, ended_at))
            record = record.model_copy(update={"forecast": forecast})
        try:
            record = outlasting(partial(publish_report, record, service, state_of))
        except Exception as error:
            _logger.exception("the report could not be written")
            listener(Note(f"the report could not be written: {type(error).__name__}: {error}"))
    (facts.folder / "spec.yaml").write_text(facts.wanted.checked.text_for_others)
    write_record(record)
    notify_of(record, settings, service, listener)
    if is_pinged(facts):
        ping_end(settings.ping_url, record, lambda text: listener(Note(text)))
    return record


def is_pinged(facts: RunFacts) -> bool:
    """Whether a monitoring URL is called when this run ends: only for full nightly runs, not for reruns and probes."""
    return facts.wanted.rerun_of is None and not facts.wanted.is_probe


def _forecast(facts: RunFacts, steps: list[StepRecord], service: Service, ended_at: datetime) -> ForecastCheck | None:
    """Compares the run with its forecast; `None` for a run that may run less than was forecast."""
    from ..inspection.forecasting import check_forecast

    if facts.wanted.is_probe or facts.wanted.rerun_of or service.reuses:
        return None
    return check_forecast(facts.wanted.checked, service.settings, steps, facts.started_at, ended_at)


def state_of_run(
    checked: CheckedSpec,
    steps: list[StepRecord],
    jobs: list[JobRecord],
    *,
    is_canceled: bool,
    ended_early: bool = False,
) -> RunState:
    """Determines the state of a whole run from its steps and jobs.

    Args:
        checked: The specification.
        steps: Results of its steps.
        jobs: Simulation jobs of the run.
        is_canceled: Whether somebody ended it.
        ended_early: Whether it cancelled jobs itself, since the others had answered the question; they do not count.
    """
    statuses = [step.status for step in steps]
    if ended_early:
        ran = [job for job in jobs if job.status != "Canceled" and job.failure_code != "BatchCanceled"]
        return run_state([status for status in statuses if status != "Canceled"], ran)
    was_cut = is_canceled and "Skipped" in statuses
    recorded = {step.name for step in steps}
    seen_to = recorded | {step_of(name) for name in recorded}
    is_whole = seen_to.issuperset(checked.order) and not was_cut
    return run_state(statuses, jobs, is_whole=is_whole)
