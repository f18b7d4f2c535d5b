"""Pass rates by requirement, by world and by room."""

from collections.abc import Iterable, Mapping, Sequence

from ...schemas.reports.report import ReportedJob
from ...schemas.reports.summary import Share
from ...schemas.runs.plan import Requirement
from .outcomes import Outcome, outcome_of
from .statistics import wilson_interval


def share_of(name: str, passed: int, failed: int, errors: int = 0) -> Share:
    """A share with its rate and interval."""
    trials = passed + failed
    if not trials:
        return Share(name=name, passed=passed, failed=failed, errors=errors)
    low, high = wilson_interval(passed, trials)
    return Share(
        name=name, passed=passed, failed=failed, errors=errors, rate=passed / trials, low=low, high=high
    )  # fmt: skip


def of_jobs(name: str, jobs: Iterable[ReportedJob], *, errors_fail: bool = False) -> Share:
    """How many of some jobs passed; jobs that were stopped or have no verdict do not count.

    Args:
        name: what the jobs have in common.
        jobs: the jobs.
        errors_fail: whether what broke counts as failed.
    """
    return of_outcomes(name, [outcome_of(job) for job in jobs], errors_fail=errors_fail)


def of_outcomes(name: str, outcomes: Sequence[Outcome], *, errors_fail: bool = False) -> Share:
    """The same of outcomes; see `of_jobs`."""
    passed, failed, broken = (
        outcomes.count(each) for each in (Outcome.PASSED, Outcome.FAILED, Outcome.BROKEN)
    )  # fmt: skip
    return share_of(name, passed, failed + broken) if errors_fail else share_of(name, passed, failed, broken)


def by_world(jobs: Iterable[ReportedJob], labels: Mapping[str, str]) -> list[Share]:
    """Jobs by the world they drove in, the worst first."""
    groups: dict[str, list[ReportedJob]] = {}
    for job in jobs:
        if job.world_arn:
            groups.setdefault(labels.get(job.world_arn, job.world_arn), []).append(job)
    return _worst_first(of_jobs(name, group) for name, group in groups.items())


def by_room(jobs: Iterable[ReportedJob]) -> list[Share]:
    """Visits by the room's name, over all jobs whose results know rooms; the worst first."""
    visits: dict[str, list[bool]] = {}
    for job in jobs:
        for room in job.result.rooms if job.result else ():
            visits.setdefault(room.name, []).append(room.visited)
    return _worst_first(share_of(name, sum(found), len(found) - sum(found)) for name, found in visits.items())


def by_requirement(jobs: Iterable[ReportedJob]) -> list[Share]:
    """Judgements by the requirement's name, the worst first; of each the smallest margin and whose it was."""
    found: dict[str, list[tuple[str, Requirement]]] = {}
    for job in jobs:
        for requirement in job.result.requirements if job.result else ():
            if requirement.counts:
                found.setdefault(requirement.name, []).append((job.label, requirement))
    return _worst_first(_judgements(name, judged) for name, judged in found.items())


def _judgements(name: str, judged: list[tuple[str, Requirement]]) -> Share:
    errors = sum(requirement.error is not None for _, requirement in judged)
    passed = sum(requirement.satisfied for _, requirement in judged)
    share = share_of(name, passed, len(judged) - errors - passed, errors)
    margins = [(item.margin or 0.0, label, item.unit) for label, item in judged if _has_margin(item)]
    if len({unit for _, _, unit in margins}) != 1:
        return share  # nothing to compare, or seconds with metres
    margin, label, unit = min(margins, key=lambda found: found[0])
    return share.model_copy(update={"worst_margin": margin, "worst_job": label, "unit": unit})


def _has_margin(requirement: Requirement) -> bool:
    """Whether there is more to say than yes or no."""
    return requirement.margin is not None and requirement.kind != "predicate"


def _worst_first(shares: Iterable[Share]) -> list[Share]:
    """Those with errors or failures first, by rate; otherwise in the order found."""
    return sorted(shares, key=lambda share: (not share.errors, share.rate if share.rate is not None else 1.0))
