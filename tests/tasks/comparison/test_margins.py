"""The test of a margin: the published example, its level and its power, summed exactly and by simulation."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.special import ndtri

from prefect_robomaker.tasks.comparison.difference_test import JudgedTrials, needed_pairs, rate_change
from prefect_robomaker.tasks.comparison.margins import (
    margin_p_value,
    margin_pairs_needed,
    margin_power,
    margin_worlds_needed,
    score,
    shown_between_worlds,
)

NEEDED = -float(ndtri(0.025))


def test_the_score_is_that_of_the_paper() -> None:
    """Tango 1998, table I: of 44 pairs one got worse; 10 points are excluded with z = 1.709, p = 0.044."""
    assert score(44, np.array(1.0), np.array(0.0), 0.1) == pytest.approx(1.709, abs=5e-4)
    assert margin_p_value(44, 1, 0, 0.1) == pytest.approx(0.044, abs=5e-4)


@pytest.mark.parametrize(("discordant", "margin"), [(0.2, 0.05), (0.2, 0.1), (0.02, 0.05), (0.0, 0.05)])
def test_one_pair_fewer_than_needed_has_too_little_power(discordant: float, margin: float) -> None:
    needed = margin_pairs_needed(discordant, margin)
    assert margin_power(needed, discordant, margin, 0.05) >= 0.8 > margin_power(needed - 1, discordant, margin, 0.05)


@pytest.mark.parametrize(("pairs", "discordant", "margin"), [(60, 0.1, 0.1), (200, 0.3, 0.1), (500, 0.05, 0.03)])
def test_the_power_is_that_of_simulated_tests(pairs: int, discordant: float, margin: float) -> None:
    half = discordant / 2
    tables = np.random.default_rng(5).multinomial(pairs, [half, half, 1 - discordant], size=4000).astype(float)
    shown = float((score(pairs, tables[:, 0], tables[:, 1], margin) >= NEEDED).mean())
    assert margin_power(pairs, discordant, margin, 0.05) == pytest.approx(shown, abs=0.03)


@pytest.mark.parametrize("pairs", [40, 150])
@pytest.mark.parametrize("margin", [0.05, 0.2])
def test_a_fall_by_the_margin_is_seldom_missed(pairs: int, margin: float) -> None:
    """The level, at the share of pairs that differ where it is largest of 20: 2.5 % is asked for."""
    chance = np.random.default_rng(8)
    levels = []
    for worse in np.linspace(margin, (1 + margin) / 2, 20):
        tables = chance.multinomial(
            pairs, [worse, worse - margin, max(0.0, 1 - 2 * worse + margin)], size=20_000
        ).astype(float)
        levels.append(float((score(pairs, tables[:, 0], tables[:, 1], margin) >= NEEDED).mean()))
    assert max(levels) <= 0.029 + 3 * np.sqrt(0.029 * 0.971 / 20_000)


@given(st.integers(1, 300), st.data(), st.floats(0.01, 0.5))
def test_one_more_pair_that_got_worse_never_helps(pairs: int, data: st.DataObject, margin: float) -> None:
    worse = data.draw(st.integers(0, pairs - 1))
    better = data.draw(st.integers(0, pairs - worse - 1))
    assert margin_p_value(pairs, worse + 1, better, margin) >= margin_p_value(pairs, worse, better, margin) - 1e-9


@pytest.mark.parametrize(("margin", "worse", "better"), [(0, 1, 1), (1, 1, 1), (0.1, -1, 0), (0.1, 6, 5)])
def test_what_cannot_be_is_refused(margin: float, worse: int, better: int) -> None:
    with pytest.raises(ValueError, match="cannot be"):
        margin_p_value(10, worse, better, margin)


@pytest.mark.parametrize(
    ("worlds", "trials", "margin"), [(6, 10, 0.05), (20, 10, 0.1), (40, 5, 0.1), (100, 3, 0.1), (200, 2, 0.05)]
)
@pytest.mark.parametrize("breaks", ["trials", "worlds"])
def test_a_fall_by_the_margin_is_seldom_missed_between_worlds(
    breaks: str, worlds: int, trials: int, margin: float
) -> None:
    """Also where whole worlds break: a few that were drawn may all be whole, and then do not differ at all."""
    chance = np.random.default_rng(9)
    broken = chance.random((1500, worlds, trials if breaks == "trials" else 1)) < margin
    change = -np.broadcast_to(broken, (1500, worlds, trials)).mean(axis=2)
    error = change.std(axis=1, ddof=1) / np.sqrt(worlds)
    shown = shown_between_worlds(change.mean(axis=1), error, worlds, margin, 0.05)
    assert shown.mean() <= 0.025 + 3 * np.sqrt(0.025 * 0.975 / 1500)


def test_six_worlds_that_do_not_differ_exclude_no_fall_by_ten_points() -> None:
    worlds = np.repeat(np.arange(6), 20)
    few = JudgedTrials(np.ones(120, dtype=bool), np.ones(120, dtype=bool), worlds)
    many = JudgedTrials(np.ones(120, dtype=bool), np.ones(120, dtype=bool), np.repeat(np.arange(40), 3))
    found = [rate_change(each, 0.05, 0.1).margin for each in (few, many)]
    assert [each.outcome for each in found if each] == ["not shown", "shown"]
    assert needed_pairs(few, ("a", "b"), 0.05, None, 0.1).worlds == pytest.approx(48, abs=3)


def test_needed_worlds_have_the_power_that_is_said() -> None:
    known = np.random.default_rng(7).normal(0.0, 0.15, 30)
    needed = margin_worlds_needed(known, 20, 0.1, np.random.default_rng(1), discordant=0.2)
    drawn = np.random.default_rng(2).choice(known - known.mean(), (2000, needed))
    error = drawn.std(axis=1, ddof=1) / np.sqrt(needed)
    assert 0.76 <= shown_between_worlds(drawn.mean(axis=1), error, needed, 0.1, 0.05).mean() <= 0.9
