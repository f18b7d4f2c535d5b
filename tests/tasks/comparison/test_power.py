"""How many pairs and worlds a test needs, by its exact power and by simulation."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from prefect_robomaker.tasks.comparison.statistics import (
    mcnemar_p_value,
    mcnemar_pairs_needed,
    mcnemar_power,
    sign_flip_p_value,
    worlds_needed,
)


@pytest.mark.parametrize(
    ("worse", "better", "pairs"),
    # Connor's formula asks for 155, 77, 108 and 45, which have powers of 0.76 to 0.78.
    [(0.05, 0.15, 168), (0.1, 0.3, 84), (0.02, 0.12, 114), (0.02, 0.22, 47)],
)
def test_needed_pairs_are_those_of_the_exact_test(worse: float, better: float, pairs: int) -> None:
    assert mcnemar_pairs_needed(worse + better, better - worse) == pairs
    assert mcnemar_pairs_needed(worse + better, worse - better) == pairs
    assert mcnemar_power(pairs, worse + better, better - worse, 0.05) >= 0.8
    assert mcnemar_power(pairs - 1, worse + better, better - worse, 0.05) < 0.8


@pytest.mark.parametrize(("worse", "better", "pairs"), [(0.05, 0.45, 25), (0.15, 0.3, 160), (0.2, 0.3, 60)])
def test_the_power_is_that_of_simulated_tests(worse: float, better: float, pairs: int) -> None:
    tables = np.random.default_rng(11).multinomial(pairs, [worse, better, 1 - worse - better], size=4000)
    shown = sum(mcnemar_p_value(int(table[0]), int(table[1])) <= 0.05 for table in tables) / len(tables)
    assert mcnemar_power(pairs, worse + better, better - worse, 0.05) == pytest.approx(shown, abs=0.025)


def test_six_pairs_are_the_fewest_that_show_anything() -> None:
    assert mcnemar_pairs_needed(1.0, 1.0) == 6
    assert mcnemar_power(5, 1.0, 1.0, 0.05) == 0


def test_a_difference_that_is_very_small_needs_very_many_pairs() -> None:
    assert 7.8e6 < mcnemar_pairs_needed(0.25, 0.0005) < 7.9e6  # (1.96 + 0.84)^2 * 0.25 / 0.0005^2


@given(st.floats(0.02, 1), st.floats(0.02, 1))
def test_a_smaller_difference_needs_more_pairs(first: float, second: float) -> None:
    small, large = sorted((first, second))
    assert mcnemar_pairs_needed(1.0, small) >= mcnemar_pairs_needed(1.0, large) - 2  # all differ: power is a saw


@pytest.mark.parametrize(("discordant", "difference"), [(0.1, 0), (0.1, 0.2), (1.2, 0.1), (0, 0)])
def test_a_difference_that_cannot_be_needs_no_pairs(discordant: float, difference: float) -> None:
    with pytest.raises(ValueError, match="cannot be"):
        mcnemar_pairs_needed(discordant, difference)


@pytest.mark.parametrize("spread", [0.05, 0.2, 0.5])
def test_needed_worlds_have_the_power_that_is_said(spread: float) -> None:
    """Worlds are drawn anew from those there are, with counts of 20 trials each, and tested by flipping them."""
    chance = np.random.default_rng(7)
    known, difference = chance.normal(0.1, spread, 30).clip(-1, 1), 0.15
    needed = worlds_needed(known, 20, difference, np.random.default_rng(1))
    drawn = (difference + chance.choice(known - known.mean(), (2000, needed))).clip(-1, 1)
    shown = np.mean([sign_flip_p_value(np.rint(20 * each).astype(int).tolist()) <= 0.05 for each in drawn])
    assert 0.75 <= shown <= (0.9 if needed > 12 else 1.0)


def test_worlds_that_do_not_differ_need_six_at_least() -> None:
    assert worlds_needed(np.zeros(8), 1000, 0.5, np.random.default_rng(1)) == 6
