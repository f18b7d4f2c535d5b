"""Effects of axes, one by one: whether failures, or margins, depend on each axis of a run, or nothing can be claimed.

Values of drawn cells have no partners to be compared with; a straight line within the trials that are comparable says
how much an axis changes at most, also one that changes nothing. All intervals of a run hold together with 95 %, and
none is without width: where all seeds or cells show the same change, the rule of three says what others may show.
"""

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from ...schemas.reports.causes import AxisEffects, Effect, Why
from ..results.rates import margin_units
from ..results.table import ResultTable
from .evidence import AxisColumn, Evidence, evidence_of
from .sensitivity import FEWEST_CLUSTERS, MOST_VALUES, along, joint_level, judged_margins, there_are, within

FEWEST_OUTCOMES = 10
"""Failures, and passes, from which on their share has an interval: with fewer, those of t are too narrow."""
FEWEST_EXPECTED = 5
"""Failures, and passes, to be expected of the trials that lie apart on an axis: with fewer, chance alone looks sure."""


def axis_effects(
    results: ResultTable, why: Why | None, states: Sequence[str | None] | None = None
) -> list[AxisEffects]:
    """Says of each axis of a run whether failures and margins depend on it.

    Failures depend on an axis where a cause with it is claimed of them: one test has one answer in all places.

    Args:
        results: The run's table of results.
        why: Causes of its failures; None: no trial failed.
        states: Digest of all states of each row; None: those of the table; of early releases it has none of
            jobs without trials.
    """
    if not results.axes:
        return []
    claimed = _claimed_with(why)
    tested = {axis for lift in (why.lifts if why else ()) for axis in lift.axes}
    evidence = evidence_of(results, states)
    units = {name: next(iter(found)) for name, found in margin_units(results).items() if len(found) == 1}
    measured: list[tuple[str, str | None, NDArray[np.float64]]] = [("", None, evidence.failed.astype(np.float64))]
    measured += [(name, unit, judged_margins(results, evidence, name)) for name, unit in units.items()]
    contrasts = [(axis, list(_contrasts(axis))) for axis in evidence.axes]
    level = joint_level(evidence, len(units))
    told = [
        AxisEffects(
            axis=axis.name,
            effects=[
                _effect(*each, evidence, found, level).model_copy(
                    update={"claim": "" if each[0] else claimed.get(axis.name, ""), "is_tested": axis.name in tested}
                )
                for each in measured
                if np.isfinite(each[2]).any()
            ],
        )
        for axis, found in contrasts
    ]
    # Of trials that an idle axis repeats only one is left, so that it has one value here.
    return [*told, *(AxisEffects(axis=name, idle=True) for name in evidence.idle if name not in _names(evidence))]


def _claimed_with(why: Why | None) -> dict[str, str]:
    """Returns for each axis the strongest claim that names it, of all failures first, then of the largest groups."""
    groups = [] if why is None else [*([why.overall] if why.overall else []), *why.groups]
    found: dict[str, str] = {}
    for group in groups:
        for claim in group.claims:
            for axis in claim.axes:
                found.setdefault(axis, f"{group.name}: {claim.region}")
    return found


def _names(evidence: Evidence) -> set[str]:
    return {axis.name for axis in evidence.axes}


def _contrasts(axis: AxisColumn) -> Iterator[tuple[str, NDArray[np.float64]]]:
    """Yields what trials are ordered by: their number, or whether they have one of the texts, with that text."""
    if axis.is_number:
        yield "", axis.numbers
        return
    codes = range(min(len(axis.values), MOST_VALUES))
    for code in codes if len(axis.values) > 2 else codes[1:]:  # two values say the same of each other
        yield axis.label(code), (axis.codes == code).astype(np.float64)


def _effect(
    name: str,
    unit: str | None,
    outcomes: NDArray[np.float64],
    evidence: Evidence,
    contrasts: Sequence[tuple[str, NDArray[np.float64]]],
    level: float,
) -> Effect:
    """Returns the surest effect of an axis on one outcome, or an effect that says why none can be told."""
    if not name and (rare := min(evidence.failed.sum(), (~evidence.failed).sum())) < FEWEST_OUTCOMES:
        several = "failures" if evidence.failed.sum() == rare else "passes"
        few = f"an interval takes {FEWEST_OUTCOMES} {several}, and {there_are(int(rare))}"
        if rare:
            needed = evidence.counted(-(-len(evidence) * FEWEST_OUTCOMES // int(rare)))
            few += f"; at this rate that takes {needed} instead of {len(evidence):,}"
        return Effect(on=name, refused=few, too_few=bool(rare))
    if np.nanmax(outcomes) == np.nanmin(outcomes):
        return Effect(on=name, unit=unit, refused="it is the same in all trials")
    found: list[Effect] = []
    refused = ""
    for value, numbers in contrasts:
        answer = along(outcomes, evidence, numbers, level)
        if isinstance(answer, tuple):
            answer = _too_few_apart(name, outcomes, evidence, numbers) or answer
        if answer is None or isinstance(answer, str):
            refused = answer or refused
            continue
        start, end, change, low, high = answer
        found.append(Effect(on=name, unit=unit, value=value, start=start, end=end, change=change, low=low, high=high))
    surest = max(found, key=lambda each: abs(each.change) / max(each.high - each.low, 1e-300), default=None)
    return surest or Effect(on=name, unit=unit, refused=refused or "there are no trials with it", too_few=True)


def _too_few_apart(name: str, outcomes: NDArray[np.float64], evidence: Evidence, numbers: NDArray[np.float64]) -> str:
    """Says why trials that lie apart on an axis, such as those of a rare value, tell nothing; empty if they may."""
    known = np.isfinite(outcomes) & np.isfinite(numbers)
    x = within(numbers[known], evidence.jobs[known])
    apart = float((x**2).sum()) ** 2 / max(float((x**4).sum()), 1e-300)  # of two values the number of the rarer one's
    if name:
        few, least, what = apart, FEWEST_CLUSTERS, "trials"
    else:
        share = float(outcomes[known].mean()) if known.any() else 0.0
        few, least = apart * min(share, 1 - share), FEWEST_EXPECTED
        what = f"{'failures' if share <= 0.5 else 'passes'} to be expected"
    return f"an interval takes {least} {what} with its rarer values, and there are {few:.2g}" if few < least else ""
