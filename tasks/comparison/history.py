"""The runs of one specification: cells through the nights, and what changed since the last run."""

from collections import defaultdict
from collections.abc import Callable, Iterable, Sequence

from ...schemas.reports.changes import CellChange, SinceLastRun
from ...schemas.reports.history import CellHistory, History, Night, SharesByNight
from ...schemas.reports.run_record import JobRecord
from ...schemas.reports.states import CaseOutcome
from ..reporting import Outcome, of_outcomes
from .failures import (
    Appearance,
    appearances_of,
    changed_nights,
    differs_with_same_inputs,
    failure_start,
    is_unsteady,
    results_changed,
)
from .losses import losses_of, told_losses
from .nights import TOLD, NightRun, name_of, outcome_of, reason_of
from .pairing import Pair

Named = Callable[[JobRecord], Iterable[tuple[str, Outcome]]]
"""Names under which a job counts, with how it ended under each."""


def history_of(name: str, runs: Sequence[NightRun], left_out: int = 0) -> History:
    """The history of a specification.

    Args:
        name: its name.
        runs: its runs, the oldest first; at least one.
        left_out: how many older runs there are.
    """
    cells = appearances_of(runs)
    # A cell that only one run of long ago has, as of worlds that are other ones every night, tells nothing.
    kept = [each for each in cells if len(each) > 1 or each[-1].night == len(runs) - 1]
    histories = [_cell_history(each, len(runs)) for each in kept]
    return History(
        name=name,
        nights=[_night(run, runs[index - 1] if index else None) for index, run in enumerate(runs)],
        left_out=left_out,
        since_last=_since_last(runs, cells),
        cells=sorted(histories, key=_urgency),
        cells_left_out=len(cells) - len(kept),
        worlds=_by_night(runs, _worlds_named(kept)),
        requirements=_by_night(runs, _requirements),
    )


def since_last_run(runs: Sequence[NightRun]) -> SinceLastRun:
    """What changed in the last of some runs of a specification.

    Each of its jobs is compared with the last earlier run that has a result of it.

    Args:
        runs: the runs, the oldest first; at least one.
    """
    return _since_last(runs, appearances_of(runs))


def since_last_good_run(runs: Sequence[NightRun]) -> SinceLastRun:
    """The same, with all that was lost since the last run before that succeeded.

    A night after bad ones is good again only if what failed in them is still judged.
    """
    cells = appearances_of(runs)
    last = len(runs) - 1
    good = next((night for night in reversed(range(last)) if runs[night].state == "succeeded"), -1)
    lost = [each for each in losses_of(runs, cells) if each.night > good]
    return _since_last(runs, cells).model_copy(update=dict(told_losses(lost)))


def _since_last(runs: Sequence[NightRun], cells: Sequence[Sequence[Appearance]]) -> SinceLastRun:
    last = len(runs) - 1
    losses = [each for each in losses_of(runs, cells) if each.night == last]
    asked_less, lost = {id(each.appearances) for each in losses if each.kind == "asked_less"}, told_losses(losses)
    previous = next((run for run in reversed(runs[:last]) if _has_results(run)), None)
    found: dict[str, list[CellChange]] = defaultdict(list)
    counts, otherwise = {True: 0, False: 0}, 0
    for appearances in cells:
        now = appearances[-1]
        if now.night != last or now.outcome not in TOLD:
            continue
        earlier = next((each for each in reversed(appearances[:-1]) if each.outcome in TOLD), None)
        counts[earlier is not None] += 1
        if earlier is not None and id(appearances) not in asked_less:
            otherwise += not Pair(earlier.job, now.job).has_same_requirements
        if kind := _kind_of_change(earlier and earlier.outcome, now.outcome):
            found[kind].append(_change(appearances))
    return SinceLastRun(
        previous_run_id=previous.run_id if previous else None,
        previous_started_at=previous.started_at if previous else None,
        paired=counts[True],
        unpaired=counts[False],
        other_requirements=otherwise,
        **found,
        gone=lost.gone,
        no_longer_judged=lost.no_longer_judged,
        asked_less=lost.asked_less,
    )


def _has_results(run: NightRun) -> bool:
    return any(outcome_of(job) in TOLD for job in run.jobs)


def _kind_of_change(before: Outcome | None, now: Outcome) -> str | None:
    """Under which list of `SinceLastRun` a job stands; None: it passes as before."""
    if before is None:
        return "first_failing" if now.is_failure else None
    if before.is_failure:
        return "still_failing" if now.is_failure else "newly_passing"
    return "newly_failing" if now.is_failure else None


def _change(appearances: Sequence[Appearance]) -> CellChange:
    job = appearances[-1].job
    return CellChange(
        cell=name_of(job),
        job=job.label,
        outcome=outcome_of(job).value,
        reason=reason_of(job),
        since=failure_start(appearances),
    )


def _night(run: NightRun, before: NightRun | None) -> Night:
    return Night(
        run_id=run.run_id,
        started_at=run.started_at,
        state=run.state,
        success=of_outcomes("", [outcome_of(job) for job in run.jobs]),
        source=run.source,
        changed=changed_nights(before, run) if before else [],
        report_path=run.report_path,
    )


def _cell_history(appearances: Sequence[Appearance], nights: int) -> CellHistory:
    outcomes: list[CaseOutcome | None] = [None] * nights
    for each in appearances:
        outcomes[each.night] = each.outcome.value
    changes, same_inputs = results_changed(appearances), differs_with_same_inputs(appearances)
    cell = name_of(appearances[-1].job)
    return CellHistory(
        cell=cell,
        outcomes=outcomes,
        success=of_outcomes(cell.title, [each.outcome for each in appearances]),
        changes=changes,
        unsteady=is_unsteady(changes, same_inputs),
        same_inputs=same_inputs,
        since=failure_start(appearances),
    )


def _urgency(history: CellHistory) -> tuple[bool, bool, float]:
    rate = history.success.rate
    return history.since is None, not history.unsteady, 1.0 if rate is None else rate


def _by_night(runs: Sequence[NightRun], named: Named) -> list[SharesByNight]:
    """Shares of what jobs count under, night by night, the worst first."""
    found: dict[str, list[list[Outcome]]] = {}
    for night, run in enumerate(runs):
        for job in run.jobs:
            for name, outcome in named(job):
                found.setdefault(name, [[] for _ in runs])[night].append(outcome)
    shares = [
        SharesByNight(
            total=of_outcomes(name, [outcome for night in nights for outcome in night]),
            nights=[of_outcomes("", night) if night else None for night in nights],
        )
        for name, nights in found.items()
    ]
    return sorted(shares, key=lambda each: 1.0 if each.total.rate is None else each.total.rate)


def _requirements(job: JobRecord) -> Iterable[tuple[str, Outcome]]:
    for item in job.requirements:
        if item.counts:
            judged = Outcome.PASSED if item.satisfied else Outcome.FAILED
            yield item.name, Outcome.BROKEN if item.error is not None else judged


def _worlds_named(cells: Sequence[Sequence[Appearance]]) -> Named:
    """Jobs by the content of their world, which is called what its last run calls it."""
    names: dict[str, str] = {}
    for appearances in cells:
        job = appearances[-1].job
        if job.inputs and job.inputs.world:
            names[job.inputs.world] = f"{(job.world or '').rpartition('/')[2]} ({job.inputs.world[:8]})"

    def named(job: JobRecord) -> Iterable[tuple[str, Outcome]]:
        if job.inputs and job.inputs.world in names:
            yield names[job.inputs.world], outcome_of(job)

    return named
