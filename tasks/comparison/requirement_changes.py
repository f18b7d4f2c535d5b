"""Changes of requirements between two runs: newly missed, newly met, and changed margins."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ...schemas.reports.changes import ChangedInput, NewlyMissed, RequirementChange
from ...schemas.reports.run_record import JobRecord
from ...schemas.runs.plan import Requirement
from .compared_runs import HEALTH
from .failure_starts import changed_jobs
from .pairing import FAILED, Pair, TrialPairs

_Limit = tuple[str | None, float | None]
_MOST_PLACES = 10
"""Maximum number of trials that a change names."""


@dataclass
class RequirementChanges:
    """Requirements that trials newly miss or newly meet in the second of two runs."""

    changes: list[RequirementChange] = field(default_factory=list)
    """Changes, the most frequently missed first; then those that some trial newly meets."""
    jobs: dict[tuple[str, str], list[str]] = field(default_factory=dict)
    """Requirements that a job newly misses, by step and job id."""

    def missed_by(self, job: JobRecord) -> list[str]:
        """Returns the names of the requirements that a job newly misses."""
        return self.jobs.get((job.step or "", job.label), [])

    def __add__(self, other: "RequirementChanges") -> "RequirementChanges":
        found = {each.name: each for each in self.changes}
        for each in other.changes:
            found[each.name] = _together(found[each.name], each) if each.name in found else each
        return RequirementChanges(_worst_first(found.values()), self.jobs | other.jobs)


def requirement_changes(
    trials: TrialPairs, pairs: Sequence[Pair], versions: Sequence[ChangedInput]
) -> RequirementChanges:
    """Compares which requirements were missed in two runs, requirement by requirement.

    Args:
        trials: Trials that both runs have.
        pairs: Jobs to which the trials belong.
        versions: Packages whose versions differ between the runs, from `changed_versions`.
    """
    found, asked = RequirementChanges(), _Asked(trials, pairs)
    for name in dict.fromkeys((*trials.after.requirements, *trials.before.requirements)):
        before, after = trials.met(name)
        appeared = _only_told_when_missed(name, before, after, trials)
        is_health = bool(appeared.any())
        before = np.where(appeared, np.int8(1), before)
        newly_missed, newly_met = (before == 1) & (after == 0), (before == 0) & (after == 1)
        same = asked.same(name, newly_missed | newly_met)
        newly_missed, newly_met = newly_missed & same, newly_met & same
        if not newly_missed.any() and not newly_met.any():
            continue
        for index in np.unique(trials.jobs[newly_missed]).tolist():
            job = pairs[index].after
            found.jobs.setdefault((job.step or "", job.label), []).append(name)
        found.changes.append(
            RequirementChange(
                name=name,
                pairs=max(int(((before >= 0) & (after >= 0)).sum()), int(trials.judged.sum()) if is_health else 0),
                newly_missed=int(newly_missed.sum()),
                newly_met=int(newly_met.sum()),
                places=[_place(name, index, trials, pairs, versions) for index in _spread(newly_missed, trials.jobs)],
            )
        )
    return RequirementChanges(_worst_first(found.changes), found.jobs)


class _Asked:
    """Limits of requirements in jobs whose requests differ; all trials of a job have the same limits."""

    def __init__(self, trials: TrialPairs, pairs: Sequence[Pair]) -> None:
        self._trials = trials
        self._pairs = pairs
        self._known: dict[int, tuple[dict[str, _Limit], dict[str, _Limit]]] = {}

    def same(self, name: str, which: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Returns a mask of the pairs whose requirement of that name was the same in both runs."""
        found = np.zeros_like(which)
        for index in np.flatnonzero(which).tolist():
            job = int(self._trials.jobs[index])
            if not self._pairs[job].asks_for_the_same:
                before, after = self._of_job(job, index)
                limits = before.get(name), after.get(name)
                found[index] = None in limits or limits[0] == limits[1]
            else:
                found[index] = True
        return found

    def _of_job(self, job: int, index: int) -> tuple[dict[str, _Limit], dict[str, _Limit]]:
        if job not in self._known:
            trials = self._trials
            self._known[job] = (
                _limits(trials.before.requirements_at(int(trials.before_rows[index]))),
                _limits(trials.after.requirements_at(int(trials.after_rows[index]))),
            )
        return self._known[job]


def _limits(requirements: Iterable[Requirement]) -> dict[str, _Limit]:
    """Returns kinds and limits by name; an environment's own requirements may have limits that depend on the run."""
    return {item.name: (item.kind, item.limit if item.kind is not None else None) for item in requirements}


def _worst_first(changes: Iterable[RequirementChange]) -> list[RequirementChange]:
    return sorted(changes, key=lambda change: -change.newly_missed)


def _together(one: RequirementChange, other: RequirementChange) -> RequirementChange:
    return RequirementChange(
        name=one.name,
        pairs=one.pairs + other.pairs,
        newly_missed=one.newly_missed + other.newly_missed,
        newly_met=one.newly_met + other.newly_met,
        places=[*one.places, *other.places][:_MOST_PLACES],
    )


def _only_told_when_missed(
    name: str, before: NDArray[np.int8], after: NDArray[np.int8], trials: TrialPairs
) -> NDArray[np.bool_]:
    """Returns a mask of trials that newly miss a health requirement, which results contain only if it was missed.

    One that did not count before is not comparable, as where the run ended with its goals reached.
    """
    appeared = (before < 0) & (after == 0) & (trials.outcomes[0] <= FAILED)
    for index in np.flatnonzero(appeared).tolist():
        known = trials.before.requirements_at(int(trials.before_rows[index]))
        appeared[index] = all(item.name != name for item in known)
    if appeared.any():
        first = int(trials.after_rows[np.flatnonzero(appeared)[0]])
        kinds = {item.name: item.kind for item in trials.after.requirements_at(first)}
        if kinds.get(name) == HEALTH:
            return appeared
    return np.zeros_like(appeared)


def _spread(which: NDArray[np.bool_], jobs: NDArray[np.int64]) -> list[int]:
    """Returns the indices of some selected trials: one of each job before a second one of any, up to a number."""
    found = np.flatnonzero(which)
    _, first = np.unique(jobs[found], return_index=True)
    rest = np.setdiff1d(np.arange(len(found)), first)
    return found[np.concatenate([np.sort(first), rest])][:_MOST_PLACES].tolist()


def _place(
    name: str, index: int, trials: TrialPairs, pairs: Sequence[Pair], versions: Sequence[ChangedInput]
) -> NewlyMissed:
    pair, row = pairs[int(trials.jobs[index])], int(trials.after_rows[index])
    return NewlyMissed(
        **dict(trials.named(index, pairs)),
        detail=next((item.detail for item in trials.after.requirements_at(row) if item.name == name), ""),
        certain=_repeats(pair, trials, index),
        changed=[*versions, *changed_jobs(pair)],
    )


def _repeats(pair: Pair, trials: TrialPairs, index: int) -> bool:
    """Returns whether a trial had the same seed both times, and programs that the simulation waited for."""
    seeds = (
        table.numbers("seed")[rows[index]]
        for table, rows in ((trials.before, trials.before_rows), (trials.after, trials.after_rows))
    )
    return not (pair.before.runs_free or pair.after.runs_free) and len(set(seeds)) == 1
