"""Reports as Markdown, for comments on pull and merge requests and for summaries of CI jobs.

All text from users is in code spans, so that a robot's message cannot mention a user, close an issue, or draw a table.
"""

from collections import Counter
from collections.abc import Iterator

from ...schemas.reports.causes import Why
from ...schemas.reports.challenge import Challenge
from ...schemas.reports.changes import SinceLastRun
from ...schemas.reports.report import JobCase, ReportSummary, Share
from ...schemas.reports.run_states import state_in_words
from ...schemas.runs.trials import OF_ALL_TRIALS
from ...schemas.wire.common import counted, passed_of
from . import outcomes
from .causes import is_told
from .console_pages import ConsolePages
from .nights.changes import (
    changed_for_all,
    fallen_in_words,
    largest_fall_in_words,
    losses_in_words,
    requirement_in_words,
)
from .outcomes import Outcome

_MOST_JOBS = 20
"""Maximum number of jobs in a comment; the full report has all."""
_MOST_REQUIREMENTS = 10
_LONGEST = 200
"""Maximum number of characters of a reason, as GitHub accepts at most 65,536 characters in a comment."""
_MOST_NEWS = 5
_MOST_COMPARED = 20
"""Comparisons that a comment has, as of jobs."""
_MOST_GROUPS = 10


def markdown_report(summary: ReportSummary) -> str:
    """Writes a run's report as Markdown for GitHub and GitLab.

    The first line is a hidden comment that is the same for each run of a specification; the program that posts reports
    finds its earlier post by it.
    """
    jobs = sum(len(step.jobs) for step in summary.steps)
    pages = ConsolePages(summary.console_url)
    parts = [
        f"<!-- robomaker report: {_plain(summary.name)} -->",
        f"### {_code(summary.name)}: {state_in_words(summary.state, summary.counts)}",
        _head(summary, jobs, pages),
        *([_code(summary.against)] if summary.against else []),
        *([_parameters(summary)] if summary.parameters else []),
        *(
            f"- {_code(step.name)} ({step.operation}) failed: {_code(step.error)}"
            for step in summary.steps
            if step.error
        ),
    ]
    if summary.since_last and (news := list(_news(summary.since_last))):
        parts.append("\n".join(f"- {_code(line)}" for line in news))
    if summary.challenge is not None:
        parts += _challenge(summary.challenge)
    else:
        parts += _results(summary, pages)
    return "\n\n".join(parts) + "\n"


def _news(since: SinceLastRun) -> Iterator[str]:
    """Yields what is new since the last run: lost checks, requirements and margins that changed, and failing jobs."""
    yield from losses_in_words(since, _MOST_NEWS)
    yield from map(requirement_in_words, since.requirements[:_MOST_NEWS])
    for change in since.margins[:_MOST_NEWS]:
        yield fallen_in_words(change)
        yield f"{change.name} {largest_fall_in_words(change)}"
    if len(since.margins) > _MOST_NEWS:
        yield f"the margins of {len(since.margins) - _MOST_NEWS} more requirements fell"
    if failing := since.newly_failing:
        more = f" and {len(failing) - _MOST_NEWS} more" if len(failing) > _MOST_NEWS else ""
        yield f"newly failing: {', '.join(each.cell.title for each in failing[:_MOST_NEWS])}{more}"
        if changed := changed_for_all(failing):
            yield f"changed then: {changed}"


def _results(summary: ReportSummary, pages: ConsolePages) -> Iterator[str]:
    """Yields the Markdown tables of values in pairs, effects of axes, failures, missed requirements and failed jobs.

    A table that would be empty is left out.
    """
    if found := [(axis, each) for axis in summary.axes for each in axis.comparisons]:
        rows = [
            f"| {_code(axis.step)} | {_code(f'{axis.axis}: {each.value} instead of {each.baseline}')} "
            f"| {each.result} | {_code(each.why)} |"
            for axis, each in found[:_MOST_COMPARED]
        ]
        yield "\n".join(("| step | in pairs | result | why |", "| --- | --- | --- | --- |", *rows))
    if is_told(summary.why) and summary.why.headline:
        yield f"Why: {_code(summary.why.headline, is_whole=True)}"
    if summary.effects:
        rows = [
            f"| {_code(each.axis)} | {_code(each.answer)} | {_code('; '.join(each.told), is_whole=True)} |"
            for each in summary.effects
        ]
        yield "\n".join(
            ("| axis | result | changes (all intervals together hold with 95 %) |", "| --- | --- | --- |", *rows)
        )
    if is_told(summary.why):
        yield "\n".join(_why(summary.why))
    if missed := [each for each in summary.requirements if each.failed or each.errors]:
        yield "\n".join(_requirements(missed, _aside([job for step in summary.steps for job in step.jobs])))
    if bad := [job for step in summary.steps for job in step.jobs if job.outcome != Outcome.PASSED.value]:
        begun = [job for job in bad if not outcomes.never_began(job)]
        if begun:
            yield "\n".join(_jobs(begun, pages))
        if left := outcomes.never_began_in_words(len(bad) - len(begun), is_decided=summary.stopped_early):
            yield f"{left}."


def _why(why: Why) -> Iterator[str]:
    """Yields the lines of a Markdown table of groups of failures, those with a claim first, cut after some groups."""
    yield "| missed first | trials | goes with | run one again |"
    yield "| --- | ---: | --- | --- |"
    groups = [*([why.leading] if why.leading else []), *sorted(why.groups, key=lambda each: not each.claims)]
    for group in groups[:_MOST_GROUPS]:
        claims = (
            "; ".join(f"{each.region}: {each.numbers}" for each in group.claims[:1])
            or why.reason_of(group)
            or group.details
        )
        told, command = (_code(each, is_whole=True) for each in (claims, group.command))
        yield f"| {_code(group.name)} | {group.failed} | {told} | {command} |"
    if len(groups) > _MOST_GROUPS:
        yield f"| and {len(groups) - _MOST_GROUPS} more | | | |"


def _challenge(challenge: Challenge) -> Iterator[str]:
    """Yields the table of sabotages, and the jobs that show nothing about them."""
    if challenge.showing:
        rows = [f"| {_code(each.name)} | {_code(each.in_words)} |" for each in challenge.sabotages]
        yield "\n".join(("| sabotage | result |", "| --- | --- |", *rows))
    if useless := [job.in_words for job in challenge.jobs if job.in_words]:
        yield "\n".join(f"- {_code(words)}" for words in useless)


def _head(summary: ReportSummary, jobs: int, pages: ConsolePages) -> str:
    """Returns a run's figures (jobs, trials, duration) in one line."""
    told = [f"**{summary.challenge.headline}**"] if summary.challenge else _counts(summary, jobs)
    told.append(outcomes.duration(summary.time_s))
    page = pages.run(summary.run_id)
    told.append(f"[run in the console]({page})" if page else _code(summary.run_id))
    return " · ".join(told)


def _counts(summary: ReportSummary, jobs: int) -> list[str]:
    """Returns the numbers of jobs by outcome, of trials, and their success rate, as texts of Markdown.

    A known failure is counted as such, and not as failed.
    """
    counts = dict(summary.counts)
    passed = counts.pop(Outcome.PASSED.value, 0)
    words = passed_of(passed, jobs, "job") if jobs else "no simulation jobs"
    if summary.trials > jobs:
        words += f" ({passed_of(summary.success.passed, summary.trials, 'trial', summary.success.errors)})"
    told = [f"**{words}**"]
    known = sum(bool(job.known) for step in summary.steps for job in step.jobs)
    if known:  # they are FAIL, and make no run red
        counts[Outcome.FAILED.value] -= known
    told += [f"{count} {outcome}" for outcome, count in counts.items() if count]
    told += [f"{known} known {'failure' if known == 1 else 'failures'}"] if known else []
    # Trials that end a run are no sample of a fixed size, for which the interval holds.
    if (rate := summary.success.rate) is not None and summary.success.low is not None and not summary.against:
        low, high = (f"{100 * (end or 0.0):.0f}" for end in (summary.success.low, summary.success.high))
        remark = summary.success.remark
        judged = f" of {summary.success.passed + summary.success.failed} judged" if summary.success.errors else ""
        told.append(f"success rate {100 * rate:.0f} %{judged} (95 %: {low} to {high} %{remark and '; ' + remark})")
    return told


def _parameters(summary: ReportSummary) -> str:
    return "Parameters: " + ", ".join(_code(f"{name}: {value}") for name, value in summary.parameters.items())


def _aside(jobs: list[JobCase]) -> Counter[str]:
    """Counts for each requirement the jobs in which it does not count; in jobs with trials they alone count."""
    without_trials = [job for job in jobs if all(item.name != OF_ALL_TRIALS for item in job.requirements)]
    return Counter(item.name for job in without_trials for item in job.requirements if not item.counts)


def _requirements(missed: list[Share], aside: Counter[str]) -> Iterator[str]:
    yield "| requirement | met | missed | not judged | smallest margin |"
    yield "| --- | ---: | ---: | ---: | ---: |"
    for each in missed[:_MOST_REQUIREMENTS]:
        margin = "" if each.worst_margin is None else f"{each.worst_margin:.3g} {each.unit or ''}".rstrip()
        note = f" (does not count in {counted(aside[each.name], 'job')})" if aside[each.name] else ""
        yield f"| {_code(each.name)}{note} | {each.passed} | {each.failed} | {each.errors} | {margin} |"
    if len(missed) > _MOST_REQUIREMENTS:
        yield f"| and {len(missed) - _MOST_REQUIREMENTS} more | | | | |"


def _jobs(bad: list[JobCase], pages: ConsolePages) -> Iterator[str]:
    """Yields the lines of a collapsible table of the jobs that did not pass, the worst first, cut after some jobs."""
    count = counted(len(bad), "job")
    yield f"<details{' open' if len(bad) == 1 else ''}><summary>{count} did not pass</summary>"
    yield ""
    yield "| job | outcome | why | run it again |"
    yield "| --- | --- | --- | --- |"
    for job in sorted(bad, key=lambda each: Outcome(each.outcome).rank)[:_MOST_JOBS]:
        page = pages.job(job.arn)
        title = _code(job.title or job.test)
        name = f"[{title}]({page})" if page else title
        again = _code(f"robomaker repro {job.name}", is_whole=True) if job.arn and job.output else ""
        why = _code(job.reason or job.failure_code or "")
        known = f" (known, {_code(job.known)})" if job.known else ""
        yield f"| {name} | {job.outcome}{known} | {why} | {again} |"
    if len(bad) > _MOST_JOBS:
        yield f"| and {len(bad) - _MOST_JOBS} more | | | |"
    yield ""
    yield "</details>"


def _code(text: str, *, is_whole: bool = False) -> str:
    """Formats a text in one line as a code span that can be in a table; empty for an empty text.

    Args:
        text: The text; a long one is cut.
        is_whole: Whether it is not cut, since it is or may have a command.
    """
    line = " ".join(outcomes.plain(text).split()).replace("`", "'")
    line = line if is_whole or len(line) <= _LONGEST else f"{line[: _LONGEST - 1]}…"
    # Tables are split at bars before code spans are read; a backslash before one would take away its escape.
    return f"`{line.replace(chr(92), '/').replace('|', chr(92) + '|')}`" if line else ""


def _plain(text: str) -> str:
    """Returns a text in one line without `>`, so that it cannot end an HTML comment."""
    return " ".join(text.replace(">", "").split())
