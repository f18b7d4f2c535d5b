"""Failures that a team knows of: they are still judged and shown, but do not make a run red until a day.

```yaml
known:
  - match: {job: "world-3 *", requirement: clearance}
    owner: anna
    until: 2027-01-15
    why: ticket 512
```
"""

from collections.abc import Collection, Sequence
from datetime import date
from fnmatch import fnmatchcase
from typing import Annotated

from pydantic import BeforeValidator, Field

from .wire.base import Model


def _read_day(value: object) -> object:
    """Reads a day that is written as in ISO 8601; the models take no text for a date by themselves."""
    if not isinstance(value, str):
        return value
    try:
        return date.fromisoformat(value)
    except ValueError:
        raise ValueError("a day is written as in 2027-01-15") from None


class KnownMatch(Model):
    """Jobs and requirements that a known failure is about."""

    job: str = Field(
        default="*",
        min_length=1,
        max_length=300,
        description="Name of the job in reports, as a pattern: `world-3 *`. `*` stands for any text.",
    )
    requirement: str = Field(
        min_length=1,
        max_length=64,
        description="Name of the requirement that is missed, as a pattern; of jobs with trials, `trials`.",
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

    def covers(self, job: str, requirement: str) -> bool:
        """Returns whether it is about a job's requirement.

        Args:
            job: the job's name in reports.
            requirement: the requirement's name.
        """
        return fnmatchcase(job, self.match.job) and fnmatchcase(requirement, self.match.requirement)


def known_failure(job: str, missed: Collection[str], known: Sequence[KnownFailure], day: date) -> KnownFailure | None:
    """Finds the known failure that explains all of a job's missed requirements.

    Args:
        job: the job's name in reports.
        missed: names of the requirements that it missed.
        known: known failures of the specification.
        day: the day on which the run began, UTC.

    Returns:
        The one that ends first of those that are needed; None: a requirement was missed that is not known, or whose
        day is over.
    """
    explained = [
        next((each for each in known if day <= each.until and each.covers(job, name)), None) for name in missed
    ]
    found = [each for each in explained if each is not None]
    return min(found, key=lambda each: each.until) if found and len(found) == len(explained) else None


def idle_failures(missed: Sequence[tuple[str, Collection[str]]], known: Sequence[KnownFailure], day: date) -> list[str]:
    """Returns a sentence for each known failure that did not occur, or whose day is over.

    Args:
        missed: jobs that were judged, by name, with the requirements that each missed.
        known: known failures of the specification.
        day: the day on which the run began, UTC.
    """
    told: list[str] = []
    for each in known:
        jobs = "any job" if each.match.job == "*" else each.match.job
        about = f"the known failure of {each.match.requirement} in {jobs} ({each.owner})"
        if day > each.until:
            told.append(f"{about} was known until {each.until}; it counts again")
        elif not any(each.covers(job, name) for job, names in missed for name in names):
            told.append(f"{about} did not occur; if it is mended, remove it from `known`")
    return told
