"""Reasons why no cause is claimed of a group of failures, with the number of trials that would tell one."""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...schemas.reports.causes import NOT_LOOKED_FOR
from ...schemas.wire.common import counted
from .evidence import AxisColumn, Evidence, key_codes
from .findings import Findings
from .groups import Group
from .lift import Lift, is_drawn, lift_of, p_by_chance
from .needed import Needed, trials_needed
from .permutation_tests import growth_needed, units_of
from .regions import regions_of
from .sensitivity import there_are
from .tested_causes import ALPHA
from .world_kinds import kind_codes, lift_of_kind

_RELEVANT_LIFT, _RELEVANT_RISE = 1.5, 0.2
"""Times as often, or failures of a trial more, from which on an effect of an axis must be ruled out to say it has none.

A reader would look for a cause from about there on; the second is for what fails so often that it cannot do much more.
"""

_MOST_LEFT_OUT = 0.5
"""Share of the trials of a region that are compared, below which the others hide too much."""


class _Tried(NamedTuple):
    """Region of an axis in words, with its trials."""

    words: str
    mask: NDArray[np.bool_]
    axis: AxisColumn


class _Fit(NamedTuple):
    """Region that a group's failures go with."""

    words: str
    mask: NDArray[np.bool_]
    axis: AxisColumn | None
    """Its axis; None: it is a kind of worlds."""
    lift: Lift
    leaves_out_chance: bool
    """Whether its own interval, or else its exact test, leaves out chance; nothing is corrected for other axes."""
    where: str = "have"
    """Verb between failures and the region."""


class Doubt(NamedTuple):
    """Reason why nothing is claimed, or a part of it."""

    words: str = ""
    """Clause without a full stop; empty: no axis and no world explains it."""
    needed: Needed | None = None
    """Trials that would tell, as the words say; None: they name no number."""


def doubt_of(evidence: Evidence, group: Group, found: Findings) -> Doubt:
    """Says why nothing is claimed of a group, and how many trials would do.

    Args:
        evidence: The trials.
        group: The group, without a claim.
        found: All groups with their claims.
    """
    tested = found.tested_as(group)
    if not found.can_tell:
        return Doubt(NOT_LOOKED_FOR)
    regions = [_Tried(region.words, region.mask(axis), axis) for axis in found.axes for region in regions_of(axis)]
    fit = _best_fit(evidence, tested, regions, are_few=tested.count < found.fewest)
    if tested.count < found.fewest:
        return _too_few(evidence, tested, found, fit)
    if not (tested.at_risk & ~tested.failed).any():
        return Doubt(_nothing_to_compare(evidence, tested))
    bare = _bare_regions(evidence, tested, regions)
    if fit is None:
        few = f"too few {_noun(evidence)} to tell whether an axis explains it" if found.axes else ""
        return Doubt(bare or few)
    best = fit.lift
    if best.high < _RELEVANT_LIFT and best.outside * (best.high - 1) < _RELEVANT_RISE:
        return Doubt(bare)
    if bare and not _is_suspect(tested, fit):
        return Doubt(bare)
    if not _is_suspect(tested, fit):
        more = _to_tell_any(evidence, tested, found, fit)
        return Doubt(f"no axis and no world is shown to explain it{more.words}", more.needed)
    more = _more(evidence, tested, found, fit)
    return Doubt(f"too few {_noun(evidence)} to tell: {_may_go_with(evidence, tested, fit)}{more.words}", more.needed)


def _noun(evidence: Evidence) -> str:
    return "jobs" if evidence.of_jobs else "trials"


def _too_few(evidence: Evidence, group: Group, found: Findings, fit: _Fit | None) -> Doubt:
    """Says that a claim takes more failures, and how many trials have them at the rate seen.

    The region that fits best is named before, where it alone leaves out chance, or all failures and nothing else are in
    it.
    """
    told = f"takes {counted(found.fewest, 'failure')}, and {there_are(group.count)}"
    least = _least(evidence, group, found, fit)
    more = _takes("at this rate that", None if least is None else Needed(least), evidence)
    if fit is None or not (fit.leaves_out_chance or _is_shared(group, fit)):
        return Doubt(f"a claim {told}{more.words}", more.needed)
    more = _more(evidence, group, found, fit) if fit.leaves_out_chance else more
    return Doubt(f"{_may_go_with(evidence, group, fit)}; too few to claim: that {told}{more.words}", more.needed)


def _is_shared(group: Group, fit: _Fit) -> bool:
    """Whether all failures of a group, two at least, and nothing that passed, are in a region."""
    lift = fit.lift
    return 2 <= group.count == lift.failed_inside == lift.trials_inside and not lift.failed_outside


def _more(evidence: Evidence, group: Group, found: Findings, fit: _Fit) -> Doubt:
    """Says how many trials would tell an effect of the size that was seen; empty: that cannot be planned."""
    return _takes("to tell so large an effect", _needed(evidence, group, found, fit, fit.lift), evidence)


def _takes(what: str, needed: Needed | None, evidence: Evidence) -> Doubt:
    return Doubt(f"; {what} takes {_in_words(needed, evidence)}", needed) if needed else Doubt()


def _needed(evidence: Evidence, group: Group, found: Findings, fit: _Fit, lift: Lift) -> Needed | None:
    """Plans the trials that pass each test of a claim, for failure rates that were seen in a region, or others."""
    least = _least(evidence, group, found, fit)
    return None if least is None else trials_needed(evidence, group, fit.mask, lift, least, ALPHA / found.tests)


def _least(evidence: Evidence, group: Group, found: Findings, fit: _Fit | None) -> int | None:
    """Returns the trials that a claim takes whatever the rates are, if failures come as often as they did.

    None: no number of trials like these would do, as none of them can be compared.
    """
    growth = found.fewest / max(1, group.count)
    if fit is not None and fit.axis is not None:
        units = units_of(evidence, group, [fit.axis])
        growth = max(growth, growth_needed(units, fit.mask, len(regions_of(fit.axis)), ALPHA / found.tests))
    return math.ceil(len(evidence) * growth) if math.isfinite(growth) else None


def _in_words(needed: Needed, evidence: Evidence) -> str:
    """Says how many trials it takes and how to get them: `96 jobs instead of 32, such as 6 seeds instead of 2`."""
    what, now, count = in_units(needed, evidence)
    how = "in" if needed.worlds is not None else "such as"
    told = f"{evidence.counted(needed.trials)} instead of {len(evidence):,}"
    return f"{told}, {how} {counted(count, what)} instead of {now}"


def in_units(needed: Needed, evidence: Evidence) -> tuple[str, int, int]:
    """Returns what there should be more of (`seed`, `point` or `world`), how many there are, and how many would do."""
    if needed.worlds is not None:
        return "world", evidence.world_count, needed.worlds
    what, now = _source(evidence)
    return what, now, math.ceil(now * needed.trials / len(evidence))


def _source(evidence: Evidence) -> tuple[str, int]:
    """Returns what makes more trials of each cell, `seed` or `point`, and how many there are of it now."""
    now = _each(evidence, evidence.cells, evidence.seeds)
    if is_drawn(evidence) and _are_points(evidence) and now == 1:
        return "point", _each(evidence, np.zeros_like(evidence.cells), evidence.cells)
    return "seed", now


def _are_points(evidence: Evidence) -> bool:
    """Whether cells are points in ranges, nearly each with values of its own; cells of a grid share those listed.

    People list values with few digits, also where one axis alone has many.
    """
    cells = int(evidence.cells.max(initial=-1)) + 1
    own = (axis for axis in evidence.axes if axis.is_number and 2 * len(axis.values) > cells)
    numbers = (float(value) for axis in own for value in axis.values if value is not None)
    return any(not math.isclose(each, float(f"{each:.4g}")) for each in numbers)


def _each(evidence: Evidence, of: NDArray[np.int64], codes: NDArray[np.int64]) -> int:
    """Returns how many different numbers, such as seeds, each cell has in a step and world, in the mean."""
    places = key_codes([evidence.steps - evidence.steps.min(initial=0), evidence.worlds, of])
    return max(1, round(len(np.unique(key_codes([places, codes]))) / len(np.unique(places))))


def _best_fit(evidence: Evidence, group: Group, regions: Sequence[_Tried], *, are_few: bool) -> _Fit | None:
    """Returns the region that a group's failures go with most surely, in words; None: none is comparable.

    Where no interval leaves out chance, it is the one whose exact test does, corrected for the regions looked at. So it
    is with few failures: in four of five runs without a cause an interval of one of many regions leaves out chance.
    """
    fits = [
        _Fit(*each, lift, lift.low > 1) for each in regions if (lift := lift_of(evidence, group, each.mask)) is not None
    ]
    codes, names = kind_codes(evidence)
    for place, name in enumerate(names):
        mask = codes[evidence.worlds] == place
        if (lift := lift_of_kind(evidence, group, mask)) is not None:
            fits.append(_Fit(f"worlds of {name}", mask, None, lift, lift.low > 1, "are in"))
    best = max(fits, key=lambda fit: fit.lift.low, default=None)
    if best is None or (best.leaves_out_chance and not are_few):
        return best
    chances = [p_by_chance(evidence, group, fit.mask) for fit in fits]
    place = int(np.argmin(chances))
    if chances[place] * len(fits) <= ALPHA:
        return fits[place]._replace(leaves_out_chance=True)
    return next((fit for fit in fits if _is_shared(group, fit)), best)._replace(leaves_out_chance=False)


def _is_suspect(group: Group, fit: _Fit) -> bool:
    """Whether a region is named although it is not shown: it alone leaves out chance, or most are left out there.

    Trials that failed otherwise are not compared, so that one side may be too small for any interval.
    """
    lift = fit.lift
    if not (lift.value >= _RELEVANT_LIFT or lift.inside - lift.outside >= _RELEVANT_RISE):
        return False
    left = [float(group.at_risk[side].mean()) for side in (fit.mask, ~fit.mask)]
    return fit.leaves_out_chance or min(left) < _MOST_LEFT_OUT


def _to_tell_any(evidence: Evidence, group: Group, found: Findings, fit: _Fit) -> Doubt:
    """Says how many trials would tell a cause of the size from which on one is looked for."""
    rate = group.count / max(1, int(group.at_risk.sum()))
    inside = min(1.0, _RELEVANT_LIFT * rate, rate + _RELEVANT_RISE)
    wanted = replace(fit.lift, inside=inside, outside=rate)
    needed = _needed(evidence, group, found, fit, wanted)
    return _takes(f"to tell a cause by which {inside:.0%} instead of {rate:.0%} fail", needed, evidence)


def _may_go_with(evidence: Evidence, group: Group, fit: _Fit) -> str:
    lift = fit.lift
    others = len(evidence) - int(group.at_risk.sum())
    besides = f", without {others} that failed otherwise" if others else ""
    may = f"it may go with {fit.words}"
    if _is_shared(group, fit):
        may = f"all {group.count} {fit.where} {fit.words}"
    return (
        f"{may} ({lift.failed_inside} of {lift.trials_inside}, elsewhere {lift.failed_outside} of "
        f"{lift.trials_outside}{besides})"
    )


def _bare_regions(evidence: Evidence, group: Group, regions: Sequence[_Tried]) -> str:
    """Says that all trials of a region failed otherwise, so that none can be compared; empty: there is no such."""
    bare = [(each.words, int(each.mask.sum())) for each in regions if not (each.mask & group.at_risk).any()]
    if not bare:
        return ""
    words, count = max(bare, key=lambda item: item[1])
    noun = _noun(evidence)
    which = f"the only {noun[:-1]}" if count == 1 else f"all {count} {noun}"
    return f"too few {noun} to tell: {which} with {words} failed otherwise, so there is nothing to compare with"


def _nothing_to_compare(evidence: Evidence, group: Group) -> str:
    """Says that all trials failed, and none of them can stand for a trial that met the group's requirement."""
    others = len(evidence) - int(group.at_risk.sum())
    besides = f" ({others} failed otherwise, perhaps before they could have failed so)" if others else ""
    return f"no {_noun(evidence)[:-1]} passed, so there is nothing to compare with{besides}"
