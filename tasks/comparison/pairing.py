"""Pairs of jobs of two runs."""

from collections.abc import Sequence
from dataclasses import dataclass

from ...schemas.reports.comparison import PairedJob
from ...schemas.reports.run_record import JobRecord
from ..reporting import Outcome
from .nights import HEALTH, JUDGED, TRIALS, CellTable, name_of, outcome_of, reason_of

Asked = tuple[str, str | None]
"""Name and kind of a requirement; its limit is in the request, since that of a result depends on how the run went."""


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
        if not self.asks_for_the_same:
            return False
        before, after = _requirements(self.before), _requirements(self.after)
        # Goals that end a run when they are reached make the environment's own not count in that run.
        own = _own(self.before) & _own(self.after)
        return before - own == after - own or (not self.is_judged and not (before and after))

    @property
    def asks_for_the_same(self) -> bool:
        """Whether both requests name the same requirements, with the same limits."""
        before, after = self.before.inputs, self.after.inputs
        return before is None or after is None or before.requirements_sha256 == after.requirements_sha256

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
    return frozenset((item.name, None) for item in job.requirements if item.kind is None)


def _requirements(job: JobRecord) -> frozenset[Asked]:
    """The requirements that a job was judged by; with trials, those of each trial."""
    has_trials = any(item.counts and item.name == TRIALS for item in job.requirements)
    return frozenset(
        (item.name, item.kind) for item in job.requirements if (item.counts or has_trials) and item.kind != HEALTH
    )
