"""The reasons of a run's failures: groups, claims about them, sensitivities, drawings, and what cannot be told."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from ...schemas.reports.causes import CellPlot, FailureGroup, MarginPlot, NeededUnits, Sensitivity, Why
from ...schemas.reports.live_comparison import FEWEST_WORLDS
from ...schemas.wire.common import counted
from ..results.table import ResultTable
from .doubts import Doubt, doubt_of, in_units
from .evidence import AxisColumn, Evidence, evidence_of
from .findings import Findings, findings_of
from .groups import Group, breakdown_of
from .plots import cell_plot, margin_plot
from .sensitivity import judged_margins, sensitivities
from .tested_causes import Hypothesis, lifts_of

_MOST_PLOTS = 6


def explain(
    results: ResultTable, *, refused: str = "", states: Sequence[str | None] | None = None, again: str = ""
) -> Why | None:
    """Groups the failures of a run and finds what they go with; `None` if no trial failed.

    Args:
        results: The run's table of results.
        refused: Why nothing may be claimed of this run; empty: it may.
        states: Digest of all states of each row; None: those of the table; of early releases it has none of
            jobs without trials.
        again: Command that runs the specification again; empty: not known.
    """
    evidence = evidence_of(results, states)
    if not evidence.failed.any():
        return None
    found = findings_of(results, evidence, can_claim=not refused)
    margins, not_shown = sensitivities(results, evidence)
    chosen = sorted(
        (each for whole in found.wholes for each in found.chosen(whole)),
        key=lambda each: (-each.count, each.signature.order),
    )
    groups = [_reported(results, evidence, each, found) for each in chosen]
    if len(groups) == 1:
        groups = [groups[0].model_copy(update={"copies": evidence.failed_copies})]
    return Why(
        trials=len(evidence),
        failed=int(evidence.failed.sum()),
        copies=evidence.failed_copies,
        overall=None if found.everything is None else _reported(results, evidence, found.everything, found),
        groups=groups,
        lifts=lifts_of(evidence, found.large, [_name(each) for each in found.large], found.hypotheses),
        sensitivities=margins,
        margin_plots=_margin_plots(results, evidence, margins),
        cell_plots=_cell_plots(evidence, found, [each for each in (found.everything, *chosen) if each is not None]),
        again=again,
        refused=[*([refused] if refused else _refused(evidence, found.axes)), *not_shown],
    )


def _name(group: Group) -> str:
    return FailureGroup(**group.signature._asdict(), failed=group.count, job="", command="").name


def _reported(results: ResultTable, evidence: Evidence, group: Group, found: Findings) -> FailureGroup:
    claims = found.claims(group)
    region = claims[0][1].mask if claims else np.ones(len(evidence), dtype=np.bool_)
    inside = group.failed & region
    rows = evidence.rows[inside if inside.any() else group.failed]
    outputs = results.texts("output")
    kept = next((row for row in rows.tolist() if outputs[row]), None)
    row = int(rows[0]) if kept is None else kept
    job, number = results.texts("job")[row] or "", results.numbers("trial")[row]
    trial = None if np.isnan(number) else int(number)
    doubt = Doubt() if claims else doubt_of(evidence, group, found)
    return FailureGroup(
        **group.signature._asdict(),
        failed=group.count,
        breakdown=breakdown_of(evidence, group),
        claims=[claim for claim, _ in claims],
        job=job,
        trial=trial,
        of_trials=not evidence.of_jobs,
        clip=None if kept is None else outputs[kept],
        command=f"robomaker repro {job}" + ("" if trial is None else f" --trial {trial}"),
        refused=doubt.words,
        needed=None if doubt.needed is None else NeededUnits.of(*in_units(doubt.needed, evidence)),
        shared="" if claims else _shared(group, found),
    )


def _shared(group: Group, found: Findings) -> str:
    """Says how many failures of a group have the cause that is claimed of all; empty: none is, or too few have it."""
    if found.everything is None or not (claims := found.claims(found.everything)):
        return ""
    inside = int((group.failed & claims[0][1].mask).sum())
    return f"{inside} of {group.count} have {claims[0][0].region}" if 2 * inside > group.count else ""


def _refused(evidence: Evidence, axes: Sequence[AxisColumn]) -> Iterator[str]:
    if evidence.twins:
        count = "counts" if evidence.twins == 1 else "count"
        yield (
            f"{evidence.counted(evidence.twins)} {count} for nothing: others of their job, or jobs of their step in "
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
            of = "jobs of each world" if evidence.of_jobs else "trials of each job"
            yield (
                f"{axis.name} has the same value in all {of}, so that it cannot be told from the jobs' worlds; several "
                "values in each world would do"
            )
    # Of jobs in a single world and without axes, which were not to find a cause, only their reasons are told.
    if not evidence.axes and 1 < evidence.world_count < FEWEST_WORLDS:
        worlds = counted(evidence.world_count, "world")
        yield (
            f"{worlds} are too few to look for what the failures have in common; {FEWEST_WORLDS} of them, or axes, "
            "would do"
        )


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


def _cell_plots(evidence: Evidence, found: Findings, groups: Sequence[Group]) -> list[CellPlot]:
    by_name = {axis.name: axis for axis in found.axes}
    wanted = [(found.tested_as(group), each) for group in groups for _, each in found.claims(group) if each.axes]
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
