"""Number of trials with which the comparison of two runs of a specification answers a question."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np

from ...schemas.reports.comparison import NeededPairs, PlannedPairs
from ...schemas.wire.errors import ConfigurationError
from .better_or_worse import judged_pairs
from .compared_runs import NightRun
from .difference_test import (
    ALL_ONE_WAY,
    ASSUMED_SHARE,
    FEWEST_PAIRS,
    POWER,
    JudgedTrials,
    expected_share,
    pairs_for,
    share_in_words,
    worlds_in_words,
)
from .margins import margin_power
from .statistics.e_processes import fewest_worlds
from .statistics.early_plans import pairs_until_decided, until_not_worse, worlds_until_decided
from .statistics.mcnemar import mcnemar_power


@dataclass(frozen=True)
class Question:
    """A question about the pass rates of two runs."""

    kind: Literal["difference", "margin"]
    share: float
    """Difference to be shown, or decrease to be excluded, as a share above 0; a margin is below 1."""

    alpha: float = 0.05
    """Error probability of the test that will decide."""

    discordant: float | None = None
    """Expected share of pairs whose verdicts differ; None: it is estimated from earlier runs."""

    stops: bool = False
    """Whether the second run is carried out beside the first one (`run --against`), and stops when it is decided."""


@dataclass(frozen=True)
class PlannedTrials:
    """Number of trials of one run of a specification, and of the different worlds that they use."""

    trials: int
    worlds: int


@dataclass(frozen=True)
class EarlierPairs:
    """Pairs of trials of two earlier runs, from which the share of differing pairs is estimated."""

    judged: JudgedTrials
    runs: tuple[str, str]

    @property
    def share(self) -> float:
        """Share (0 to 1) of pairs of trials whose verdicts differ between two runs."""
        return float((self.judged.change != 0).mean())


def liveliest_pairs(runs: Sequence[NightRun], alpha: float = 0.05) -> EarlierPairs | None:
    """Finds the two consecutive runs with the largest share of pairs that differ, for a cautious plan.

    Args:
        runs: Runs of one specification, the earliest first.
        alpha: Error probability of the test.

    Returns:
        Their pairs; None: no two runs tell, as `expected_share` says.
    """
    found = [EarlierPairs(judged_pairs(old, new, alpha), (old.run_id, new.run_id)) for old, new in pairwise(runs)]
    found = [each for each in found if expected_share(each.judged, each.runs) is not None]
    return max(found, key=lambda each: each.share, default=None)


def plan_pairs(question: Question, planned: PlannedTrials | None, earlier: EarlierPairs | None) -> PlannedPairs:
    """Computes how many pairs of trials the test needs, and whether the specification has them.

    Args:
        question: Question that the test answers.
        planned: Number of trials of one run; None: it is only known after a run.
        earlier: Pairs of earlier runs; None: there are none.

    Raises:
        ConfigurationError: A run that stops when it is decided seldom shows such a difference.
    """
    share, assumed = _discordant(question, earlier)
    is_margin = question.kind == "margin"
    assumed = [share_in_words(share, words, question.share, is_margin=is_margin) for words in assumed]
    if not is_margin and question.discordant == question.share:
        assumed = [f"{100 * share:.3g}% of pairs differ; {ALL_ONE_WAY}"]
    by_worlds = planned is not None and planned.trials > planned.worlds >= fewest_worlds(question.alpha)
    spread = None
    if planned is not None and by_worlds:
        each = planned.trials / planned.worlds
        if question.discordant is None and earlier is not None and earlier.judged.flips_worlds:
            sums, sizes = earlier.judged.by_world(earlier.judged.change)
            spread = (sums / sizes * each, np.full(len(sums), each))
            assumed.append(worlds_in_words(earlier.runs))
        else:
            worlds = max(planned.worlds, fewest_worlds(question.alpha))
            spread = (np.zeros(worlds), np.full(worlds, each))
            assumed.append("trials of one world are no more alike than others; where they are, it takes more worlds")
        assumed.append(f"{each:.3g} {'trial' if each == 1 else 'trials'} in each world, as now")
    pairs, worlds_needed = pairs_for(question.share, share, question.alpha, spread, is_margin=is_margin)
    median = None
    if question.stops:
        pairs, worlds_needed, median, words = _until_decided(question, share, pairs, planned if by_worlds else None)
        assumed += words
    needed = NeededPairs(
        difference=question.share,
        basis="margin" if is_margin else "asked for",
        discordant=share if is_margin else max(share, question.share),
        power=POWER,
        pairs=pairs,
        more=max(0, pairs - planned.trials) if planned else pairs,
        worlds=worlds_needed,
        assumed=assumed,
    )
    tests = ("Tango's score", "interval between worlds") if is_margin else ("exact McNemar", "sign flip of worlds")
    return PlannedPairs(
        **needed.model_dump(),
        test="e-process" if question.stops else tests[by_worlds],
        median=median,
        planned=planned.trials if planned else None,
        smallest=_smallest(planned.trials, question, share)
        if planned and not by_worlds and not question.stops
        else None,
    )


def _until_decided(
    question: Question, share: float, fixed: int, of_worlds: PlannedTrials | None
) -> tuple[int, int | None, int | None, list[str]]:
    """Plans a run that is compared while it runs and stops as soon as the answer is decided.

    Args:
        question: The question, with the difference to be shown, or the fall to be ruled out.
        share: Share of pairs whose verdicts differ.
        fixed: Pairs that a test after the run's end needs, for the error's advice.
        of_worlds: Trials and worlds of one run, if whole worlds decide; None: single pairs do.

    Returns:
        Pairs by which it is decided with the chance `POWER`, the same in worlds (None: single pairs decide), pairs by
        which half of such runs are decided, and the assumptions as text.

    Raises:
        ConfigurationError: Such a run seldom or never shows so small a share among so many differing pairs.
    """
    is_margin = question.kind == "margin"
    discordant = share if is_margin else max(share, question.share)
    each = None if of_worlds is None else of_worlds.trials / of_worlds.worlds
    if is_margin:
        found = until_not_worse(question.share, discordant, each, question.alpha, POWER)
    elif each is not None:
        found = worlds_until_decided(question.share, discordant, each, question.alpha, POWER)
    else:
        found = pairs_until_decided(question.share, discordant, question.alpha, POWER)
    if found is not None and each is None:
        return found.needed, None, found.median, []
    if found is not None and each is not None:
        words = ["trials of one world are no more alike than others; where they are, it takes more worlds"]
        return round(found.needed * each), found.needed, round(found.median * each), words
    points, percent = 100 * question.share, 100 * discordant
    shown = f"that nothing got worse by {points:.3g} points" if is_margin else f"a difference of {points:.3g} points"
    raise ConfigurationError(
        f"a run that stops when it is decided seldom shows {shown} where {percent:.3g}% of pairs differ, however long "
        f"it is; leave --against out, and compare runs of {fixed} trials that have ended"
    )


def _discordant(question: Question, earlier: EarlierPairs | None) -> tuple[float, list[str]]:
    """Returns the share (0 to 1) of pairs whose verdicts differ, and in words what it is assumed from.

    The share of the question is taken first, then that of earlier runs, else an assumed one. There are no words for a
    share that the question states.
    """
    if question.discordant is not None:
        return question.discordant, []
    known = earlier and expected_share(earlier.judged, earlier.runs)
    if known is None:
        why = f"no two earlier runs with {FEWEST_PAIRS} pairs in common differed; --differ says another share"
        return ASSUMED_SHARE, [f"{ASSUMED_SHARE:.0%} of pairs differ: {why}"]
    return known[0], [known[1]]


def _smallest(pairs: int, question: Question, discordant: float) -> float | None:
    """Returns the smallest difference or margin, in steps of a tenth of a percentage point, that the pairs can show.

    Returns None if they can show none.
    """

    def power(share: float) -> float:
        if question.kind == "margin":
            return margin_power(pairs, discordant, share, question.alpha)
        return mcnemar_power(pairs, max(discordant, share), share, question.alpha)

    return _first_tenth(lambda share: power(share) >= POWER)


def _first_tenth(holds: Callable[[float], bool]) -> float | None:
    low, high = 0, 1000
    if not holds((high - 1) / 1000):
        return None
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if holds(middle / 1000) else (middle, high)
    return high / 1000
