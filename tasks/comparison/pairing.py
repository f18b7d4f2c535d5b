"""Pairs of jobs of two runs."""

from collections.abc import Sequence
from dataclasses import dataclass

from ...schemas.reports.comparison import PairedJob
from ...schemas.reports.run_record import JobRecord
from ..reporting import Outcome
from .nights import HEALTH, JUDGED, TRIALS, CellTable, name_of, outcome_of, reason_of

Asked = tuple[str, str | None, float | None]
"""Name, kind and limit of a requirement."""


@dataclass(frozen=True)
class Pair:
    """A job of both runs."""

    before: JobRecord
    after: JobRecord

    @property
    def outcomes(self) -> tuple[Outcome, Outcome]:
        """How it ended in either."""
        return outcome_of(self.before), outcome_of(self.after)

    @property
    def is_judged(self) -> bool:
        """Whether both have a verdict about the robot."""
        return all(outcome in JUDGED for outcome in self.outcomes)

    @property
    def has_same_requirements(self) -> bool:
        """Whether both were judged by the same; one without any, because it broke, does not count as other."""
        before, after = _requirements(self.before), _requirements(self.after)
        # Goals that end a run when they are reached make the environment's own not count in that run.
        own = _own(self.before) & _own(self.after)
        return before - own == after - own or (not self.is_judged and not (before and after))

    @property
    def has_same_request(self) -> bool:
        """Whether both requests asked for the same."""
        before, after = self.before.inputs, self.after.inputs
        return before is None or after is None or before.request_sha256 == after.request_sha256

    def told(self) -> PairedJob:
        """The pair as data."""
        before, after = self.outcomes
        return PairedJob(
            cell=name_of(self.after),
            before=before.value,
            after=after.value,
            before_job=self.before.label,
            after_job=self.after.label,
            reason=reason_of(self.after) or reason_of(self.before),
        )


@dataclass(frozen=True)
class Pairing:
    """The jobs of two runs, paired."""

    pairs: list[Pair]
    only_before: list[JobRecord]
    only_after: list[JobRecord]


def pair_jobs(before: Sequence[JobRecord], after: Sequence[JobRecord]) -> Pairing:
    """Finds the jobs that two runs have in common; see `CellTable`."""
    table = CellTable()
    earlier = dict(zip(table.place(before), before, strict=True))
    pairs, only_after = [], []
    for cell, job in zip(table.place(after), after, strict=True):
        if cell is not None and cell in earlier:
            pairs.append(Pair(earlier[cell], job))
        else:
            only_after.append(job)
    paired = {id(pair.before) for pair in pairs}
    return Pairing(pairs, [job for job in before if id(job) not in paired], only_after)


def _own(job: JobRecord) -> frozenset[Asked]:
    """Names of an environment's own requirements, whether they count or not."""
    return frozenset((item.name, None, None) for item in job.requirements if item.kind is None)


def _requirements(job: JobRecord) -> frozenset[Asked]:
    """What a job was judged by; with trials, what each of them was.

    The limit of what an environment asks for itself may depend on how the run went; that of trials is the worst one's.
    """
    if any(item.counts and item.name == TRIALS for item in job.requirements):
        return frozenset((item.name, item.kind, None) for item in job.requirements if item.kind != HEALTH)
    return frozenset(
        (item.name, item.kind, item.limit if item.kind is not None else None)
        for item in job.requirements
        if item.counts and item.kind != HEALTH
    )
