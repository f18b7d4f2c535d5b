"""State of a finished run, decided from its steps and jobs, and texts about it in a line or two."""

from collections import Counter
from collections.abc import Collection, Iterable, Mapping, Sequence

from pydantic import Field

from ..exit_codes import IN_WORDS
from ..known_failures import (
    KnownFailure,
    ReportedFailures,
    did_not_occur,
    idle_failures,
    known_failure,
    partly_known,
)
from ..runs.plan import Verdict
from ..runs.trials import OF_ALL_TRIALS
from ..wire.base import Model, optional
from ..wire.common import counted, passed_of
from .live_comparison import in_words as answer_in_words
from .run_record import CaseOutcome, JobRecord, RerunOf, RunRecord, RunState, case_outcome

BAD_ENDS: dict[str, RunState] = {"Failed": "broken", "Canceled": "canceled", "TimedOut": "timed out"}
"""State of a run by the status of a failed step or job, after which no further step starts."""

# Later steps use the worlds there are, but the run is not what was ordered.
_STATES: dict[str, RunState] = {**BAD_ENDS, "PartialFailed": "broken"}
# From worst to best: what several steps or jobs make of a run.
_SEVERITY: tuple[RunState, ...] = ("canceled", "timed out", "broken", "failed", "succeeded")
_OTHER_ENDS: dict[CaseOutcome, str] = {
    "broken": "broke",
    "canceled": "canceled",
    "unfinished": "unfinished",
    "no verdict": "without a verdict",
}
_MOST_NAMED = 3
_MOST_OF_REASON = 160
"""Maximum number of characters of each reason."""


class FlowResult(Model):
    """Result that the Prefect flow of a run or job returns, besides the service's response."""

    state: RunState = Field(description="State of the finished run or job.")
    message: str = Field(
        description="Description with the worst failures; the message of the flow run's state in Prefect."
    )
    verdicts: dict[str, Verdict] = Field(default={}, description="Verdicts by job; jobs that have none are absent.")
    counts: dict[CaseOutcome, int] = Field(default={}, description="Number of jobs by outcome.")
    run_id: str | None = optional("Id of the run of a specification; absent: of a job alone.")
    report: str | None = optional("Path of the report; absent: none was written.")


def result_of(record: RunRecord) -> FlowResult:
    """Makes the Prefect flow's result from the record of a run, with its verdicts, counts and report's path."""
    troubles = [f"{step.name} ({step.operation}): {step.error}" for step in record.steps if step.error]
    message = in_words(record.state, record.jobs, troubles, look=f"robomaker report {record.run_id} --open")
    return FlowResult(
        state=record.state,
        message=f"{message}. Report: {record.report_path}",
        verdicts=verdicts_of(record.jobs),
        counts=count_outcomes(record.jobs),
        run_id=record.run_id,
        report=str(record.report_path) if record.report_path else None,
    )


def meaning_of(record: RunRecord) -> str:
    """Describes why a run has its exit code.

    For a run that was compared with an earlier one this is the answer, and for a challenge its headline, as the state
    `failed` would say nothing about the robot.
    """
    is_whole = record.state in ("succeeded", "failed")
    if record.against is not None and is_whole:
        return answer_in_words(record.against)
    meaning = IN_WORDS.get(record.exit_code, f"exit code {record.exit_code}")
    if record.challenge is None or not record.challenge.jobs:
        return meaning
    return record.challenge.headline if is_whole else f"{meaning}: {record.challenge.headline}"


def with_known(record: RunRecord, jobs: Sequence[JobRecord]) -> tuple[list[JobRecord], list[str]]:
    """Marks jobs whose failure is known.

    Only a FAIL can be known: of an ERROR nothing was judged. Nor is one known that has reasons besides requirements,
    such as trials that broke beside trials that failed. The jobs of a challenge fail on purpose.

    Args:
        record: The run, with its known failures.
        jobs: Its jobs.

    Returns:
        The jobs, and a sentence for each known failure that did not occur, is about no job, or whose day is over, and
        for jobs that are red all the same: only some of what they missed is known, or they failed for more.
    """
    if not record.known or record.challenge is not None:
        return list(jobs), []
    day = record.started_at.date()
    found = [_reported(job, record) for job in jobs]
    explained = [known_failure(each, record.known, day) for each in found]
    marked = [
        job.model_copy(update={"known": f"{each}{_covered(job)}" if each and not job.unnamed_failure else ""})
        for job, each in zip(jobs, explained, strict=True)
    ]
    besides = [
        f"{job.title} is not known, though the requirements that it missed are: it also failed by its environment's "
        "own verdict, or for trials that broke, are missing or have no verdict"
        for job, each in zip(jobs, explained, strict=True)
        if each and job.unnamed_failure
    ]
    is_rerun = record.rerun_of is not None  # which has but some of the jobs
    told = [each for each in record.known if not is_rerun or any(each.is_about(job.names) for job in found)]
    partly = partly_known([(job.title, each) for job, each in zip(jobs, found, strict=True)], record.known, day)
    return marked, [*idle_failures(found, told, day), *partly, *besides]


def mended_failures(record: RunRecord) -> list[KnownFailure]:
    """Lists the known failures that did not occur in a run, though its jobs could show them and were judged."""
    found = [_reported(job, record) for job in record.jobs]
    return [each for each in record.known if did_not_occur(each, found)]


def _reported(job: JobRecord, record: RunRecord) -> ReportedFailures:
    return ReportedFailures(
        names=names_for_known(job, record.rerun_of),
        missed=tuple(_missed(job)) if _outcome_of(job) in ("passed", "failed") else None,
        requirements=tuple(item.name for item in job.requirements),
    )


def names_for_known(job: JobRecord, rerun_of: RerunOf | None) -> tuple[str, ...]:
    """Returns the names by which known failures name a job; in a rerun those that it had in the whole run.

    Args:
        job: The job.
        rerun_of: The run that was run again; None: it is the job of no rerun.
    """
    if rerun_of is not None:  # a rerun's only job is its request 1, which another one was in the whole run
        return tuple(rerun_of.names.get((job.earlier or "").rpartition(": ")[0], ()))
    return tuple(dict.fromkeys(filter(None, (job.name, job.case_name, job.test or job.label))))


def _covered(job: JobRecord) -> str:
    """Says that a known failure covers all of the job's failing trials; empty for a job without trials."""
    found = any(item.name == OF_ALL_TRIALS and item.counts and not item.satisfied for item in job.requirements)
    return "; covers all trials that failed" if found else ""


def plain_reason(reason: str) -> str:
    """Returns why a job did not pass, without the name `trials`: what follows it says that it is about trials."""
    return reason.removeprefix(f"{OF_ALL_TRIALS}: ")


def _missed(job: JobRecord) -> list[str]:
    return [item.name for item in job.requirements if item.counts and not item.satisfied]


def is_bad(status: str) -> bool:
    """Whether a status of a step or job means that it did not succeed."""
    return status in _STATES


def run_state(statuses: Iterable[str], jobs: Collection[JobRecord], *, is_whole: bool = True) -> RunState:
    """Determines the state of a whole run (passed, failed, broken or canceled) from its steps and jobs.

    Args:
        statuses: Statuses of the run's steps.
        jobs: Simulation jobs of the run.
        is_whole: Whether all steps of the run were completed.
    """
    states: set[RunState] = {_STATES.get(status, "succeeded") for status in statuses}
    if not is_whole:
        states.add("canceled")
    for job in jobs:
        outcome = _outcome_of(job)
        if job.failure_code == "BatchTimedOut":
            states.add("timed out")
        elif outcome in ("broken", "failed") and not job.known:
            states.add(outcome)
    worst: RunState = next(state for state in _SEVERITY if state in states or state == "succeeded")
    # A job that was canceled, perhaps by itself, hides nothing that is wrong with others.
    if worst == "succeeded" and any(job.status == "Canceled" or job.failure_code == "BatchCanceled" for job in jobs):
        return "canceled"
    return worst


def count_outcomes(jobs: Iterable[JobRecord]) -> dict[CaseOutcome, int]:
    """Counts simulation jobs by outcome (passed, failed, broken, ...)."""
    return dict(Counter(_outcome_of(job) for job in jobs))


def outcomes_in_words(outcomes: Sequence[str]) -> str:
    """Summarises outcomes of jobs, the most frequent first: `1000 jobs: 990 passed, 8 failed, 2 broken`."""
    jobs = counted(len(outcomes), "job")
    counts = ", ".join(f"{count} {outcome}" for outcome, count in Counter(outcomes).most_common())
    return f"{jobs}: {counts}" if counts else jobs


def verdicts_of(jobs: Iterable[JobRecord]) -> dict[str, Verdict]:
    """Returns the verdicts (PASS, FAIL, ...) of the simulation jobs that finished, by job label."""
    return {job.label: job.verdict for job in jobs if job.verdict and job.status == "Completed"}


def worst_job(jobs: Iterable[JobRecord]) -> JobRecord | None:
    """Returns the job that a user should look at first: a broken one, else a failed one; `None` if all passed."""
    return next(iter(_bad(jobs)), None)


def state_in_words(state: str, counts: Mapping[CaseOutcome, int] | Mapping[str, int]) -> str:
    """Returns a run's state in the word for its jobs: `passed` if it succeeded and each of them passed.

    Args:
        state: State of the run.
        counts: Numbers of its jobs by outcome.
    """
    is_passed = state == "succeeded" and [outcome for outcome, count in counts.items() if count] == ["passed"]
    return "passed" if is_passed else state


def shown_state(record: RunRecord) -> str:
    """Returns the state of a run that has ended, as pages and messages show it; see `state_in_words`."""
    return state_in_words(record.state, count_outcomes(record.jobs))


def in_words(state: RunState, jobs: Sequence[JobRecord], troubles: Sequence[str] = (), look: str = "") -> str:
    """Summarises a run as text: its state, how many jobs passed, the worst failures, and a command to inspect them.

    An example: `failed: 3 of 4 jobs passed. scout in flat 3 (sim-82856b0yq33y): FAIL: upright. Look: COMMAND`.

    Args:
        state: State of the finished run.
        jobs: Simulation jobs of the run.
        troubles: Other problems as text, the worst first.
        look: Command line to inspect the failures; empty: none.
    """
    words = ": ".join(filter(None, (state_in_words(state, count_outcomes(jobs)), counts_in_words(jobs))))
    bad = [*(_line(trouble) for trouble in troubles), *(_job_in_words(job) for job in _bad(jobs))]
    if bad:
        more = f"; and {len(bad) - _MOST_NAMED} more" if len(bad) > _MOST_NAMED else ""
        words += f". {'; '.join(bad[:_MOST_NAMED])}{more}"
    return f"{words}. Look: {look}" if look and state != "succeeded" else words


def counts_in_words(jobs: Sequence[JobRecord]) -> str:
    """Summarises jobs by outcome: `3 of 6 jobs passed (48 of 50 trials passed), 1 broke`; empty without jobs."""
    if not jobs:
        return ""
    counts = count_outcomes(jobs)
    told = [f"{passed_of(counts.get('passed', 0), len(jobs), 'job')}{_trials_in_words(jobs)}"]
    if known := sum(bool(job.known) for job in jobs):
        told.append(f"{known} {'failure' if known == 1 else 'failures'} known")
    told += [f"{counts[outcome]} {words}" for outcome, words in _OTHER_ENDS.items() if counts.get(outcome)]
    return ", ".join(told)


def _trials_in_words(jobs: Sequence[JobRecord]) -> str:
    """Returns the numbers of trials that passed and broke, in brackets; empty if no job has trials."""
    if not any(map(_has_trials, jobs)):
        return ""
    passed, trials, broke = (sum(counts) for counts in zip(*map(_trials_of, jobs), strict=True))
    return f" ({passed_of(passed, trials, 'trial', broke)})"


def _trials_of(job: JobRecord) -> tuple[int, int, int]:
    """Returns how many trials of a job passed, how many it has, and how many of them broke.

    A job without trials is one itself if judged; one that broke is counted among the jobs.
    """
    if _has_trials(job):  # another job may have metrics of its application that are called the same
        passed, trials, broke = (round(job.metrics.get(f"trials{each}", 0)) for each in ("_passed", "", "_errors"))
        return passed, trials, broke
    is_judged = job.status == "Completed" and job.verdict not in (None, "NONE")
    return int(_outcome_of(job) == "passed"), int(is_judged), 0


def _has_trials(job: JobRecord) -> bool:
    return any(item.name == OF_ALL_TRIALS for item in job.requirements)


def _bad(jobs: Iterable[JobRecord]) -> list[JobRecord]:
    """Returns the jobs that broke, then those that failed; without those on the list of known failures."""
    found = [job for job in jobs if _outcome_of(job) in ("broken", "failed") and not job.known]
    return sorted(found, key=lambda job: _outcome_of(job) != "broken")


def _job_in_words(job: JobRecord) -> str:
    what = job.verdict if job.status == "Completed" else job.failure_code or job.status
    reason = (job.verdict_reason if job.status == "Completed" else job.failure_reason) or ""
    where = f" in {job.world}" if job.world and not job.name else ""  # the name says it
    who = f"{job.title_with_id}{where}"
    return f"{who}: {what}: {_line(reason)}" if reason else f"{who}: {what}"


def _line(text: str) -> str:
    line = next(iter(text.strip().splitlines()), "")
    return line if len(line) <= _MOST_OF_REASON else f"{line[: _MOST_OF_REASON - 1]}…"


def _outcome_of(job: JobRecord) -> CaseOutcome:
    return case_outcome(job.status, job.verdict, job.failure_code)
