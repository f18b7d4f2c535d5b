"""The exact McNemar test against published numbers, scipy and simulation; how many pairs it needs."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from prefect_robomaker.tasks.comparison.statistics.mcnemar import mcnemar_p_value, mcnemar_pairs_needed, mcnemar_power

COUNTS = st.integers(0, 60)


@pytest.mark.parametrize(
    ("worse", "better", "p_value"),
    [
        # Fagerland, Lydersen, Laake, "The McNemar test for binary matched-pairs data", BMC Medical Research
        # Methodology 13:91 (2013): airway hyper-responsiveness (Bentur et al. 2009), 1 and 7 of 21 pairs.
        (1, 7, 0.0703),
        # Altman et al., Statistics with Confidence (2000), table 6.2: 5 and 0 of 41 pairs; 2 / 2^5.
        (5, 0, 0.0625),
        # Two-sided tables of the sign test (Dixon and Mood 1946; Conover): for 12 differences 2 is the most that is
        # significant at 5 %, for 20 it is 5, for 25 it is 7.
        (2, 10, 0.0386),
        (3, 9, 0.1460),
        (5, 15, 0.0414),
        (6, 14, 0.1153),
        (7, 18, 0.0433),
    ],
)
def test_the_exact_mcnemar_test_gives_published_values(worse: int, better: int, p_value: float) -> None:
    assert mcnemar_p_value(worse, better) == pytest.approx(p_value, abs=5e-5)


@given(COUNTS, COUNTS)
def test_the_exact_mcnemar_test_is_scipys_binomial_test(worse: int, better: int) -> None:
    from scipy import stats  # takes each worker a second

    expected = stats.binomtest(worse, worse + better).pvalue if worse + better else 1.0
    assert mcnemar_p_value(worse, better) == pytest.approx(expected, abs=1e-12)
    assert mcnemar_p_value(worse, better) == mcnemar_p_value(better, worse)


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
