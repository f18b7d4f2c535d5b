"""Outcomes of jobs and of the whole run, in words."""

from collections import Counter
from collections.abc import Iterable
from enum import Enum

from ...schemas.reports.report import Report, ReportedJob
from ...schemas.reports.run_states import case_outcome
from ...schemas.runs.plan import Verdict


class Outcome(Enum):
    """The outcome of a job, worst first; a failed simulation and a broken machine are different outcomes."""

    BROKEN = "broken"
    FAILED = "failed"
    CANCELED = "canceled"
    UNFINISHED = "unfinished"
    UNJUDGED = "no verdict"
    PASSED = "passed"

    @property
    def key(self) -> str:
        """Name for style classes and icons."""
        return self.name.lower()

    @property
    def rank(self) -> int:
        """Place in the order of severity, 0 the worst."""
        return list(Outcome).index(self)

    @property
    def is_failure(self) -> bool:
        """Whether a reader has to look at it first."""
        return self in (Outcome.BROKEN, Outcome.FAILED)


def outcome_of(job: ReportedJob) -> Outcome:
    """Classifies a job."""
    return classify(job.status, job.failure_code, job.result.verdict if job.result else None)


def classify(status: str, failure_code: str | None, verdict: Verdict | None) -> Outcome:
    """Classifies a job by its status first: a verdict counts only when the job ended by itself.

    Args:
        status: the job's status, or `NotCreated`.
        failure_code: why it failed; None if it did not.
        verdict: the simulation's verdict; None if there is none.
    """
    return Outcome(case_outcome(status, verdict, failure_code))


def count_outcomes(jobs: Iterable[ReportedJob]) -> dict[Outcome, int]:
    """Counts jobs by outcome, worst first, without outcomes that did not occur."""
    counts = Counter(outcome_of(job) for job in jobs)
    return {outcome: counts[outcome] for outcome in Outcome if counts[outcome]}


def headline(report: Report) -> str:
    """The run in one sentence: `3 of 4 jobs passed; 1 failed`."""
    if not report.jobs:
        worlds = len(report.worlds)
        return (
            f"No simulation jobs; {worlds} {'world' if worlds == 1 else 'worlds'}"
            if worlds
            else "Nothing was simulated"
        )
    counts = count_outcomes(report.jobs)
    total = len(report.jobs)
    sentence = f"{counts.get(Outcome.PASSED, 0)} of {total} {'job' if total == 1 else 'jobs'} passed"
    others = [f"{count} {outcome.value}" for outcome, count in counts.items() if outcome is not Outcome.PASSED]
    return f"{sentence}; {', '.join(others)}" if others else sentence
