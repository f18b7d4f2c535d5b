"""Losses between runs: jobs that are missing, have no verdict any more, or have fewer requirements or trials.

Each loss is reported once, in the first run that has it. A job that a new one replaces is not missing: a specification
that makes new worlds for every run has new jobs in every run.
"""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from ...schemas.reports.changes import Loss, Losses
from ...schemas.reports.run_record import JobRecord
from ..reporting import Outcome
from .compared_runs import HEALTH, JUDGED, TOLD, TRIALS, NightRun, name_of
from .failure_starts import Appearance
from .loss_causes import causes_of_fewer_trials, causes_of_missing

LossKind = Literal["gone", "no_longer_judged", "asked_less", "fewer_trials"]
"""Kinds of losses: the lists of `Losses`."""

_SEEN_TO = ("succeeded", "failed")
"""States of runs in which all steps completed."""


@dataclass(frozen=True)
class FoundLoss:
    """A job or requirement that earlier runs of a specification had and the newest run lacks."""

    kind: LossKind
    night: int
    """Index of the first run that lacks it, from 0 for the oldest."""
    before: Appearance
    """The job in the last run that had it."""
    appearances: Sequence[Appearance]
    """The job in all runs that have it."""
    requirements: Sequence[str] = ()
    """Names of requirements that are no longer requested."""
    trials: tuple[int, int] | None = None
    """Number of counted trials before and now, if there are fewer."""
    causes: Sequence[str] = ()
    """Differences between the runs that leave the job or the trials out, in words."""

    def told(self) -> Loss:
        """Converts the loss to the model that reports contain."""
        now = self.appearances[-1].job
        return Loss(
            cell=name_of(now),
            job=now.label,
            before=self.before.outcome.value,
            before_run_id=self.before.run.run_id,
            requirements=list(self.requirements),
            trials_before=self.trials[0] if self.trials else None,
            trials_now=self.trials[1] if self.trials else None,
            causes=list(self.causes),
        )


def losses_of(runs: Sequence[NightRun], cells: Sequence[Sequence[Appearance]]) -> list[FoundLoss]:
    """Finds jobs and requirements that earlier runs had and the last run lacks.

    Args:
        runs: Runs, the oldest first.
        cells: Jobs of the runs, from `appearances_of`.
    """
    here = [each for each in cells if each[-1].night == len(runs) - 1]
    found = [loss for each in here for loss in (_judged_less(each), _fewer_trials(each)) if loss is not None]
    return [*_gone(runs, cells), *found]


def told_losses(losses: Sequence[FoundLoss]) -> Losses:
    """Converts losses to the model that reports contain, grouped by kind."""
    found: dict[str, list[Loss]] = defaultdict(list)
    for each in losses:
        found[each.kind].append(each.told())
    return Losses(**found)


def _gone(runs: Sequence[NightRun], cells: Sequence[Sequence[Appearance]]) -> list[FoundLoss]:
    vanished: dict[tuple[int, str], list[Sequence[Appearance]]] = defaultdict(list)
    for each in cells:
        step = _step_of(each[-1].job)
        ended = [one for one in each if one.outcome in (*TOLD, Outcome.UNJUDGED)]
        later = range(each[-1].night + 1, len(runs))
        night = next((one for one in later if _has_seen_to(runs[one], step)), None)
        if ended and night is not None:
            vanished[night, step].append(ended)
    return [
        FoundLoss("gone", night, each[-1], each, causes=causes_of_missing(each[-1].job, each[-1].run, runs[night]))
        for (night, step), missing in vanished.items()
        for each in _not_replaced(missing, _new_jobs(night, step, runs[night], cells))
    ]


def _has_seen_to(run: NightRun, step: str) -> bool:
    """Returns whether a run would have a job of a step; a run that failed before it reports that itself."""
    return (run.state in _SEEN_TO and not run.stopped_early) or any(_step_of(job) == step for job in run.jobs)


def _new_jobs(night: int, step: str, run: NightRun, cells: Sequence[Sequence[Appearance]]) -> list[str]:
    """Returns the names of a step's jobs that no earlier run has, or of which that is unknown."""
    new = [each[0].job for each in cells if each[0].night == night]
    unknown = [job for job in run.jobs if job.inputs is None]
    return [name_of(job).test for job in (*new, *unknown) if _step_of(job) == step]


def _not_replaced(vanished: Sequence[Sequence[Appearance]], new: Sequence[str]) -> list[Sequence[Appearance]]:
    """Returns the missing jobs that no new job replaces, by the same name.

    The list is empty if there are at least as many other new jobs as missing ones.
    """
    rest, left = list(new), []
    for each in vanished:
        name = name_of(each[-1].job).test
        if name in rest:
            rest.remove(name)
        else:
            left.append(each)
    return left if len(left) > len(rest) else []


def _judged_less(appearances: Sequence[Appearance]) -> FoundLoss | None:
    """Finds requirements by which a job's last run is no longer judged; None if there are none.

    Runs that ended without a verdict or were cancelled are skipped.
    """
    looked_at = [each for each in appearances if _has_verdict(each) or each.outcome is Outcome.UNJUDGED]
    if not looked_at:
        return None
    if looked_at[-1].outcome is Outcome.UNJUDGED:
        return _no_longer_judged(appearances, looked_at)
    return _asked_less(appearances, looked_at)


def _no_longer_judged(appearances: Sequence[Appearance], looked_at: Sequence[Appearance]) -> FoundLoss | None:
    first = len(looked_at)
    while first and looked_at[first - 1].outcome is Outcome.UNJUDGED:
        first -= 1
    if not first:
        return None
    before, after = looked_at[first - 1], looked_at[first]
    names = sorted(_asked(before.job) - _listed(looked_at[-1].job))
    return FoundLoss("no_longer_judged", after.night, before, appearances, names)


def _asked_less(appearances: Sequence[Appearance], looked_at: Sequence[Appearance]) -> FoundLoss | None:
    """Finds the latest run that dropped requirements which no later run requests again; `None` if there is none.

    It is also `None` if the job had no verdict in the last run.
    """
    if looked_at[-1].outcome not in JUDGED:
        return None
    listed_now = _listed(looked_at[-1].job)
    known: frozenset[str] = frozenset()
    found: FoundLoss | None = None
    before = looked_at[0]
    for each in looked_at:
        asked = _asked(each.job)
        if each.outcome not in JUDGED:  # of what broke, not all requirements need be known
            known |= asked
        else:
            dropped = known - _listed(each.job) - listed_now
            if dropped:
                found = FoundLoss("asked_less", each.night, before, appearances, sorted(dropped))
            known = asked
        before = each
    return found


def _fewer_trials(appearances: Sequence[Appearance]) -> FoundLoss | None:
    """Finds the latest run that counted more trials of a job than the last one does; `None` if there is none.

    It is also `None` if the job is not in the last run.
    """
    counted = [(each, trials) for each in appearances if (trials := _trials(each)) is not None]
    if not counted or counted[-1][0] is not appearances[-1]:
        return None
    now = counted[-1][1]
    more = next((place for place in reversed(range(len(counted))) if counted[place][1] > now), None)
    if more is None:
        return None
    before, trials = counted[more]
    after = counted[more + 1][0]
    causes = causes_of_fewer_trials((before.run, before.job), (after.run, after.job))
    return FoundLoss("fewer_trials", after.night, before, appearances, trials=(trials, now), causes=causes)


def _trials(appearance: Appearance) -> int | None:
    """Returns the number of counted trials of a job; None: it has none, or no verdict."""
    has_trials = any(item.name == TRIALS for item in appearance.job.requirements)
    counted = appearance.job.metrics.get(TRIALS) if has_trials and _has_verdict(appearance) else None
    return None if counted is None else int(counted)


def _has_verdict(appearance: Appearance) -> bool:
    return appearance.outcome in JUDGED or (appearance.outcome is Outcome.BROKEN and appearance.job.verdict == "ERROR")


def _asked(job: JobRecord) -> frozenset[str]:
    """Returns the names of the requirements by which a job, or each of its trials, is judged."""
    if any(item.counts and item.name == TRIALS for item in job.requirements):
        return _listed(job)
    return _listed(job) & {item.name for item in job.requirements if item.counts}


def _listed(job: JobRecord) -> frozenset[str]:
    """Returns the names of a job's requirements, including uncounted ones, since reached goals ended the run."""
    return frozenset(item.name for item in job.requirements if item.kind not in (HEALTH, "off"))


def _step_of(job: JobRecord) -> str:
    return job.step or ""
