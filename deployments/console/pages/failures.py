"""Failures of the newest jobs, grouped by their reasons under the names of specifications."""

import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import cache
from urllib.parse import urlencode

from starlette.responses import Response

from ....schemas.documents.simulation_jobs import JobInBrief
from ....schemas.reports.run_record import JobRecord, RunRecord
from ....tasks.catalog import Resource
from ....tasks.comparison.compared_runs import TRIALS
from ..job_states import JOB, JobLine, job_line, named_in_run
from ..rendering import HOME
from ..runs import record_of
from ..visit import Visit

_LOOKED_AT = 200
"""Number of the newest jobs that are searched for failures."""

_NO_SPECIFICATION = "No specification"
_TIME_IN_RUN = re.compile(r"-\d{8}T\d+$")
_MISSED = re.compile(r"(?:^|; )([A-Za-z0-9_-]+): ")
"""Names of missed requirements in a verdict's reason: `quick: ended at 12 s; soft: 9 N`."""


RecordOf = Callable[[str], RunRecord | None]


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
    return grouped(visit.seen(page.resources), cache(record_of_run or (lambda run_id: record_of(run_id, visit))))


def grouped(jobs: Iterable[Resource], record_of_run: RecordOf) -> list[FailureGroup]:
    """Groups failures by specification and reason.

    Args:
        jobs: Jobs, the newest first; those that did not fail are left out.
        record_of_run: Returns the record of a run by its id; `None` while it goes on, or where there is none.
    """
    found: dict[str, dict[tuple[str, str], list[JobLine]]] = {}
    by_run: dict[str, Mapping[str, JobRecord]] = {}
    for job in jobs:
        line = job_line(job)
        if not line.is_failure:
            continue
        run_id = JobInBrief.of(job).spec_run or ""
        record = record_of_run(run_id) if run_id else None
        if run_id not in by_run:
            by_run[run_id] = {} if record is None else {each.arn: each for each in record.jobs if each.arn}
        short = by_run[run_id].get(job.arn)
        name = record.name if record is not None else _TIME_IN_RUN.sub("", run_id) or _NO_SPECIFICATION
        known = short.known if short is not None else ""
        reason = reason_of(line, job, short)
        found.setdefault(name, {}).setdefault((reason, known), []).append(named_in_run(line, short))
    return [
        FailureGroup(name, reason, known, tuple(lines))
        for name, groups in found.items()
        for (reason, known), lines in groups.items()
    ]


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
        one=one,
        wanted=wanted,
        failures=jobs,
        posters=visit.context.posters.of([*jobs, *(each.newest for each in groups)]),
    )


PAGES = {"/failures": show_all}
