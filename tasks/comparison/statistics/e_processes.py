"""Evidence that may be looked at after every pair: e-processes over pairs, or over worlds.

An e-process starts at 1, is never negative and does not grow in the mean where its hypothesis holds. So the chance
that it ever reaches 1 / p is at most p, however often one looks and whenever one stops (Ville 1939; Ramdas, Grünwald,
Vovk and Shafer, "Game-theoretic statistics and safe anytime-valid inference", Statistical Science 38 (2023)). Each
answer has an e-process of its own, and is given where that reaches `2 / alpha`: whatever is true, at most two of the
answers are wrong, so all errors together have the probability alpha.
"""

import math

import numpy as np
from numpy.typing import NDArray

from ....schemas.reports.live_comparison import FEWEST_WORLDS

Numbers = NDArray[np.float64]


def fewest_worlds(alpha: float) -> int:
    """Returns the smallest number of worlds, at least 6, with which a sign-flip test can reach significance alpha."""
    return max(FEWEST_WORLDS, math.ceil(1 - math.log2(alpha)))


_CHANCES = np.array([0.65, 0.75, 0.85, 0.95])
"""Shares of changes in one direction on which the evidence bets, with a fourth of the stake on each: from a weak effect
to nearly all differing pairs in one direction. Of six tested lists this one stopped earliest over the settings in
`docs/benchmarks.md`.
"""
_LOG_ODDS = np.log(_CHANCES / (1 - _CHANCES))

_STAKES = np.array([0.1, 0.25, 0.5, 0.75, 0.95])
"""Shares of the largest stake that a margin allows. The largest one itself would lose everything by one pair that got
worse; small ones gain if many pairs differ in both directions.
"""


def threshold(alpha: float) -> float:
    """Returns the logarithm of the evidence from which an answer is given."""
    return math.log(2 / alpha)


def sign_wealth(nets: Numbers) -> Numbers:
    """Computes the evidence that changes are upwards, bet by bet, against "either sign is as likely".

    That is what the sign-flip test and, with one pair a step, McNemar's test suppose. Of a change s, a bet with
    log-odds t gains the factor 2 / (1 + exp(-t s)); those of s and -s have the mean 1. The changes are measured by
    their root mean square up to and with the step itself: flipped signs leave that as it is, so the mean stays 1. With
    changes of -1, 0 and 1 a bet is the likelihood ratio of a binomial distribution, and its mean is at most 1 for each
    share of gains up to a half.

    Args:
        nets: Changes in the order in which they are looked at, along the last axis: gains minus losses of a pair or
            world; 0 where nothing changed or is known.

    Returns:
        Logarithms of the evidence after each step, with the bets along a last axis of their own.
    """
    differ = np.cumsum(nets != 0, axis=-1)
    squares = np.cumsum(np.square(nets, dtype=np.float64), axis=-1)
    scale = np.sqrt(np.where(differ > 0, squares / np.maximum(differ, 1), 1.0))
    measured = (nets / scale)[..., None] * _LOG_ODDS
    return np.cumsum(_log_factor(measured), axis=-2)


def margin_wealth(changes: Numbers, margin: float) -> Numbers:
    """Computes the evidence, bet by bet, that the pass rate did not fall by a margin or more.

    Where it falls by the margin m, each change x has a mean of at most -m, given those before, and 1 + b (x + m) has a
    mean of at most 1 for each stake b from 0; below 1 / (1 - m) it stays positive (Waudby-Smith and Ramdas, "Estimating
    means of bounded random variables by betting", Journal of the Royal Statistical Society B 86 (2024)). Each world
    counts the same, however many trials it has.

    Args:
        changes: Mean changes of pairs or worlds, from -1 to 1, in their order along the last axis; NaN: not judged.
        margin: The fall of the pass rate that would matter, above 0 and below 1.

    Returns:
        Logarithms of the evidence after each step, with the bets along a last axis of their own.
    """
    won = np.where(np.isnan(changes), 0.0, changes + margin)[..., None] * (_STAKES / (1 - margin))
    return np.cumsum(np.log1p(won), axis=-2)


def mixed(wealth: Numbers) -> Numbers:
    """Returns the logarithm of the evidence with the stake split evenly over the bets of the last axis."""
    most = wealth.max(axis=-1, keepdims=True)
    return most[..., 0] + np.log(np.mean(np.exp(wealth - most), axis=-1))


def best_sign(wealth: Numbers, changes: int, *, are_worlds: bool) -> float:
    """Returns the logarithm of the evidence that changes are upwards if all remaining ones are.

    Args:
        wealth: Present evidence of each bet.
        changes: Number of pairs or worlds that can still change upwards.
        are_worlds: Whether they are worlds, each of which can at most double the evidence.
    """
    each = math.log(2) if are_worlds else _log_factor(_LOG_ODDS)
    return float(mixed(wealth + changes * each))


def fewest_pairs(alpha: float) -> int:
    """Returns the smallest number of pairs that can decide between better and worse, if all change in one direction."""
    pairs, nothing = 1, np.zeros(len(_LOG_ODDS))
    while best_sign(nothing, pairs, are_worlds=False) < threshold(alpha):
        pairs += 1
    return pairs


def best_margin(wealth: Numbers, gains: int, others: int, margin: float) -> float:
    """Returns the logarithm of the evidence for a margin if no remaining pair or world gets worse.

    Args:
        wealth: Present evidence of each bet.
        gains: Number of pairs or worlds that can still get better.
        others: Number of other remaining pairs or worlds.
        margin: The fall of the pass rate that would matter.
    """
    stakes = _STAKES / (1 - margin)
    return float(mixed(wealth + gains * np.log1p(stakes * (1 + margin)) + others * np.log1p(stakes * margin)))


def _log_factor(measured: Numbers) -> Numbers:
    """Computes the logarithm of 2 / (1 + exp(-x)), which is 0 for x = 0."""
    return math.log(2) - np.logaddexp(0.0, -measured)
