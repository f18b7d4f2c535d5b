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

from .wire.base import Model


def _read_day(value: object) -> object:
    """Reads a day that is written as in ISO 8601; the models take no text for a date by themselves."""
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
        description="Name of the job in reports or in JUnit, as a pattern: `scout in flat 3*`, `world-3 *`. `*` stands "
        "for any text, `?` for one character, `[ab]` for one of these; `[*]` is a star itself.",
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
        """Returns whether it is about a job of these names."""
        return any(fnmatchcase(name, self.match.job) for name in names)

    def covers(self, names: Iterable[str], requirement: str) -> bool:
        """Returns whether it is about a job's requirement.

        Args:
            names: the job's names, in reports and in JUnit.
            requirement: the requirement's name.
        """
        return self.is_about(names) and fnmatchcase(requirement, self.match.requirement)


@dataclass(frozen=True)
class ReportedFailures:
    """A job's names, and the requirements that it missed."""

    names: tuple[str, ...]
    """Names in reports and in JUnit."""

    missed: tuple[str, ...] | None
    """Names of the requirements that it missed; None: it was not judged."""


def known_failure(job: ReportedFailures, known: Sequence[KnownFailure], day: date) -> KnownFailure | None:
    """Finds the known failure that explains all of a job's missed requirements.

    Args:
        job: the job.
        known: known failures of the specification.
        day: the day on which the run began, UTC.

    Returns:
        The one that ends first of those that are needed; None: a requirement was missed that is not known, or whose
        day is over.
    """
    missed = job.missed or ()
    explained = [
        next((each for each in known if day <= each.until and each.covers(job.names, name)), None) for name in missed
    ]
    found = [each for each in explained if each is not None]
    return min(found, key=lambda each: each.until) if found and len(found) == len(explained) else None


def idle_failures(jobs: Sequence[ReportedFailures], known: Sequence[KnownFailure], day: date) -> list[str]:
    """Returns a sentence for each known failure that did not occur, is about no job, or whose day is over.

    Nothing is said of one whose jobs were not judged: they may fail so again.

    Args:
        jobs: the jobs of the run.
        known: known failures of the specification.
        day: the day on which the run began, UTC.
    """
    told: list[str] = []
    for each in known:
        where = "any job" if each.match.job == "*" else each.match.job
        about = f"the known failure of {each.match.requirement} in {where} ({each.owner})"
        meant = [job for job in jobs if each.is_about(job.names)]
        if day > each.until:
            told.append(f"{about} was known until {each.until}; it counts again")
        elif not meant:
            told += [
                f"{about} is about no job of this run, as {' or '.join(map(repr, job.names))} is" for job in jobs[:1]
            ]
        elif all(job.missed is not None for job in meant) and not any(
            each.covers(job.names, name) for job in meant for name in job.missed or ()
        ):
            told.append(f"{about} did not occur; if it is mended, remove it from `known`")
    return told
