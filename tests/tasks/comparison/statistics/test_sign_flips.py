"""The test that flips worlds against counting and normal approximation; how many worlds it needs."""

import math
from itertools import product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from prefect_robomaker.tasks.comparison.statistics.mcnemar import mcnemar_p_value
from prefect_robomaker.tasks.comparison.statistics.sign_flips import sign_flip_p_value, worlds_needed

COUNTS = st.integers(0, 60)


@given(st.lists(st.integers(-30, 30), max_size=9))
def test_the_test_that_flips_worlds_counts_all_signs(differences: list[int]) -> None:
    found = abs(sum(differences))
    sums = [abs(sum(sign * each for sign, each in zip(signs, differences, strict=True)))
            for signs in product((-1, 1), repeat=len(differences))]  # fmt: skip
    expected = sum(each >= found for each in sums) / len(sums)
    assert sign_flip_p_value(differences) == pytest.approx(expected, abs=1e-11)


@given(COUNTS, COUNTS)
def test_the_test_that_flips_worlds_of_one_trial_is_mcnemars(worse: int, better: int) -> None:
    assert sign_flip_p_value([-1] * worse + [1] * better) == pytest.approx(mcnemar_p_value(worse, better), abs=1e-11)


def test_the_test_that_flips_worlds_takes_many_large_ones() -> None:
    from scipy import stats  # takes each worker a second

    chance = np.random.default_rng(3)
    sizes = chance.integers(-100, 101, 1000)
    deviation = math.sqrt(float((sizes**2).sum()))
    normal = 2 * stats.norm.sf(abs(int(sizes.sum())) / deviation)
    assert sign_flip_p_value(sizes.tolist()) == pytest.approx(normal, abs=2e-3)
    assert sign_flip_p_value([100] * 1000) == 0


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
