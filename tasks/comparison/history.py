"""History of a specification's runs: outcomes of its jobs over time, and changes since the last run."""

from collections import defaultdict
from collections.abc import Collection, Mapping, Sequence

from ...schemas.reports.changes import CellChange, MetricChange, SinceLastRun
from ...schemas.reports.history import CellHistory, History, Night, SharesByNight
from ...schemas.reports.live_comparison import in_words
from ...schemas.reports.report import Share
from ...schemas.reports.run_record import CUT_SHORT, CaseOutcome
from ...schemas.trial_copies import copy_key
from ..reporting import Outcome
from ..results import rates
from ..results.table import ResultTable
from .compared_runs import JUDGED, TOLD, NightRun, name_of, outcome_of, reason_of
from .failure_starts import (
    Appearance,
    appearances_of,
    changed_nights,
    changed_versions,
    differs_with_same_inputs,
    failure_start,
    is_unsteady,
    results_changed,
)
from .losses import losses_of, told_losses
from .pairing import Pair, pair_trials
from .requirement_changes import RequirementChanges, requirement_changes
from .trends import margin_trends


def history_of(name: str, runs: Sequence[NightRun], left_out: int = 0) -> History:
    """Computes the history of a specification over its runs: outcomes by job, requirement and world.

    Args:
        name: Name of the specification.
        runs: Runs of the specification, the oldest first; at least one.
        left_out: Number of older runs that are not included.
    """
    cells = appearances_of(runs)
    # A cell that only one run of long ago has, as of worlds that are other ones every night, tells nothing.
    kept = [each for each in cells if len(each) > 1 or each[-1].night == len(runs) - 1]
    names = _names_of_worlds(kept)
    taken = _taken_over(runs, cells)
    histories = [_cell_history(each, taken) for each in kept]
    return History(
        name=name,
        nights=[_night(run, runs[:index], taken[index]) for index, run in enumerate(runs)],
        left_out=left_out,
        since_last=_since_last(runs, cells),
        cells=sorted(histories, key=_urgency),
        cells_left_out=len(cells) - len(kept),
        worlds=_by_night([_by_world(_own_results(*each), names) for each in zip(runs, taken, strict=True)]),
        requirements=_by_night(
            [rates.requirement_counts(_own_results(*each)) for each in zip(runs, taken, strict=True)]
        ),
    )


def newest_night(run: NightRun) -> Night:
    """Returns a run as a night by itself, beside which no earlier run is shown: all that it took over counts there."""
    return _night(run, [], {job.label for job in run.jobs if job.reused_from not in (None, run.run_id)})


def since_last_run(runs: Sequence[NightRun]) -> SinceLastRun:
    """Returns the changes in the newest run of a specification against the runs before it.

    Each job is compared with its result in the last earlier run that has one.

    Args:
        runs: Runs of the specification, the oldest first; at least one.
    """
    return _since_last(runs, appearances_of(runs))


def since_last_good_run(runs: Sequence[NightRun]) -> SinceLastRun:
    """Returns the changes in the newest run, with all jobs lost since the last successful run.

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
    told = [(each, _told_before(each)) for each in cells if each[-1].night == last and each[-1].outcome in TOLD]
    paired = [(earlier, each[-1]) for each, earlier in told if earlier is not None]
    requirements = _changed_requirements(runs, paired)
    otherwise = sum(
        not Pair(earlier.job, each[-1].job).has_same_requirements
        for each, earlier in told
        if earlier is not None and id(each) not in asked_less
    )
    for each, earlier in told:
        if kind := _kind_of_change(earlier and earlier.outcome, each[-1].outcome):
            found[kind].append(_change(each, requirements))
    return SinceLastRun(
        previous_run_id=previous.run_id if previous else None,
        previous_started_at=previous.started_at if previous else None,
        paired=len(paired),
        unpaired=len(told) - len(paired),
        without_result=sum(outcome_of(job) in (Outcome.CANCELED, Outcome.UNFINISHED) for job in runs[last].jobs),
        other_requirements=otherwise,
        requirements=requirements.changes,
        margins=_fallen_margins(previous, runs[last]) if previous and paired else [],
        shrinking=margin_trends(runs),
        **found,
        **dict(lost),
    )


def _fallen_margins(previous: NightRun, run: NightRun) -> list[MetricChange]:
    """Returns the margins that fell by more than chance; others move every night, and are no news."""
    if not rates.margin_units(run.results):
        return []
    # Imported late: its tests need scipy, and most commands compare no margins.
    from .better_or_worse import fallen_margins

    return [each for each in fallen_margins(previous, run) if each.changed]


def _told_before(appearances: Sequence[Appearance]) -> Appearance | None:
    """Returns the last earlier run in which a job had a verdict or an error; `None` if there is none."""
    return next((each for each in reversed(appearances[:-1]) if each.outcome in TOLD), None)


def _has_results(run: NightRun) -> bool:
    return any(outcome_of(job) in TOLD for job in run.jobs)


def _kind_of_change(before: Outcome | None, now: Outcome) -> str | None:
    """Returns the list of `SinceLastRun` to which a job belongs; None: it passes as before."""
    if before is None:
        return "first_failing" if now.is_failure else None
    if before.is_failure:
        return "still_failing" if now.is_failure else "newly_passing"
    return "newly_failing" if now.is_failure else None


def _change(appearances: Sequence[Appearance], requirements: RequirementChanges) -> CellChange:
    job = appearances[-1].job
    return CellChange(
        cell=name_of(job),
        job=job.label,
        outcome=outcome_of(job).value,
        reason=reason_of(job),
        known=job.known,
        since=failure_start(appearances),
        newly_missed=requirements.missed_by(job),
    )


def _taken_over(runs: Sequence[NightRun], cells: Sequence[Sequence[Appearance]]) -> list[set[str]]:
    """Returns for each run the ids of its jobs with results that count for an earlier run.

    Results of a run that is not among these, such as an older one or a rerun, count for the first that took them over.
    """
    nights = {run.run_id: night for night, run in enumerate(runs)}
    taken: list[set[str]] = [set() for _ in runs]
    for appearances in cells:
        origins: set[str] = set()
        for each in appearances:
            if (origin := each.job.reused_from) is not None:
                if origin in origins or nights.get(origin, each.night) < each.night:
                    taken[each.night].add(each.job.label)
                origins.add(origin)
    return taken


def _own_results(run: NightRun, taken: Collection[str]) -> ResultTable:
    return run.results.without([job for job in run.jobs if job.label in taken])


def _night(run: NightRun, earlier: Sequence[NightRun], taken: Collection[str]) -> Night:
    success = Share(name="", passed=0, failed=0) if 0 < len(run.jobs) == len(taken) else rates.of_table("", run.results)
    unknown = ("low", "high", "rate") if run.state in CUT_SHORT else ("low", "high") if run.stopped_early else ()
    return Night(
        run_id=run.run_id,
        started_at=run.started_at,
        state=run.state,
        jobs=len(run.jobs),
        jobs_judged=sum(outcome_of(job) in JUDGED for job in run.jobs),
        jobs_passed=sum(outcome_of(job) is Outcome.PASSED for job in run.jobs),
        trials=len(run.results),
        success=success.model_copy(update=dict.fromkeys(unknown)),
        refusal=run.refusal,
        step_error=run.step_error,
        known=sum(bool(job.known) for job in run.jobs),
        taken_over=len(taken),
        against=in_words(run.against) if run.against else "",
        interruptions=run.interruptions,
        parameters=run.parameters,
        source=run.source,
        changed=changed_nights(earlier[-1], run) if earlier else [],
        report_path=run.report_path,
    )


def _cell_history(appearances: Sequence[Appearance], taken: Sequence[Collection[str]]) -> CellHistory:
    outcomes: list[CaseOutcome | None] = [None] * len(taken)
    for each in appearances:
        outcomes[each.night] = each.outcome.value
    changes, same_inputs = results_changed(appearances), differs_with_same_inputs(appearances)
    cell = name_of(appearances[-1].job)
    own = [each for each in appearances if each.job.label not in taken[each.night]]
    return CellHistory(
        cell=cell,
        outcomes=outcomes,
        success=rates.of_outcomes(cell.title, [each.outcome.value for each in own], [_key(each) for each in own]),
        changes=changes,
        unsteady=is_unsteady(changes, same_inputs),
        same_inputs=same_inputs,
        since=failure_start(appearances),
    )


def _key(appearance: Appearance) -> int | None:
    job = appearance.job
    return copy_key(job.state_digest, job.inputs and job.inputs.world, appearance.outcome.value)


def _urgency(history: CellHistory) -> tuple[bool, bool, float]:
    rate = history.success.rate
    return history.since is None, not history.unsteady, 1.0 if rate is None else rate


def _by_night(nights: Sequence[Mapping[str, rates.Counts]]) -> list[SharesByNight]:
    """Computes pass rates by a common property of trials, for each run, the worst first."""
    names = dict.fromkeys(name for night in nights for name in night)
    shares = [
        SharesByNight(
            total=sum((night[name] for night in nights if name in night), rates.Counts()).share(name),
            nights=[night[name].share("") if name in night else None for night in nights],
        )
        for name in names
    ]
    return sorted(shares, key=lambda each: 1.0 if each.total.rate is None else each.total.rate)


def _by_world(results: ResultTable, names: Mapping[str, str]) -> dict[str, rates.Counts]:
    """Counts the trials of a run by the name of their world."""
    found = rates.counts_by(results, "world")
    return {names[world]: counts for world, counts in found.items() if world in names}


def _names_of_worlds(cells: Sequence[Sequence[Appearance]]) -> dict[str, str]:
    """Returns the names of worlds by content hash, as in the last run that used them."""
    names: dict[str, str] = {}
    for appearances in cells:
        job = appearances[-1].job
        if job.inputs and job.inputs.world:
            names[job.inputs.world] = (
                f"{job.world_name or (job.world or '').rpartition('/')[2]} ({job.inputs.world[:8]})"
            )
    return names


def _changed_requirements(
    runs: Sequence[NightRun], paired: Sequence[tuple[Appearance, Appearance]]
) -> RequirementChanges:
    """Compares requirements that jobs miss now with those that they met in their last run before."""
    by_night: dict[int, list[Pair]] = defaultdict(list)
    for earlier, now in paired:
        by_night[earlier.night].append(Pair(earlier.job, now.job))
    found = RequirementChanges()
    for night, pairs in by_night.items():
        versions = changed_versions(runs[night], runs[-1])
        found += requirement_changes(pair_trials(pairs, runs[night], runs[-1]), pairs, versions)
    return found
