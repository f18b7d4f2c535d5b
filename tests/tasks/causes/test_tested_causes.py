"""P-values: Holm's correction, and permutations that are fooled by neither worlds nor cells."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from prefect_robomaker.tasks.causes.permutation_tests import Units, p_between_worlds
from prefect_robomaker.tasks.causes.tested_causes import fewest_failures, holm


@given(st.lists(st.floats(0, 1), max_size=20))
def test_holm_keeps_the_order_and_lies_between_nothing_and_bonferroni(p_values: list[float]) -> None:
    adjusted = holm(p_values)
    for p_value, found in zip(p_values, adjusted, strict=True):
        assert min(p_value, 1.0) <= found <= min(1.0, len(p_values) * p_value) + 1e-12
    order = np.argsort(p_values, kind="stable")
    assert (np.diff(np.array(adjusted)[order]) >= 0).all()


def test_holm_of_an_example_by_hand() -> None:
    assert holm([0.01, 0.04, 0.03, 0.005]) == pytest.approx([0.03, 0.06, 0.06, 0.02])


def test_more_axes_need_more_failures() -> None:
    needed = [fewest_failures(axes) for axes in range(11)]
    assert needed == sorted(needed)
    assert (needed[1], needed[3], needed[10]) == (10, 12, 15)


def test_between_worlds_an_axis_that_suits_each_by_chance_shows_nothing() -> None:
    """Effects of single worlds are strong, and of either sign."""
    chance = np.random.default_rng(4)

    def p_of(mean: float) -> float | None:
        worlds = np.repeat(np.arange(10), 60)
        weights = chance.random(600)
        slopes = chance.normal(mean, 0.8, 10)[worlds]
        parts = np.asarray(chance.random(600) < np.clip(0.5 + slopes * (weights - 0.5), 0, 1), np.float64) - 0.5
        every = np.arange(600)
        return p_between_worlds(Units(parts, worlds, every, every, every, parts), weights, worlds)

    assert np.mean([(p_of(0.0) or 0.0) <= 0.05 for _ in range(400)]) <= 0.08  # 2.7 standard errors above 5 %
    assert (p_of(1.5) or 0.0) < 0.001


def test_too_few_worlds_with_failures_are_no_sample() -> None:
    every = np.arange(40)
    worlds, weights = every % 8, every / 40
    parts = np.where((worlds < 4) & (every > 20), 1.0, 0.0)
    assert p_between_worlds(Units(parts, worlds, every, every, every, parts), weights, worlds) is None
