"""Names of test cases: of jobs, the same in every run of a specification, so that CI systems know them again."""

import re
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence

from ...schemas.reports.names import short_name, unique_job_names
from ...schemas.reports.report import ReportedJob

_MAKER = re.compile(r" \(([a-z]+-[0-9a-z]{4,12})\)(?=,|$)")
"""Part of a job's name that may be the beginning of the id of what made its world, which another run does not have."""
_SEED = re.compile(r", seed=[^,]*")


def case_names(jobs: Sequence[ReportedJob]) -> list[tuple[str, str]]:
    """Returns two names for each job of a run, the same in every run of its specification, and unique in its step.

    The first has its world's or request's number and its application (see `named_cases`), the second is the one for
    people (see `lasting_titles`).
    """
    by_step: dict[str | None, list[int]] = {}
    for index, job in enumerate(jobs):
        by_step.setdefault(job.step, []).append(index)
    names = [("", "")] * len(jobs)
    for indexes in by_step.values():
        own = [jobs[index] for index in indexes]
        for index, (name, _), title in zip(indexes, named_cases(own), lasting_titles(own), strict=True):
            names[index] = name, title
    return names


def named_cases(jobs: Iterable[ReportedJob]) -> Iterator[tuple[str, ReportedJob]]:
    """Yields a step's jobs with names without ids, so that they can be compared with those of other runs."""
    seen: Counter[str] = Counter()
    for number, job in enumerate(jobs, start=1):
        place = job.world_arn.rpartition("/")[2] if job.world_arn else f"request {number}"
        name = f"{place} {job.application}" if job.application else place
        seen[name] += 1
        yield (name if seen[name] == 1 else f"{name} ({seen[name]})"), job


def lasting_titles(jobs: Sequence[ReportedJob]) -> list[str]:
    """Returns the names for people of a step's jobs without what only one run has, made unique by numbers.

    `scout in flat 3 (generation-8285), SPEED=2` is `scout in flat 3, SPEED=2`. A job without a name has that of its
    world and application.
    """
    titles = [_lasting(job) if job.name else test for test, job in named_cases(jobs)]
    return unique_job_names(titles, [{}] * len(titles))


def _lasting(job: ReportedJob) -> str:
    name = job.name if "seed" in job.axes else _SEED.sub("", job.name)  # seeds that are an axis last
    if not job.world_arn:
        return name
    world = short_name(job.world_arn)  # stands in the name of a job whose world has none
    # A world may have been given a name with something else in brackets.
    name = _MAKER.sub(lambda found: "" if world.startswith(found[1]) else found[0], name)
    return name.replace(world, world.rpartition("/")[2])
