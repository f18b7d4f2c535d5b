"""Failures of the newest jobs, grouped by their reasons under the names of specifications."""

import re
from collections.abc import Iterable
from dataclasses import dataclass
from urllib.parse import urlencode

from starlette.responses import Response

from ....schemas.documents.simulation_jobs import JobInBrief
from ....schemas.reports.run_record import CUT_SHORT, JobRecord, RunRecord
from ....schemas.reports.run_states import mended_failures
from ....schemas.specs.challenge_requests import is_sabotaged
from ....tasks.catalog import Resource
from ....tasks.comparison.compared_runs import TRIALS
from ....tasks.inspection.run_records import is_night
from ..job_states import JOB, JobLine, job_line, named_in_run
from ..rendering import HOME
from ..run_records import JobsInRuns, RecordOf, record_of, run_name, runs_in_need
from ..visit import Visit

_LOOKED_AT = 200
"""Number of the newest jobs that are searched for failures."""

NO_RUN = "Ordered without a specification"
"""Heading of the failures of jobs that SDKs and other programs ordered."""

_TRIALS_FAILED = "trials did not pass"
"""Reason of a job of which only that is known, and not what its trials missed."""

_MISSED = re.compile(r"(?:^|; )([A-Za-z0-9_-]+): ")
"""Names of missed requirements in a verdict's reason: `quick: ended at 12 s; soft: 9 N`."""


@dataclass(frozen=True)
class FailureGroup:
    """Failures of one specification for one reason."""

    specification: str
    """Name of the specification; of jobs that no specification made, words that say so."""
    reason: str
    """Names of the missed requirements, as the report has them, or the failure code."""
    known: str
    """Owner, last day and reason if the failure is known; else empty."""
    jobs: tuple[JobLine, ...]
    """Jobs that failed so, the newest first."""
    current: int
    """Number of the jobs that are of no run before the specification's newest one."""

    @property
    def is_past(self) -> bool:
        """Whether the newest run of the specification has no such failure any more."""
        return self.current == 0

    is_mended: bool = False
    """Whether the newest run's specification still has the known failure, which none of its judged jobs had."""

    @property
    def to_remove(self) -> str:
        """Says that a known failure can be removed from its specification; empty if it cannot."""
        if not (self.is_mended and self.is_past):
            return ""
        return "did not occur in the newest run; remove it from `known`"

    @property
    def is_without_run(self) -> bool:
        """Whether the jobs were ordered by SDKs or other programs, so that no run has a record of them."""
        return self.specification == NO_RUN

    @property
    def newest(self) -> JobLine:
        """The newest of the jobs that failed for this reason."""
        return self.jobs[0]

    @property
    def address(self) -> str:
        """URL path of the page with all jobs of the group."""
        members = {"specification": self.specification, "reason": self.reason, "known": self.known}
        return f"{HOME}/failures?{urlencode({name: value for name, value in members.items() if value})}"


def failure_groups(visit: Visit, record_of_run: RecordOf | None = None) -> list[FailureGroup]:
    """Groups the failures among the newest jobs that a visitor may see, by specification and reason.

    Args:
        visit: The visit.
        record_of_run: As for `grouped`, called once a run; absent: whether the visitor may see the run is asked anew.

    Returns:
        The groups, by the time of the newest failure of their specifications and then of their own.
    """
    page = visit.service.catalog.list(JOB, limit=_LOOKED_AT, members=JobInBrief.members())
    return grouped(visit.seen(page.resources), record_of_run or (lambda run_id: record_of(run_id, visit)))


def grouped(jobs: Iterable[Resource], record_of_run: RecordOf) -> list[FailureGroup]:
    """Groups failures by specification and reason.

    Args:
        jobs: Jobs, the newest first; those that did not fail are left out, and those that a challenge has sabotaged,
            which have to.
        record_of_run: Returns the record of a run by its id; `None` while it goes on, or where there is none.
    """
    in_runs = JobsInRuns(record_of_run)
    listed = [(job, JobInBrief.of(job).spec_run or "") for job in jobs]
    records = {run_id: in_runs.record_of(run_id) for _, run_id in listed if run_id}
    newest = _newest_nights(record for record in records.values() if record is not None)
    mended = {name: tuple(map(str, mended_failures(record))) for name, record in newest.items()}
    found: dict[str, dict[tuple[str, str], list[tuple[JobLine, bool]]]] = {}
    for job, run_id in listed:
        line = job_line(job)
        if not line.is_failure or is_sabotaged(job.tags):
            continue
        record, short = records.get(run_id), in_runs.find(job.arn, run_id)
        name = run_name(run_id, record) or NO_RUN
        known = short.known if short is not None else ""
        is_past = record is not None and record.name in newest and record.started_at < newest[record.name].started_at
        reason = reason_of(line, job, short)
        found.setdefault(name, {}).setdefault((reason, known), []).append((named_in_run(line, short), is_past))
    return [
        FailureGroup(
            name,
            reason,
            known,
            tuple(line for line, _ in lines),
            sum(not past for _, past in lines),
            bool(known) and known.startswith(mended.get(name, ())),
        )
        for name, groups in found.items()
        for (reason, known), lines in groups.items()
    ]


def _newest_nights(records: Iterable[RunRecord]) -> dict[str, RunRecord]:
    """Returns the newest run of each specification of those that had all its jobs to their ends.

    A rerun, the probe of a forecast, and a run that was cut short or stopped early say nothing of the other jobs.
    """
    found: dict[str, RunRecord] = {}
    for record in records:
        is_whole = record.state not in CUT_SHORT and not (record.against and record.against.stopped_early)
        if is_night(record) and is_whole:
            found[record.name] = max(record, found.get(record.name, record), key=lambda each: each.started_at)
    return found


def reason_of(line: JobLine, job: Resource, record: JobRecord | None) -> str:
    """Returns the reason of a failure in the words of the report's table: missed requirements, or the failure code.

    Args:
        line: Row of the job.
        job: The job.
        record: Its record in its run; `None`: it has none, or the run goes on, and the job's own reason has the names.
    """
    brief = JobInBrief.of(job)
    if job.status == "Failed":
        return brief.failure_code or line.reason or job.status
    names = _missed(record) if record is not None else _MISSED.findall(brief.verdict_reason or "")
    if record is None and TRIALS in names:  # what follows is about its trials
        names = [TRIALS]
    if names == [TRIALS]:
        return _TRIALS_FAILED
    return ", ".join(dict.fromkeys(name.replace("_", " ") for name in names)) or line.reason or line.look.value


def _missed(record: JobRecord) -> list[str]:
    """Returns the names of the missed requirements; of a job with trials those that its failing trials missed."""
    missed = [item for item in record.requirements if not item.satisfied]
    if any(item.name == TRIALS for item in missed):
        in_trials = [item.name for item in missed if item.name != TRIALS and not item.is_aside(of_trials=True)]
        return in_trials or [TRIALS]
    return [item.name for item in missed if item.counts]


def show_all(visit: Visit) -> Response:
    """Web page with failures by reason, or with all jobs of the group that the address names.

    A group that is not there any more has no jobs on its page.
    """
    groups = failure_groups(visit)
    wanted = tuple(visit.parameter(name) for name in ("specification", "reason", "known"))
    one = next((each for each in groups if (each.specification, each.reason, each.known) == wanted), None)
    jobs = [] if one is None else list(one.jobs)
    return visit.page(
        "failures_page.html.j2",
        groups=groups,
        in_need=runs_in_need(visit, lambda run_id: record_of(run_id, visit)),
        one=one,
        wanted=wanted,
        failures=jobs,
        posters=visit.context.posters.of([*jobs, *(each.newest for each in groups)]),
    )


PAGES = {"/failures": show_all}
