"""Runs that stop when they are decided: how often they are wrong, and after how many pairs they stop.

Trials of one world are alike in two ways: a world is easy or hard for both runs, and by chance it may suit one of them.
"""

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from prefect_robomaker.tasks.comparison.statistics.e_processes import margin_wealth, mixed, sign_wealth, threshold
from prefect_robomaker.tasks.comparison.statistics.mcnemar import mcnemar_pairs_needed

RUNS, AT_ONCE = 20_000, 1_000
ALPHA = 0.05
MOST_WRONG = ALPHA + 2 * (ALPHA * (1 - ALPHA) / RUNS) ** 0.5

Draw = Callable[[np.random.Generator], NDArray[np.float64]]

pytestmark = pytest.mark.endurance


def pairs(worse: float, better: float, count: int) -> Draw:
    """Changes of single pairs."""

    def draw(chance: np.random.Generator) -> NDArray[np.float64]:
        drawn = chance.random((AT_ONCE, count))
        return np.where(drawn < worse, -1.0, np.where(drawn < worse + better, 1.0, 0.0))

    return draw


def worlds(count: int, trials: int, suits: float, fall: float = 0.0) -> Draw:
    """Mean changes of worlds, each of which suits either run by chance; `fall` worlds of all break wholly."""

    def draw(chance: np.random.Generator) -> NDArray[np.float64]:
        hard = chance.beta(2.0, 1.0, (AT_ONCE, count))
        rates = np.clip(hard + chance.normal(0.0, suits, (2, AT_ONCE, count)), 0, 1)
        if fall:
            rates = np.stack([np.ones((AT_ONCE, count)), (chance.random((AT_ONCE, count)) >= fall).astype(float)])
        passed = chance.binomial(trials, rates)
        return (passed[1] - passed[0]) / trials

    return draw


def reached(evidence: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Whether each run is ever decided."""
    return np.any(evidence >= threshold(ALPHA), axis=1)


def share(draw: Draw, wrong: Callable[[NDArray[np.float64]], NDArray[np.bool_]]) -> float:
    chance = np.random.default_rng(7)
    return float(np.mean([wrong(draw(chance)).mean() for _ in range(RUNS // AT_ONCE)]))


@pytest.mark.parametrize(
    "draw",
    [
        pairs(0.02, 0.02, 200),
        pairs(0.1, 0.1, 200),
        pairs(0.5, 0.5, 200),
        worlds(8, 20, 0.2),
        worlds(20, 5, 0.2),
        worlds(60, 40, 0.4),
    ],
    ids=["2 % each", "10 % each", "50 % each", "8 worlds of 20", "20 worlds of 5", "60 worlds of 40"],
)
def test_runs_without_a_difference_are_seldom_different(draw: Draw, request: pytest.FixtureRequest) -> None:
    def wrong(changes: NDArray[np.float64]) -> NDArray[np.bool_]:
        return reached(mixed(sign_wealth(changes))) | reached(mixed(sign_wealth(-changes)))

    found = share(draw, wrong)
    print(f"{request.node.callspec.id}: {100 * found:.2f} % say different")
    assert found <= MOST_WRONG


@pytest.mark.parametrize(
    ("draw", "margin"),
    [
        (pairs(0.05, 0.0, 200), 0.05),
        (pairs(0.15, 0.05, 200), 0.1),
        (worlds(60, 10, 0.0, fall=0.1), 0.1),
        (pairs(0.4, 0.2, 200), 0.2),
    ],
    ids=["5 points, 5 %", "10 points, 20 %", "10 points, a tenth of the worlds breaks", "20 points, 60 %"],
)
def test_a_fall_by_the_margin_is_seldom_called_not_worse(
    draw: Draw, margin: float, request: pytest.FixtureRequest
) -> None:
    def wrong(changes: NDArray[np.float64]) -> NDArray[np.bool_]:
        return reached(mixed(margin_wealth(changes, margin))) | reached(mixed(sign_wealth(changes)))

    found = share(draw, wrong)
    print(f"{request.node.callspec.id}: {100 * found:.2f} % say not worse or better")
    assert found <= MOST_WRONG


@pytest.mark.parametrize(("worse", "better"), [(0.05, 0.15), (0.10, 0.30), (0.02, 0.12), (0.02, 0.22)])
def test_the_median_stop_is_at_most_nine_tenths_of_the_fixed_number(worse: float, better: float) -> None:
    fixed = mcnemar_pairs_needed(worse + better, better - worse, ALPHA, 0.8)
    chance, stops = np.random.default_rng(7), list[NDArray[np.int64]]()
    for _ in range(RUNS // AT_ONCE):
        enough = mixed(sign_wealth(pairs(worse, better, 4 * fixed)(chance))) >= threshold(ALPHA)
        stops.append(np.where(enough.any(axis=1), enough.argmax(axis=1) + 1, 10**6))
    every = np.concatenate(stops)
    median = float(np.median(every))
    decided = float((every <= fixed).mean())
    print(f"{worse}, {better}: median {median:.0f} of {fixed}, {100 * decided:.0f} % decided by then")
    assert median <= 0.9 * fixed
