"""Confidence intervals of pairs, against published numbers, other programs' functions and simulation."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from prefect_robomaker.tasks.comparison.statistics.intervals import (
    clustered_mean,
    mean_difference,
    paired_rate_difference,
)

COUNTS = st.integers(0, 60)


@pytest.mark.parametrize(
    ("table", "low", "high"),
    [
        # Newcombe, Statistics in Medicine 17:2635-2650 (1998), table of examples, method 10; his difference is first
        # minus second, ours after minus before.
        ((36, 12, 2, 0), 0.0569, 0.3404),
        ((18, 12, 2, 18), 0.0562, 0.3290),
        ((53, 0, 0, 1), -0.0729, 0.0729),
    ],
)
def test_intervals_of_paired_rates_are_newcombes(table: tuple[int, ...], low: float, high: float) -> None:
    both, worse, better, neither = table
    found = paired_rate_difference(both, worse, better, neither)
    assert found.value == pytest.approx((better - worse) / sum(table))
    assert (-found.high, -found.low) == (pytest.approx(low, abs=1e-4), pytest.approx(high, abs=1e-4))


@given(COUNTS, COUNTS, COUNTS, COUNTS)
def test_intervals_of_paired_rates_are_sound(both: int, worse: int, better: int, neither: int) -> None:
    if not both + worse + better + neither:
        with pytest.raises(ValueError, match="pairs are 0, 0, 0, 0"):
            paired_rate_difference(both, worse, better, neither)
        return
    found = paired_rate_difference(both, worse, better, neither)
    mirrored = paired_rate_difference(both, better, worse, neither)
    wider = paired_rate_difference(both, worse, better, neither, alpha=0.01)
    assert -1 - 1e-9 <= found.low <= found.value <= found.high <= 1 + 1e-9
    assert (mirrored.low, mirrored.high) == (pytest.approx(-found.high), pytest.approx(-found.low))
    assert wider.low <= found.low + 1e-9
    assert wider.high >= found.high - 1e-9


def test_about_95_of_100_intervals_of_paired_rates_hold_the_truth() -> None:
    chance = np.random.default_rng(5)
    shares, pairs = [0.55, 0.2, 0.1, 0.15], 60
    tables = chance.multinomial(pairs, shares, size=2000)
    held = sum(
        found.low <= shares[2] - shares[1] <= found.high
        for found in (paired_rate_difference(*map(int, table)) for table in tables)
    )
    assert 0.935 <= held / len(tables) <= 0.97


@given(st.lists(st.floats(-1e3, 1e3), min_size=2, max_size=20))
def test_intervals_of_worlds_of_one_trial_are_students(values: list[float]) -> None:
    """One trial in each world: the spread between worlds is that between trials."""
    found, expected = clustered_mean(np.array(values), np.ones(len(values))), mean_difference(values)
    assert (found.value, found.low, found.high) == pytest.approx(
        (expected.value, expected.low, expected.high), abs=1e-6
    )


def test_intervals_of_worlds_know_that_their_trials_are_alike() -> None:
    """Ten worlds of 20 trials each; all trials of one world are the same: 10 numbers, not 200."""
    chance = np.random.default_rng(4)
    values = chance.normal(size=10)
    found = clustered_mean(values * 20, np.full(10, 20.0))
    expected = mean_difference(values.tolist())
    assert (found.low, found.high) == (pytest.approx(expected.low), pytest.approx(expected.high))


# Student, "The probable error of a mean", Biometrika 6 (1908): hours of sleep gained by two drugs, of ten patients.
# R's documentation of `sleep` has the paired t test: interval -2.4598858 to -0.7001142.
FIRST_DRUG = [0.7, -1.6, -0.2, -1.2, -0.1, 3.4, 3.7, 0.8, 0.0, 2.0]
SECOND_DRUG = [1.9, 0.8, 1.1, 0.1, -0.1, 4.4, 5.5, 1.6, 4.6, 3.4]


def test_intervals_of_paired_means_are_students() -> None:
    found = mean_difference([first - second for first, second in zip(FIRST_DRUG, SECOND_DRUG, strict=True)])
    assert (found.value, found.low, found.high) == (
        pytest.approx(-1.58), pytest.approx(-2.4598858, abs=1e-7), pytest.approx(-0.7001142, abs=1e-7)
    )  # fmt: skip
    assert found.leaves_out_zero


@given(st.lists(st.floats(-1e6, 1e6), min_size=2, max_size=30), st.sampled_from([0.05, 0.001]))
def test_intervals_of_paired_means_are_scipys(differences: list[float], alpha: float) -> None:
    found = mean_difference(differences, alpha)
    if len(set(differences)) == 1:
        assert found.low == found.high == differences[0]
        return
    from scipy import stats  # takes each worker a second

    expected = stats.ttest_1samp(differences, 0.0).confidence_interval(1 - alpha)
    scale = max(map(abs, differences)) or 1.0
    assert math.isclose(found.low, expected.low, rel_tol=1e-6, abs_tol=1e-6 * scale)
    assert math.isclose(found.high, expected.high, rel_tol=1e-6, abs_tol=1e-6 * scale)


def test_one_difference_has_no_interval() -> None:
    with pytest.raises(ValueError, match="takes at least 2"):
        mean_difference([1.0])
