"""Results of a challenge (jobs with sabotages), read from the jobs of its run, and notes on it while they run."""

from collections.abc import Callable, Sequence
from contextlib import suppress

from ...schemas.documents.simulation_jobs import JobInBrief
from ...schemas.reports.challenge import Challenge
from ...schemas.reports.report import ReportedJob
from ...schemas.reports.run_record import JobRecord
from ...schemas.reports.run_states import plain_reason
from ...schemas.runs.axis_kinds.kind import why_not_applicable
from ...schemas.runs.plan import RunResult, Verdict
from ...schemas.specs.challenge_requests import JOB_TAG, SABOTAGE_TAG
from ...schemas.wire.errors import ServiceUnavailableException
from ..catalog import Catalog, Resource
from ..results.challenge_verdicts import CRASH_CODES, Arm, table_of
from ..results.table import ResultTable

_VERDICTS: dict[str, Verdict] = {"PASS": "PASS", "FAIL": "FAIL", "ERROR": "ERROR", "NONE": "NONE"}


def judged_challenge(
    challenge: Challenge, jobs: Sequence[ReportedJob], records: Sequence[JobRecord], results: ResultTable
) -> Challenge:
    """Fills a challenge's result table from the jobs of its run.

    Args:
        challenge: The challenge with its sabotages.
        jobs: Jobs of the run.
        records: Short records of the same jobs, in the same order.
        results: Table of the run's results.
    """
    arms = [
        _arm(int(tags[JOB_TAG]), tags.get(SABOTAGE_TAG), record, results, job.result)
        for job, record in zip(jobs, records, strict=True)
        if JOB_TAG in (tags := job.request.get("tags") or {})
    ]
    return table_of(challenge, arms)


def _arm(number: int, sabotage: str | None, record: JobRecord, results: ResultTable, result: RunResult | None) -> Arm:
    name = " in ".join(filter(None, (f"job {number}", record.world_title)))
    reason = _line(record.failure_reason)
    blank = Arm(
        number,
        name,
        sabotage,
        failure_code=record.failure_code,
        reason=": ".join(filter(None, (record.failure_code or record.status, reason))),
        not_applicable=why_not_applicable(reason) if sabotage is not None else "",
    )
    rows = results.rows_of(record)
    # A program's only trial is an ordinary run, whose row has no number.
    if record.status != "Completed" or len(rows) != 1 or results.numbers("trial")[rows[0]] > 0:
        return blank
    row = rows[0]
    return Arm(
        number,
        name,
        sabotage,
        verdict=_VERDICTS.get(results.texts("verdict")[row] or ""),
        requirements=results.requirements_at(row),
        failure_code=results.texts("failure_code")[row],
        reason=_line(results.texts("reason")[row]),
        state_digest=results.texts("state_digest")[row] or (result.state_digest if result else None),
    )


def _line(text: str | None) -> str:
    return next(iter((text or "").strip().splitlines()), "")


_KIND = "simulation-job"
_MOST_JOBS = 1000


class SabotageNotes:
    """Tells of each sabotage once that it runs, and once that a job has noticed it.

    Args:
        catalog: Catalog with the jobs.
        tell: Tells the user a sentence.
    """

    def __init__(self, catalog: Catalog, tell: Callable[[str], None]) -> None:
        self._catalog, self._tell = catalog, tell
        self._running: set[str] = set()
        self._noticed: set[str] = set()

    def look(self, batch: str) -> None:
        """Tells what is new of the sabotages in a batch's jobs; nothing while the catalog does not answer.

        Args:
            batch: ARN of the batch.
        """
        with suppress(ServiceUnavailableException):
            wanted = {"filters": {"parent": [batch]}, "limit": _MOST_JOBS, "members": JobInBrief.members()}
            jobs = self._catalog.list(_KIND, **wanted).resources
            passed = {job.tags.get(JOB_TAG) for job in jobs if SABOTAGE_TAG not in job.tags and _verdict(job) == "PASS"}
            for job in reversed(jobs):
                if (name := job.tags.get(SABOTAGE_TAG)) is not None:
                    self._tell_of(name, job, shows=job.tags.get(JOB_TAG) in passed)

    def _tell_of(self, name: str, job: Resource, *, shows: bool) -> None:
        """Tells of one job with a sabotage; without a sabotage it has to pass, or it shows nothing."""
        brief = JobInBrief.of(job)
        if name not in self._running and job.status != "Pending":
            self._running.add(name)
            self._tell(f"sabotage {name}: runs")
        has_crashed = brief.failure_code in CRASH_CODES
        if name not in self._noticed and shows and (brief.verdict == "FAIL" or has_crashed):
            self._noticed.add(name)
            why = "a crash" if has_crashed else next(iter(plain_reason(brief.verdict_reason or "").splitlines()), "")
            self._tell(f"sabotage {name}: noticed" + (f" ({why})" if why else ""))


def _verdict(job: Resource) -> str | None:
    return JobInBrief.of(job).verdict
