"""Margins that shrink: how often scatter alone is told, how soon a trend is, and which nights count."""

import numpy as np
import pytest
from helpers.night_records import make_job, make_night
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from prefect_robomaker.tasks.comparison.compared_runs import NightRun
from prefect_robomaker.tasks.comparison.history import since_last_run
from prefect_robomaker.tasks.comparison.trends import HORIZON, WINDOWS, margin_trends, shrinking


def told_at(margins: NDArray[np.float64], requirements: int = 1) -> NDArray[np.bool_]:
    """Whether each series is told of at each of its nights, as it was seen then."""
    nights = range(1, margins.shape[-1] + 1)
    return np.stack([shrinking(margins[:, :night], requirements).told for night in nights], axis=-1)


@pytest.mark.parametrize("margin", [3.0, 6.0, 12.0])
@pytest.mark.parametrize("scatter", ["normal", "heavy tails", "smallest of many"])
def test_margins_that_only_scatter_are_seldom_told(scatter: str, margin: float) -> None:
    """At most 5 % of 20 nights, as one requirement or as ten that share the level."""
    chance = np.random.default_rng(5)
    size = (10, 2000, 20)
    noise = {
        "normal": chance.normal(size=size),
        "heavy tails": chance.standard_t(4, size=size),
        "smallest of many": -np.log(chance.exponential(size=size)),
    }[scatter]
    alone = told_at(margin + noise[0]).any(axis=-1).mean()
    assert alone <= 0.05 + 3 * np.sqrt(0.05 * 0.95 / 2000)
    one_of_ten = np.any([told_at(margin + each, 10).any(axis=-1) for each in noise[:, :300]], axis=0).mean()
    assert one_of_ten <= 0.05 + 3 * np.sqrt(0.05 * 0.95 / 300)


@pytest.mark.parametrize(
    ("slope", "margin"),
    # In standard deviations of the scatter, a night and at the beginning; the shrinking starts after ten nights.
    [(0.3, 8.0), (0.5, 8.0), (1.0, 10.0), (0.5, 12.0)],
)
def test_a_margin_that_shrinks_is_told_before_it_is_missed(slope: float, margin: float) -> None:
    chance = np.random.default_rng(6)
    margins = margin + chance.normal(size=(1000, 45))
    margins[:, 10:] -= slope * np.arange(1, 36)
    told = told_at(margins)
    missed = np.where((margins < 0).any(axis=-1), (margins < 0).argmax(axis=-1), 45)
    first = np.where(told[:, 10:].any(axis=-1), told[:, 10:].argmax(axis=-1) + 10, 99)
    assert (first < missed).mean() >= 0.8


def test_a_straight_line_is_certain_and_its_end_is_right() -> None:
    line = shrinking(np.array([6.0, 5.0, 4.0, 3.0, 2.0]))
    assert (bool(line.told), float(line.slope), float(line.left)) == (True, -1.0, 2.0)


@given(st.lists(st.floats(-100, 100), min_size=1, max_size=20))
def test_what_is_told_is_met_and_shrinks_to_zero_soon(margins: list[float]) -> None:
    line = shrinking(np.array(margins))
    if line.told:
        assert margins[-1] >= 0
        assert line.slope < 0
        assert 0 <= line.left <= HORIZON
        assert len(margins) >= WINDOWS[0]


@given(st.floats(0.001, 1000), st.integers(1, 30))
def test_a_constant_margin_is_never_told(margin: float, nights: int) -> None:
    assert not shrinking(np.full(nights, margin)).told


def nights_with(*limits: float, jobs: int = 2) -> list[NightRun]:
    """Runs whose jobs are pushed by 9 N where so much is allowed: the margin of `gentle` is the rest."""
    return [
        NightRun.of(make_night([make_job(index, "P", night=night, limit=limit) for index in range(jobs)], night))
        for night, limit in enumerate(limits)
    ]


def test_a_run_says_that_a_margin_shrinks() -> None:
    runs = nights_with(21, 18.1, 15, 12, 9.9)
    [trend] = margin_trends(runs)
    assert (trend.name, trend.unit, trend.margins) == ("gentle", "N", pytest.approx([12, 9.1, 6, 3, 0.9]))
    assert trend.nights_left == pytest.approx(0.3, abs=0.2)
    assert since_last_run(runs).shrinking == [trend]


def test_nights_of_more_trials_do_not_count() -> None:
    """The smallest of more margins is smaller, which is no trend."""
    alike = nights_with(21, 18, 15, 12, 10)
    assert margin_trends(alike)
    assert margin_trends([*nights_with(21, 18, jobs=1), *alike[2:]]) == []
