"""The reasons of a run's failures: groups, claims about them, sensitivities, drawings, and what cannot be told."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ...schemas.reports.causes import CellPlot, Claim, FailureGroup, MarginPlot, Sensitivity, Why
from ...schemas.reports.live_comparison import FEWEST_WORLDS
from ...schemas.wire.common import counted
from ..results.table import ResultTable
from .compared import compared, is_compared_with_failures
from .evidence import AxisColumn, Evidence, evidence_of, varies
from .groups import Group, groups_of
from .lift import Lift, lift_of
from .plots import cell_plot, margin_plot
from .regions import regions_of
from .sensitivity import judged_margins, sensitivities, there_are, varying
from .tested_causes import Hypothesis, claims_of, fewest_failures, hypotheses_of, lifts_of

_SEED = 38
"""Seed of permutations: the same table has the same answer."""
_MOST_PLOTS = 6
_RELEVANT_LIFT, _RELEVANT_RISE = 1.5, 0.2
"""Times as often, or failures of a trial more, from which on an effect of an axis must be ruled out to say it has none.

A reader would look for a cause from about there on; the second is for what fails so often that it cannot do much more.
"""


def explain(results: ResultTable, *, refused: str = "", states: Sequence[str | None] | None = None) -> Why | None:
    """Groups the failures of a run and finds what they go with; `None` if no trial failed.

    Args:
        results: The run's table of results.
        refused: Why nothing may be claimed of this run; empty: it may.
        states: Digest of all states of each row; None: those of the table; of early releases it has none of
            jobs without trials.
    """
    evidence = evidence_of(results, states)
    if not evidence.failed.any():
        return None
    axes = list(varying(evidence))
    wholes = groups_of(evidence)
    tested = _tested(results, evidence, wholes)
    fewest = fewest_failures(len(axes))
    can_tell = not refused and bool(axes or evidence.world_count >= FEWEST_WORLDS)
    chosen_from = list({id(each): each for each in tested.values()}.values())
    large = [each for each in chosen_from if each.count >= fewest] if can_tell else []
    chance = np.random.default_rng(_SEED)
    found = hypotheses_of(evidence, large, axes, chance)
    claimed = {id(group): _claimed(evidence, group, number, found) for number, group in enumerate(large)}

    def claims_about(group: Group) -> _Claims:
        return claimed.get(id(tested[id(group)]), [])

    chosen = sorted(
        (each for whole in wholes for each in _chosen(whole, claims_about)),
        key=lambda each: (-each.count, each.signature.order),
    )
    groups = [
        _reported(
            results, evidence, each, claims_about(each),
            _too_few(evidence, tested[id(each)], fewest, axes if can_tell else None)
            or ("" if claims_about(each) else _in_doubt(evidence, tested[id(each)], axes)),
        )
        for each in chosen
    ]  # fmt: skip
    margins, not_shown = sensitivities(results, evidence)
    names = [_name(each) for each in large]
    return Why(
        trials=len(evidence),
        failed=int(evidence.failed.sum()),
        groups=groups,
        lifts=lifts_of(evidence, large, names, found),
        sensitivities=margins,
        margin_plots=_margin_plots(results, evidence, margins),
        cell_plots=_cell_plots(evidence, [(tested[id(each)], claims_about(each)) for each in chosen], axes),
        refused=[*([refused] if refused else _refused(evidence, axes)), *not_shown],
    )


_Claims = list[tuple[Claim, Hypothesis]]


def _tested(results: ResultTable, evidence: Evidence, wholes: Sequence[Group]) -> dict[int, Group]:
    """Returns the group that is tested for each group, by its id: itself, or the whole one where nearly none passed.

    Failures of one room that are compared with those of others would make two causes of one that acts everywhere.
    """
    if not is_compared_with_failures(evidence):
        return {id(each): each for whole in wholes for each in (whole, *whole.parts)}
    found = [(whole, compared(results, evidence, whole)) for whole in wholes]
    return {id(each): group for whole, group in found for each in (whole, *whole.parts)}


def _claimed(evidence: Evidence, group: Group, number: int, found: Sequence[Hypothesis]) -> _Claims:
    return claims_of(evidence, group, [each for each in found if each.group == number])


def _chosen(whole: Group, claims_about: Callable[[Group], _Claims]) -> Sequence[Group]:
    """Returns the group, or its parts if one of them has a stronger claim of a cause, or the whole group has none."""

    def strength(group: Group) -> float:
        return max((each.strength for _, each in claims_about(group)), default=0.0)

    if not whole.parts:
        return [whole]
    of_whole = strength(whole)
    return [whole] if of_whole and of_whole >= max(map(strength, whole.parts)) else whole.parts


def _name(group: Group) -> str:
    return FailureGroup(**group.signature._asdict(), failed=group.count, job="", command="").name


def _reported(results: ResultTable, evidence: Evidence, group: Group, claims: _Claims, refused: str) -> FailureGroup:
    region = claims[0][1].mask if claims else np.ones(len(evidence), dtype=np.bool_)
    inside = group.failed & region
    rows = evidence.rows[inside if inside.any() else group.failed]
    outputs = results.texts("output")
    kept = next((row for row in rows.tolist() if outputs[row]), None)
    row = int(rows[0]) if kept is None else kept
    job, number = results.texts("job")[row] or "", results.numbers("trial")[row]
    trial = None if np.isnan(number) else int(number)
    return FailureGroup(
        **group.signature._asdict(),
        failed=group.count,
        claims=[claim for claim, _ in claims],
        job=job,
        trial=trial,
        clip=None if kept is None else outputs[kept],
        command=f"robomaker repro {job}" + ("" if trial is None else f" --trial {trial}"),
        refused=refused,
    )


def _too_few(evidence: Evidence, group: Group, fewest: int, axes: Sequence[AxisColumn] | None) -> str:
    """Says why nothing could be claimed of a group of failures, and how many trials would do; empty if it could.

    The region that fits best is named, too, where its interval alone, without those of others, shows more failures.
    """
    trials, failures = len(evidence), group.count
    if axes is None:
        return "no cause was looked for"
    if failures >= fewest:
        return ""
    needed = -(-trials * fewest // failures)
    fit = _best_fit(evidence, group, axes)
    may = f"; {_may_go_with(evidence, group, *fit)}" if fit is not None and fit[1].low > 1 else ""
    return (
        f"a claim takes {fewest} failures, and {there_are(failures)}; at this rate that takes {needed:,} trials "
        f"instead of {trials:,}{may}"
    )


def _best_fit(evidence: Evidence, group: Group, axes: Sequence[AxisColumn]) -> tuple[str, Lift] | None:
    """Returns the region of an axis that a group's failures go with most surely, in words; None: none is comparable."""
    regions = [(region.words, region.mask(axis)) for axis in axes for region in regions_of(axis)]
    lifts = [(words, lift) for words, mask in regions if (lift := lift_of(evidence, group, mask)) is not None]
    return max(lifts, key=lambda item: item[1].low, default=None)


def _is_relevant(lift: Lift) -> bool:
    return lift.value >= _RELEVANT_LIFT or lift.inside - lift.outside >= _RELEVANT_RISE


def _may_go_with(evidence: Evidence, group: Group, words: str, lift: Lift) -> str:
    others = len(evidence) - int(group.at_risk.sum())
    besides = f", without {others} that failed otherwise" if others else ""
    return (
        f"it may go with {words} ({lift.failed_inside} of {lift.trials_inside}, elsewhere {lift.failed_outside} of "
        f"{lift.trials_outside}{besides})"
    )


def _in_doubt(evidence: Evidence, group: Group, axes: Sequence[AxisColumn]) -> str:
    """Names the region of an axis that might explain a group although it is not shown to; empty: none might.

    Trials that failed otherwise are counted nowhere unless `compared` counts them; the number of others is told.
    """
    if not (group.at_risk & ~group.failed).any():
        return _nothing_to_compare(evidence, group)
    regions = [(region.words, region.mask(axis)) for axis in axes for region in regions_of(axis)]
    fit = _best_fit(evidence, group, axes)
    if fit is None:
        return _bare_regions(group, regions) or ("too few trials to tell whether an axis explains it" if axes else "")
    _, best = fit
    if best.high < _RELEVANT_LIFT and best.outside * (best.high - 1) < _RELEVANT_RISE:
        return _bare_regions(group, regions)
    if not _is_relevant(best):
        return _bare_regions(group, regions) or "too few trials to tell whether an axis explains it"
    return f"too few trials to tell: {_may_go_with(evidence, group, *fit)}"


def _bare_regions(group: Group, regions: Sequence[tuple[str, NDArray[np.bool_]]]) -> str:
    """Says that all trials of a region failed otherwise, so that none can be compared; empty: there is no such."""
    bare = [(words, int(mask.sum())) for words, mask in regions if not (mask & group.at_risk).any()]
    if not bare:
        return ""
    words, count = max(bare, key=lambda item: item[1])
    which = "the only trial" if count == 1 else f"all {count} trials"
    return f"too few trials to tell: {which} with {words} failed otherwise, so there is nothing to compare with"


def _nothing_to_compare(evidence: Evidence, group: Group) -> str:
    """Says that all trials failed, and none of them can stand for a trial that met the group's requirement."""
    others = len(evidence) - int(group.at_risk.sum())
    besides = f" ({others} failed otherwise, perhaps before they could have failed so)" if others else ""
    return f"no trial passed, so there is nothing to compare with{besides}"


def _refused(evidence: Evidence, axes: Sequence[AxisColumn]) -> Iterator[str]:
    if evidence.twins:
        count = "counts" if evidence.twins == 1 else "count"
        yield (
            f"{counted(evidence.twins, 'trial')} {count} for nothing: others of their job, or jobs of their step in "
            "the same world, with the same values of all axes went through the same states; an application whose "
            "states depend on the seed would do"
        )
    for name in evidence.idle:
        yield (
            f"axis {name} changed nothing: trials that differ in it alone went through the same states, and count once"
        )
    told = {axis.name for axis in axes}
    for axis in evidence.axes:
        if axis.name not in told and axis.name not in evidence.idle:
            so = "so that it cannot be told from the jobs' worlds"
            if varies(evidence.worlds, axis.codes).any():
                so = "and trials are compared with those of their job only; the report compares a step's axes in pairs"
            yield f"{axis.name} has the same value in all trials of each job, {so}; several values in each job would do"
    if not evidence.axes and evidence.world_count < FEWEST_WORLDS:
        worlds = counted(evidence.world_count, "world")
        yield f"no cause can be claimed of trials without axes in {worlds}; axes, or {FEWEST_WORLDS} worlds, would do"


def _margin_plots(results: ResultTable, evidence: Evidence, found: Sequence[Sensitivity]) -> list[MarginPlot]:
    """Plots of the margins that change along an axis, those that change most surely first."""
    axes = {axis.name: axis for axis in evidence.axes}
    shown = sorted(
        (each for each in found if each.is_shown),
        key=lambda each: -abs(each.change) / max(each.high - each.low, 1e-300),
    )
    plots = [
        margin_plot(judged_margins(results, evidence, each.requirement), axes[each.axis], each.requirement, each.unit)
        for each in shown[:_MOST_PLOTS]
    ]
    return [plot for plot in plots if plot is not None]


def _cell_plots(
    evidence: Evidence, groups: Sequence[tuple[Group, _Claims]], axes: Sequence[AxisColumn]
) -> list[CellPlot]:
    by_name = {axis.name: axis for axis in axes}
    wanted = [(group, hypothesis) for group, claims in groups for _, hypothesis in claims if hypothesis.kind != "world"]
    return [_cell_plot(evidence, group, hypothesis, by_name) for group, hypothesis in wanted[:_MOST_PLOTS]]


def _cell_plot(evidence: Evidence, group: Group, hypothesis: Hypothesis, axes: Mapping[str, AxisColumn]) -> CellPlot:
    """Plots the first two axes of a claim; of three axes only for trials in the third's region."""
    shown = [axes[name] for name in hypothesis.axes[:2]]
    name = _name(group)
    for third, words in zip(hypothesis.axes[2:], hypothesis.parts[2:], strict=True):
        column = axes[third]
        inside = np.isin(column.codes, column.codes[hypothesis.mask])
        group = replace(group, failed=group.failed & inside, at_risk=group.at_risk & inside)
        name = f"{name}, where {words},"
    return cell_plot(evidence, group, name, shown)
