"""Test that decides whether two runs differ; it allows for similar trials within a world."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from ...schemas.reports.comparison import USUAL_DIFFERENCE, MarginTest, NeededPairs, RateChange
from ...schemas.reports.live_comparison import FEWEST_WORLDS
from ...schemas.wire.common import counted
from ..results.rates import wilson_interval
from .margins import margin_p_value, margin_pairs_needed, margin_worlds_needed, shown_between_worlds
from .statistics.e_processes import fewest_worlds
from .statistics.intervals import Interval, clustered_mean, mean_difference, paired_rate_difference
from .statistics.mcnemar import mcnemar_p_value, mcnemar_pairs_needed
from .statistics.sign_flips import sign_flip_p_value, worlds_needed

POWER = 0.8
"""Probability with which the computed number of pairs would show the difference (power of the test)."""

ASSUMED_SHARE = 0.2
"""Assumed share of pairs that differ, where two runs do not tell: a fifth is much for a robot that mostly repeats its
results.
"""
FEWEST_PAIRS = 20
"""Minimum number of pairs of two runs from which the share is estimated: with 20, a share of 10 % is known as 3 to
30 %.
"""
ALL_ONE_WAY = "all of them go the same way"
"""Meaning of a difference as large as the share of pairs that differ."""
_SEED = 20  # of simulated comparisons: the same runs get the same answer


@dataclass(frozen=True)
class JudgedTrials:
    """Pairs of trials that were judged in both of two compared runs, as arrays with one entry for each pair."""

    before: NDArray[np.bool_]
    """Mask of the trials that passed in the first run."""
    after: NDArray[np.bool_]
    """Mask of the trials that passed in the second run."""
    worlds: NDArray[np.int64]
    """Number of each pair's world."""
    fewest_worlds: int = FEWEST_WORLDS
    """Number of worlds from which the test flips the signs of whole worlds."""

    def __len__(self) -> int:
        return len(self.before)

    @property
    def change(self) -> NDArray[np.int64]:
        """Change of each pair: 1 where the trial passes now, -1 where it fails now, else 0."""
        return self.after.astype(np.int64) - self.before.astype(np.int64)

    @property
    def world_count(self) -> int:
        """Number of different worlds in the pairs."""
        return len(np.unique(self.worlds))

    @property
    def has_repeated_worlds(self) -> bool:
        """Whether some world has several trials."""
        return self.world_count < len(self)

    @property
    def changed_worlds(self) -> int:
        """Number of worlds in which the pass rate changed."""
        return int(np.count_nonzero(self.by_world(self.change)[0]))

    @property
    def flips_worlds(self) -> bool:
        """Whether the sign-flip test over whole worlds decides the comparison, and not the exact McNemar test."""
        return self.has_repeated_worlds and self.world_count >= self.fewest_worlds

    @property
    def is_of_few_worlds(self) -> bool:
        """Whether the comparison holds only for the tested worlds, because they are too few to generalise."""
        return self.has_repeated_worlds and self.world_count < self.fewest_worlds

    def by_world(self, values: NDArray[Any]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Returns the sum of a value over each world's pairs, and the number of pairs in each world."""
        _, numbers = np.unique(self.worlds, return_inverse=True)
        sums = np.bincount(numbers, weights=values.astype(np.float64))
        return sums.astype(np.float64), np.bincount(numbers).astype(np.float64)


def rate_change(trials: JudgedTrials, alpha: float, margin: float | None = None) -> RateChange:
    """Computes both pass rates, their difference with its confidence interval, and the p-value.

    Args:
        trials: Judged pairs, at least one.
        alpha: 1 minus the confidence level of the interval.
        margin: Relevant decrease of the pass rate, a share; None: no margin is tested.
    """
    counts = [int((trials.before == old)[trials.after == new].sum()) for old in (True, False) for new in (True, False)]
    both, worse, better, neither = counts
    if trials.flips_worlds:
        sums, sizes = trials.by_world(trials.change)
        found, test = clustered_mean(sums, sizes, alpha), "sign flip of worlds"
        p_value = sign_flip_p_value([round(each) for each in sums])
    else:
        found, test = paired_rate_difference(both, worse, better, neither, alpha), "exact McNemar"
        p_value = mcnemar_p_value(worse, better)
    between_worlds = found if trials.flips_worlds else None
    return RateChange(
        pairs=len(trials),
        worlds=trials.world_count,
        before=(both + worse) / len(trials),
        after=(both + better) / len(trials),
        difference=found.value,
        low=max(found.low, -1.0),
        high=min(found.high, 1.0),
        test=test,
        p_value=p_value,
        margin=None if margin is None else _margin_test(trials, worse, better, margin, alpha, between_worlds),
    )


def _margin_test(
    trials: JudgedTrials, worse: int, better: int, margin: float, alpha: float, between_worlds: Interval | None
) -> MarginTest:
    """Tests whether a fall by the margin is excluded; an interval between worlds decides where one is given."""
    if between_worlds is not None:
        worlds = trials.world_count
        error = (between_worlds.value - between_worlds.low) / float(stdtrit(worlds - 1, 1 - alpha / 2))
        is_shown = shown_between_worlds(np.array(between_worlds.value), np.array(error), worlds, margin, alpha)
        outcome = "shown" if is_shown else "not shown"
        return MarginTest(margin=margin, outcome=outcome, test="interval between worlds")
    pairs = len(trials)
    p_value = margin_p_value(pairs, worse, better, margin)
    return MarginTest(
        margin=margin, outcome="shown" if p_value <= alpha / 2 else "not shown", test="Tango's score", p_value=p_value
    )


def expected_share(trials: JudgedTrials, runs: tuple[str, str]) -> tuple[float, str] | None:
    """Returns the share (0 to 1) of pairs whose verdicts differ, as two runs tell it, and a text that says so.

    Plans and comparisons take the share from here, so that both need the same number of pairs.

    Args:
        trials: Judged pairs of the two runs.
        runs: Ids of both runs.

    Returns:
        `None` if they do not tell: they have fewer than 20 pairs, or none of them differ.
    """
    differ = int((trials.change != 0).sum())
    share = differ / max(len(trials), 1)
    if not share or len(trials) < FEWEST_PAIRS:
        return None
    low, high = wilson_interval(differ, len(trials))
    between = f"{runs[0]} and {runs[1]}, {counted(len(trials), 'pair')}"
    return share, f"{share:.1%} of pairs differ, as between {between} (95% interval {low:.1%} to {high:.1%})"


def needed_pairs(
    trials: JudgedTrials, runs: tuple[str, str], alpha: float, asked: float | None, margin: float | None = None
) -> NeededPairs:
    """Computes how many pairs of trials would be needed to answer a question about pass rates.

    Args:
        trials: Judged pairs, at least one.
        runs: Ids of the two runs.
        alpha: Error probability of the test that decides.
        asked: Requested difference above 0; None: none was requested.
        margin: Decrease of the pass rate to be excluded if nothing changed; None: the question is whether there is a
            difference.
    """
    change, pairs = trials.change, len(trials)
    found = abs(int(change.sum())) / pairs
    known = expected_share(trials, runs)
    few = f"{ASSUMED_SHARE:.0%} of pairs differ: these runs have fewer than {FEWEST_PAIRS} pairs, or none that differ"
    differ, assumed = known or (ASSUMED_SHARE, few)
    difference = margin or asked or found or USUAL_DIFFERENCE
    by_worlds = trials.by_world(change * (1 if change.sum() >= 0 else -1)) if trials.flips_worlds else None
    needed, worlds = pairs_for(difference, differ, alpha, by_worlds, is_margin=margin is not None)
    return NeededPairs(
        difference=difference,
        basis="margin" if margin else "asked for" if asked else "as found" if found else "10 points",
        discordant=differ if margin else max(differ, difference),
        power=POWER,
        pairs=needed,
        more=max(0, needed - pairs),
        worlds=worlds,
        assumed=[
            share_in_words(differ, assumed, difference, is_margin=margin is not None),
            *([worlds_in_words(runs)] if by_worlds is not None and by_worlds[0].any() else []),
        ],
    )


def share_in_words(share: float, words: str, difference: float, *, is_margin: bool) -> str:
    """Returns the assumed share of pairs that differ in words; a difference takes at least as many pairs that differ.

    Args:
        share: The share that is known or assumed, from 0 to 1.
        words: Text that says where it comes from.
        difference: Difference to be shown, or margin.
        is_margin: Whether it is a margin.
    """
    if is_margin or share > difference:
        return words
    if share == difference:
        return f"{words}; {ALL_ONE_WAY}"
    points = f"{100 * difference:.3g} points"
    return f"{difference:.1%} of pairs differ, the fewest with which pass rates differ by {points}; {ALL_ONE_WAY}"


def worlds_in_words(runs: tuple[str, str]) -> str:
    """Says which worlds a number of worlds is computed from."""
    return f"worlds differ as much as in {' and '.join(runs)}"


def pairs_for(
    difference: float,
    discordant: float,
    alpha: float,
    by_world: tuple[NDArray[np.float64], NDArray[np.float64]] | None,
    *,
    is_margin: bool,
) -> tuple[int, int | None]:
    """Computes how many pairs the deciding test needs, and how many worlds.

    Args:
        difference: Difference to be shown, or margin to be excluded; a share above 0.
        discordant: Share of pairs that differ.
        alpha: Error probability of the test.
        by_world: Sum of the changes in each world and its number of pairs, if whole worlds decide; else None.
        is_margin: Whether `difference` is a margin.

    Returns:
        Pairs, and worlds where these decide.
    """
    if by_world is None:
        if is_margin:
            return margin_pairs_needed(discordant, difference, alpha, POWER), None
        return mcnemar_pairs_needed(max(discordant, difference), difference, alpha, POWER), None
    sums, sizes = by_world
    chance, each = np.random.default_rng(_SEED), float(sizes.mean())
    count = margin_worlds_needed if is_margin else worlds_needed
    worlds = count(sums / sizes, each, difference, chance, discordant=discordant, alpha=alpha, power=POWER)
    worlds = max(worlds, fewest_worlds(alpha))
    return max(worlds, round(worlds * each)), worlds


def mean_change(trials: JudgedTrials, differences: NDArray[np.float64], alpha: float) -> Interval:
    """Computes the mean of paired differences with a confidence interval, by worlds where that test decides.

    Args:
        trials: Judged pairs, at least two.
        differences: Difference of each pair.
        alpha: 1 minus the confidence level.
    """
    if trials.flips_worlds and differences.min() != differences.max():
        return clustered_mean(*trials.by_world(differences), alpha)
    return mean_difference(differences.tolist(), alpha)
