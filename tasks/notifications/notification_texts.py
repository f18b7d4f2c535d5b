"""Texts of notifications: pure functions of a run and the run before it."""

from collections.abc import Mapping
from dataclasses import dataclass

from ...schemas.reports.changes import Losses, SinceLastRun
from ...schemas.reports.live_comparison import in_words
from ...schemas.reports.run_record import CaseOutcome, JobRecord, RunRecord, case_outcome
from ...schemas.reports.run_states import count_outcomes, plain_reason, shown_state
from ...schemas.runs.plan import Requirement
from ...schemas.wire.common import passed_of
from ..reporting.console_pages import NO_CONSOLE, ConsolePages
from ..reporting.nights.changes import (
    judged_otherwise_in_words,
    losses_in_words,
    newly_missed_briefly,
    requirement_in_words,
    trend_in_words,
    without_earlier_in_words,
)

WORST = 3
"""Number of the worst failures that a message names."""

_MAX_REASON = 300
_MAX_IN_TITLE = 120
_WORDS: Mapping[CaseOutcome, str] = {
    "failed": "failed",
    "broken": "broke",
    "canceled": "canceled",
    "unfinished": "unfinished",
    "no verdict": "without a verdict",
}


@dataclass(frozen=True)
class Message:
    """A notification about a run: title, text and pictures."""

    title: str
    body: str
    good: bool


def failed_jobs(record: RunRecord) -> list[JobRecord]:
    """Lists the jobs that did not pass, worst first and known failures last; cancelled jobs are left out.

    Errors come before failed verdicts, then jobs that missed most requirements; otherwise the order of requests is
    kept.
    """
    failed = [job for job in record.jobs if _outcome(job) in ("broken", "failed")]
    return sorted(failed, key=lambda job: (bool(job.known), _outcome(job) != "broken", -len(_missed(job))))


def message_of(
    record: RunRecord,
    before: RunRecord | None,
    since: SinceLastRun | None = None,
    pages: ConsolePages = NO_CONSOLE,
    host: str = "",
) -> Message:
    """Makes the notification about a run.

    Args:
        record: The run.
        before: The last run of the specification before it; None: there is none.
        since: What is other than in the run before, with all losses since the last good one; None: it is not one of
            the nights.
        pages: Pages of the console that open where the message is read.
        host: Name of the machine that has the report; empty: it is not said.
    """
    lost = losses_in_words(since, WORST) if since is not None else []
    good = record.state == "succeeded" and not lost
    again = ", good again" if good and before is not None and before.state != "succeeded" else ""
    counts, failures = _counts(record), failed_jobs(record)
    nothing = "It made no simulation jobs." if record.report_path else "Its report could not be written."
    lines = [f"{counts}." if counts else nothing, *([f"{in_words(record.against)}."] if record.against else []), ""]
    lines += _steps_that_broke(record)
    if since is not None:
        lines += [requirement_in_words(each) for each in since.requirements[:WORST]]
        lines += [trend_in_words(each) for each in since.shrinking[:WORST]]
    for number, job in enumerate(failures[:WORST], start=1):
        lines += [f"{number}. {_line(job)}", *filter(None, [pages.job(job.arn)])]
    if len(failures) > WORST:
        lines.append(f"and {len(failures) - WORST} more")
    lines += lost
    if since is not None and (new := without_earlier_in_words(since)):
        lines.append(new)
    if since is not None and since.other_requirements:
        lines.append(judged_otherwise_in_words(since.other_requirements))
    if lines[-1]:
        lines.append("")
    lines += _where_to_look(record, pages, host, has_failures=bool(failures))
    missed = newly_missed_briefly(since.requirements) if since is not None else ""
    told = (
        f"{record.name}: {'refused' if record.refusal is not None else shown_state(record)}{again}",
        counts,
        _short(record.refusal or record.step_error, _MAX_IN_TITLE),
        missed,
        _lost_briefly(since),
    )
    title = ", ".join(filter(None, told))
    return Message(title, "\n".join(lines), good)


def _where_to_look(record: RunRecord, pages: ConsolePages, host: str, *, has_failures: bool) -> list[str]:
    """Returns the last lines of a message: places of the run, and commands that show it and run it again."""
    lines: list[str] = []
    if page := pages.run(record.run_id):
        lines.append(f"Run: {page}")
    if record.report_path:
        on_host = f" on {host}" if host else ""
        lines.append(f"Report: {record.report_path}{on_host}")
        if not page:  # a path opens nothing where the message is read
            lines.append(f"Open it{on_host}: robomaker report {record.run_id} --open")
    if has_failures:
        lines.append(f"Run these again: {record.again}")
    return lines


def _steps_that_broke(record: RunRecord) -> list[str]:
    if record.refusal:
        return [f"It was refused before its first step: {_short(record.refusal)}"]
    return [f"Step {step.name} ({step.operation}): {_short(step.error)}" for step in record.steps if step.error]


def _lost_briefly(since: Losses | None) -> str:
    """Summarises lost jobs: `1 job gone, 2 no longer judged`; empty if none are lost."""
    if since is None:
        return ""
    gone = f"{len(since.gone)} {'job' if len(since.gone) == 1 else 'jobs'} gone" if since.gone else ""
    unjudged = f"{len(since.no_longer_judged)} no longer judged" if since.no_longer_judged else ""
    less = f"{len(since.asked_less)} asked less than before" if since.asked_less else ""
    fewer = f"{len(since.fewer_trials)} with fewer trials" if since.fewer_trials else ""
    return ", ".join(filter(None, (gone, unjudged, less, fewer)))


def _counts(record: RunRecord) -> str:
    if not record.jobs:
        return ""
    counts = count_outcomes(job for job in record.jobs if not job.known)
    others = [f"{counts[outcome]} {word}" for outcome, word in _WORDS.items() if outcome in counts]
    known = sum(bool(job.known) for job in record.jobs)
    others += [f"{known} known"] if known else []
    return ", ".join([passed_of(counts.get("passed", 0), len(record.jobs), "job"), *others])


def _line(job: JobRecord) -> str:
    where = f"{job.label} in {job.world}" if job.world and not job.name else job.title_with_id
    missed = "; ".join(f"{each.name}: {each.detail}" for each in _missed(job))
    reason = job.failure_reason or plain_reason(job.verdict_reason or "") or missed
    known = f"known, {job.known}: " if job.known else ""
    return f"{where}: {known}" + _short(": ".join(part for part in (job.failure_code, reason) if part) or job.status)


def _missed(job: JobRecord) -> list[Requirement]:
    return [each for each in job.requirements if each.counts and not each.satisfied]


def _outcome(job: JobRecord) -> CaseOutcome:
    return case_outcome(job.status, job.verdict, job.failure_code)


def _short(text: str | None, longest: int = _MAX_REASON) -> str:
    line = " ".join((text or "").partition("\nLast lines of ")[0].split())
    return line if len(line) <= longest else f"{line[: longest - 1]}…"
