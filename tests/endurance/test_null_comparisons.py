"""Comparisons of runs that do not differ say so: at most 5.3 of 100 answer otherwise at an alpha of 5 %.

Trials of one world are alike in two ways: a world is easy or hard for both runs, and by chance it may suit one of them.
"""

import numpy as np
import pytest
from numpy.typing import NDArray

from prefect_robomaker.schemas.reports.live_comparison import FEWEST_WORLDS
from prefect_robomaker.tasks.comparison.difference_test import JudgedTrials, rate_change

COMPARISONS = 20_000
MOST_DIFFERENT = 0.053  # two standard errors above 5 %: sqrt(0.05 * 0.95 / 20,000) = 0.15 %

pytestmark = pytest.mark.endurance


def _null_trials(chance: np.random.Generator, worlds: int, most_trials: int) -> JudgedTrials:
    """Two runs without a difference: a world suits either by chance, where there are enough worlds to tell that."""
    trials = chance.integers(1, most_trials + 1, worlds) if most_trials > 1 else np.ones(worlds, int)
    trials[0] = most_trials
    hard = chance.beta(2.0, 1.0, worlds)
    suits = (
        chance.normal(0.0, 0.2, (2, worlds)) if worlds >= FEWEST_WORLDS and most_trials > 1 else np.zeros((2, worlds))
    )
    rates = np.clip(hard + suits, 0, 1)
    numbers = np.repeat(np.arange(worlds), trials)

    def passed(run: int) -> NDArray[np.bool_]:
        return chance.random(len(numbers)) < rates[run][numbers]

    return JudgedTrials(passed(0), passed(1), numbers)


@pytest.mark.parametrize(
    ("worlds", "most_trials"), [(1, 40), (3, 20), (5, 8), (6, 10), (8, 20), (20, 5), (50, 20), (40, 1), (200, 1)]
)
def test_runs_without_a_difference_are_seldom_different(worlds: int, most_trials: int) -> None:
    chance = np.random.default_rng(worlds)
    different = sum(
        rate_change(_null_trials(chance, worlds, most_trials), 0.05).p_value <= 0.05 for _ in range(COMPARISONS)
    )
    print(f"{worlds} worlds, up to {most_trials} trials each: {100 * different / COMPARISONS:.2f} % say different")
    assert different / COMPARISONS <= MOST_DIFFERENT
