"""Results of a challenge (jobs with sabotages), read from the jobs of its run."""

from collections.abc import Sequence

from ...schemas.reports.challenge import Challenge
from ...schemas.reports.report import ReportedJob
from ...schemas.reports.run_record import JobRecord
from ...schemas.runs.axis_kinds.kind import why_not_applicable
from ...schemas.runs.plan import RunResult, Verdict
from ...schemas.specs.challenge_requests import JOB_TAG, SABOTAGE_TAG
from ..results.challenge_verdicts import Arm, table_of
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
