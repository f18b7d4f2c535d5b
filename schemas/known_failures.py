"""Failures that a team knows of: they are still judged and shown, but do not make a run red until a day.

```yaml
known:
  - match: {job: "scout in flat 3*", requirement: clearance}
    owner: anna
    until: 2027-01-15
    why: ticket 512
```
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from datetime import date
from fnmatch import fnmatchcase
from typing import Annotated

from pydantic import BeforeValidator, Field

from .runs.trials import OF_ALL_TRIALS
from .wire.base import Model
from .wire.request_problems import first_words

ONLY_WHERE_MISSED = ("above_floor",)
"""Names of requirements that jobs have only where they missed them; requests do not name them."""


def _read_day(value: object) -> object:
    """Reads a day that is written as in ISO 8601, or returns a date as it is; the models take no text for a date.

    Raises ValueError for anything else.
    """
    try:
        return value if isinstance(value, date) else date.fromisoformat(value if isinstance(value, str) else "")
    except ValueError:
        raise ValueError("a day is written as in 2027-01-15") from None


class KnownMatch(Model):
    """Jobs and requirements that a known failure is about."""

    job: str = Field(
        default="*",
        min_length=1,
        max_length=300,
        description="Name of the job in reports or in JUnit, or `test` in the latter, as a pattern: "
        "`scout in flat 3*`, `world-3 *`. `*` stands for any text, `?` for one "
        "character, `[ab]` for one of these; `[*]` is a star itself.",
    )
    requirement: str = Field(
        min_length=1,
        max_length=64,
        description="Name of the requirement that is missed, as a pattern; of jobs with trials, `trials`, "
        "which covers any of them that failed.",
    )


class KnownFailure(Model):
    """A requirement that some jobs are known to miss, with the person who mends it and the last day of patience."""

    match: KnownMatch = Field(description="Jobs and requirement that it is about.")
    owner: str = Field(min_length=1, max_length=100, description="Person or team that mends it.")
    until: Annotated[date, BeforeValidator(_read_day)] = Field(
        description="The last day, UTC, of runs that it does not make red: `2027-01-15`."
    )
    why: str = Field(default="", max_length=300, description="The reason, or the number of a ticket.")

    def __str__(self) -> str:
        """Formats it for people: `anna until 2027-01-15: ticket 512`."""
        return f"{self.owner} until {self.until}{f': {self.why}' if self.why else ''}"

    def is_about(self, names: Iterable[str]) -> bool:
        """Returns whether a known failure is about a job that has any of these names."""
        return any(fnmatchcase(name, self.match.job) for name in names)

    def covers(self, names: Iterable[str], requirement: str) -> bool:
        """Returns whether it is about a job's requirement.

        Args:
            names: The job's names, in reports and in JUnit.
            requirement: The requirement's name.
        """
        return self.is_about(names) and fnmatchcase(requirement, self.match.requirement)


@dataclass(frozen=True)
class ReportedFailures:
    """A job's names, and the requirements that it missed."""

    names: tuple[str, ...]
    """Names in reports and in JUnit."""

    missed: tuple[str, ...] | None
    """Names of the requirements that it missed; None: it was not judged."""

    requirements: tuple[str, ...] | None = None
    """Names of all requirements that it was judged by; None: not known."""


def known_failure(job: ReportedFailures, known: Sequence[KnownFailure], day: date) -> KnownFailure | None:
    """Finds the known failure that explains all of a job's missed requirements.

    Args:
        job: The job.
        known: Known failures of the specification.
        day: The day on which the run began, UTC.

    Returns:
        The one that ends first of those that are needed; None: a requirement was missed that is not known, or whose
        day is over.
    """
    explained = _explained(job, known, day)
    found = [each for each in explained.values() if each is not None]
    return min(found, key=lambda each: each.until) if found and len(found) == len(explained) else None


def _explained(job: ReportedFailures, known: Sequence[KnownFailure], day: date) -> dict[str, KnownFailure | None]:
    """Returns the known failure of each requirement that a job missed; None: it is not known on that day."""
    return {
        name: next((each for each in known if day <= each.until and each.covers(job.names, name)), None)
        for name in job.missed or ()
    }


def partly_known(jobs: Sequence[tuple[str, ReportedFailures]], known: Sequence[KnownFailure], day: date) -> list[str]:
    """Returns a sentence for jobs that count as failed although some of what they missed is known.

    Jobs that missed the same requirements share a sentence.

    Args:
        jobs: Title of each job, and what it missed.
        known: Known failures of the specification.
        day: The day on which the run began, UTC.
    """
    titles: dict[tuple[tuple[str, ...], tuple[str, ...], tuple[str, ...]], list[str]] = {}
    for title, job in jobs:
        explained = _explained(job, known, day)
        names = tuple(name for name, each in explained.items() if each is not None)
        others = tuple(name for name, each in explained.items() if each is None)
        owners = tuple(dict.fromkeys(each.owner for each in explained.values() if each is not None))
        if names and others:
            titles.setdefault((names, owners, others), []).append(title)
    return [
        f"{_listed(names)} of {found[0] if len(found) == 1 else f'{len(found)} jobs, such as {found[0]},'} "
        f"{_are(names)} known ({_listed(owners)}), {_listed(others)} {_are(others)} not: "
        f"{'the job counts' if len(found) == 1 else 'the jobs count'} as failed"
        for (names, owners, others), found in titles.items()
    ]


def _listed(names: Sequence[str]) -> str:
    return " and ".join(filter(None, (", ".join(names[:-1]), names[-1])))


def _are(names: Sequence[str]) -> str:
    return "is" if len(names) == 1 else "are"


def did_not_occur(known: KnownFailure, jobs: Sequence[ReportedFailures]) -> bool:
    """Returns whether jobs that a known failure is about could all show it, were judged, and none did.

    Args:
        known: The known failure.
        jobs: The jobs of a run.
    """
    meant = [job for job in jobs if known.is_about(job.names)]
    missed = {name for job in meant for name in job.missed or ()}
    if not meant or _other_requirements(known, meant) or any(job.missed is None for job in meant):
        return False
    return OF_ALL_TRIALS not in missed and not any(known.covers(job.names, name) for job in meant for name in missed)


def idle_failures(jobs: Sequence[ReportedFailures], known: Sequence[KnownFailure], day: date) -> list[str]:
    """Returns a sentence for each known failure that did not occur, is about no job, or whose day is over.

    Nothing is said of one whose jobs were not judged: they may fail so again.

    Args:
        jobs: The jobs of the run.
        known: Known failures of the specification.
        day: The day on which the run began, UTC.
    """
    told: list[str] = []
    for each in known:
        where = "any job" if each.match.job == "*" else each.match.job
        about = f"the known failure of {each.match.requirement} in {where} ({each.owner})"
        meant = [job for job in jobs if each.is_about(job.names)]
        missed = {name for job in meant for name in job.missed or ()}
        occurred = any(each.covers(job.names, name) for job in meant for name in missed)
        is_over = day > each.until
        was = f" was known until {each.until}" if is_over else ""
        if not meant:
            over = f"; its last day was {each.until}: remove it from `known`" if is_over else ""
            told += [
                f"{about} is about no job of this run, as {' or '.join(map(repr, job.names))} is{over}"
                for job in jobs[:1]
            ]
        elif others := _other_requirements(each, meant):
            who = "no job" if each.match.job == "*" else "no such job"
            told.append(f"{about} marks no failure: {who} has a requirement `{each.match.requirement}`; {others}")
        elif OF_ALL_TRIALS in missed and not occurred:
            told.append(
                f"{about} marks no failure: a job with trials misses `{OF_ALL_TRIALS}`, whatever its trials missed; "
                f"`requirement: {OF_ALL_TRIALS}` would cover all of them"
            )
        elif did_not_occur(each, meant):
            told.append(f"{about}{was and f'{was} and'} did not occur; if it is mended, remove it from `known`")
        elif is_over:
            told.append(f"{about}{was}; it counts again")
    return told


def _other_requirements(known: KnownFailure, jobs: Sequence[ReportedFailures]) -> str:
    """Says which requirements jobs have if none of them is that of a known failure; else, or if unknown, empty."""
    if any(job.requirements is None or job.missed is None for job in jobs):
        return ""
    names = list(dict.fromkeys(name for job in jobs for name in job.requirements or ()))
    if any(fnmatchcase(name, known.match.requirement) for name in (*names, *ONLY_WHERE_MISSED)):
        return ""
    return f"there are {first_words(names)}" if names else ""
