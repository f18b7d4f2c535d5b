"""Answer of a run in one sentence, with which its report begins."""

from ...schemas.reports.changes import SinceLastRun
from ...schemas.reports.report import Report, ReportSummary
from ...schemas.wire.common import passed_of
from .outcomes import headline


def answer_of(report: Report, numbers: ReportSummary) -> str:
    """Returns the result of a run as one sentence without full stop: how many of what passed, and what is new.

    An example: `3 of 4 jobs passed; 1 failed (38 of 40 trials passed); new since the last run: 1 job newly fails`.

    Args:
        report: Report of the run.
        numbers: Its numbers.
    """
    told = headline(report)
    if report.challenge is None and numbers.trials > len(report.jobs):
        told += f" ({passed_of(numbers.success.passed, numbers.trials, 'trial', numbers.success.errors)})"
    since = report.since_last
    is_told = since is not None and (report.jobs or since.has_losses)
    news = news_in_words(since) if since is not None and is_told else ""
    return f"{told}; {news}" if news else told


def news_in_words(since: SinceLastRun) -> str:
    """Says in a few words what is new since the last run; it follows other words in a sentence.

    An example: `new since the last run: 1 job newly fails, 2 newly pass, 1 is gone or judged less`.
    """
    if since.previous_run_id is None:
        return "there is no earlier run to compare it with"
    if not since.paired and not since.has_losses:
        return "none of its jobs was in an earlier run" if since.unpaired else "none of its jobs has a result"
    lost = [*since.gone, *since.no_longer_judged, *since.asked_less, *since.fewer_trials]
    missed = sum(bool(each.newly_missed) for each in since.requirements)
    counts = (
        (len(since.newly_failing), "newly fails", "newly fail"),
        (len(since.newly_passing), "newly passes", "newly pass"),
        (len(since.first_failing), "fails without an earlier result", "fail without an earlier result"),
        (len({each.job for each in lost}), "is gone or checked less", "are gone or checked less"),
        (since.other_requirements, "is judged by other requirements", "are judged by other requirements"),
        (since.without_result, "has no result", "have no result"),
    )
    told = [
        f"{_jobs(count, is_first=not place)} {one if count == 1 else several}"
        for place, (count, one, several) in enumerate(each for each in counts if each[0])
    ]
    if missed:
        told.append(f"{missed} {'requirement is' if missed == 1 else 'requirements are'} newly missed")
    if since.shrinking:
        told.append(f"{len(since.shrinking)} {'margin shrinks' if len(since.shrinking) == 1 else 'margins shrink'}")
    if told:
        return f"new since the last run: {', '.join(told)}"
    still = len(since.still_failing)
    return f"nothing is new since the last run{f', {still} still failing' if still else ''}"


def _jobs(count: int, *, is_first: bool) -> str:
    """Returns a count, with its noun where it is the first of several."""
    return f"{count} {'job' if count == 1 else 'jobs'}" if is_first else f"{count}"
