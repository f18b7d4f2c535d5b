"""Evidence that may be looked at after every pair: its mean never grows where nothing is to be shown."""

from itertools import product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from prefect_robomaker.tasks.comparison.statistics.e_processes import (
    best_margin,
    best_sign,
    fewest_pairs,
    fewest_worlds,
    margin_wealth,
    mixed,
    sign_wealth,
    threshold,
)

sizes = st.lists(st.integers(0, 20), min_size=1, max_size=9)


@given(sizes)
def test_flipped_signs_have_evidence_of_one_in_the_mean_at_each_step(found: list[int]) -> None:
    """All signs of the changes are tried, so this is no estimate."""
    signs = np.array(list(product((-1, 1), repeat=len(found))))
    evidence = np.exp(mixed(sign_wealth(signs * np.array(found, dtype=np.float64))))
    assert evidence.mean(axis=0) == pytest.approx(np.ones(len(found)))
    assert (evidence > 0).all()


@given(st.floats(0, 0.5), st.integers(1, 9))
def test_pairs_that_seldom_get_better_give_no_evidence_in_the_mean(gains: float, pairs: int) -> None:
    signs = np.array(list(product((-1.0, 1.0), repeat=pairs)))
    chance = np.where(signs > 0, gains, 1 - gains).prod(axis=1)
    assert (chance @ np.exp(mixed(sign_wealth(signs))) <= 1 + 1e-9).all()


@given(
    st.floats(0.01, 0.9),
    st.lists(st.floats(-1, 1), min_size=1, max_size=4),
    st.lists(st.integers(1, 5), min_size=4, max_size=4),
    st.integers(1, 5),
)
def test_a_fall_by_the_margin_gives_no_evidence_against_it(
    margin: float, values: list[float], weights: list[int], steps: int
) -> None:
    """Steps are drawn from any numbers whose mean is at most minus the margin; all ways to draw them are tried."""
    changes = np.array([*values, -1.0])
    shares = np.array([*weights[: len(values)], 1.0])
    shares /= shares.sum()
    mean = float(changes @ shares)
    if mean > -margin:  # more of -1, until the mean is the margin: the worst case that the hypothesis has
        more = (mean + margin) / (1 + mean)
        shares = shares * (1 - more)
        shares[-1] += more
    drawn = np.array(list(product(range(len(changes)), repeat=steps)))
    evidence = np.exp(mixed(margin_wealth(changes[drawn], margin)))
    assert (shares[drawn].prod(axis=1) @ evidence <= 1 + 1e-9).all()
    assert (evidence > 0).all()


@given(sizes)
def test_the_scale_of_changes_does_not_matter_and_opposite_ones_are_evidence_for_the_opposite(found: list[int]) -> None:
    nets = np.array(found, dtype=np.float64)
    assert sign_wealth(7 * nets) == pytest.approx(sign_wealth(nets))
    assert (mixed(sign_wealth(nets)) >= mixed(sign_wealth(-nets)) - 1e-12).all()


def test_pairs_that_are_not_judged_are_no_evidence() -> None:
    assert mixed(margin_wealth(np.array([np.nan, np.nan]), 0.1)).tolist() == [0, 0]
    assert mixed(margin_wealth(np.array([0.0]), 0.1))[0] > 0
    assert mixed(sign_wealth(np.zeros(3))).tolist() == [0, 0, 0]


@given(st.lists(st.sampled_from([-1.0, 0.0, 1.0]), max_size=12), st.integers(0, 6))
def test_what_is_left_cannot_give_more_evidence_than_is_said(begin: list[float], left: int) -> None:
    for rest in ([1.0] * left, [1.0, 0.0] * (left // 2), [-1.0] * left):
        nets = np.array([0.0, *begin, *rest])
        wealth = sign_wealth(nets)
        begun = wealth[len(begin)]
        assert mixed(wealth)[-1] <= best_sign(begun, left, are_worlds=False) + 1e-9
        assert best_sign(begun, left, are_worlds=False) <= best_sign(begun, left, are_worlds=True) + 1e-9
        margins = margin_wealth(nets, 0.2)
        assert mixed(margins)[-1] <= best_margin(margins[len(begin)], left, 0, 0.2) + 1e-9


def test_eight_pairs_that_all_got_better_are_enough_at_five_percent() -> None:
    evidence = mixed(sign_wealth(np.ones(9)))
    assert int(np.argmax(evidence >= threshold(0.05))) + 1 == 8
    assert (fewest_worlds(0.05), fewest_worlds(0.01)) == (6, 8)


@pytest.mark.parametrize(("alpha", "pairs"), [(0.05, 8), (0.01, 10)])
def test_the_fewest_pairs_just_decide(alpha: float, pairs: int) -> None:
    assert fewest_pairs(alpha) == pairs
    assert mixed(sign_wealth(np.ones(pairs)))[-1] >= threshold(alpha) > mixed(sign_wealth(np.ones(pairs - 1)))[-1]
