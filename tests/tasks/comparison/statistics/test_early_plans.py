"""Planned runs that stop when they are decided: as many pairs as the simulation of docs/benchmarks.md takes."""

import numpy as np
import pytest

from prefect_robomaker.schemas.reports.live_comparison import Against
from prefect_robomaker.schemas.wire.errors import ConfigurationError
from prefect_robomaker.tasks.comparison.detection import PlannedTrials, Question, plan_pairs
from prefect_robomaker.tasks.comparison.early_stops import PairedTrials, decide
from prefect_robomaker.tasks.comparison.pairing import FAILED, PASSED
from prefect_robomaker.tasks.comparison.statistics.e_processes import mixed, sign_wealth, threshold
from prefect_robomaker.tasks.comparison.statistics.early_plans import (
    pairs_until_decided,
    until_not_worse,
    worlds_until_decided,
)

RUNS = 2_000
TWO_ERRORS = 2 * (0.8 * 0.2 / RUNS) ** 0.5


@pytest.mark.parametrize(
    ("worse", "better", "median"), [(0.05, 0.15, 136), (0.10, 0.30, 68), (0.02, 0.12, 90), (0.02, 0.22, 41)]
)
def test_so_many_pairs_decide_in_four_of_five_runs(worse: float, better: float, median: int) -> None:
    found = pairs_until_decided(better - worse, better + worse, 0.05, 0.8)
    assert found is not None
    assert found.median == median  # as 20,000 simulated runs have it
    drawn = np.random.default_rng(3).random((RUNS, found.needed))
    changes = np.where(drawn < worse, -1.0, np.where(drawn < worse + better, 1.0, 0.0))
    evidence = mixed(sign_wealth(changes)) >= threshold(0.05)
    assert abs(evidence.any(axis=1).mean() - 0.8) < TWO_ERRORS


def test_whole_worlds_are_counted_where_they_decide() -> None:
    found = worlds_until_decided(0.1, 0.2, 5, 0.05, 0.8)
    assert found is not None
    chance = np.random.default_rng(4)
    drawn = chance.multinomial(5, [0.15, 0.05, 0.8], (RUNS, found.needed))
    evidence = mixed(sign_wealth((drawn[..., 0] - drawn[..., 1]).astype(float))) >= threshold(0.05)
    assert evidence.any(axis=1).mean() > 0.8 - TWO_ERRORS
    plan = plan_pairs(Question("difference", 0.1, discordant=0.2, stops=True), PlannedTrials(100, 20), None)
    assert (plan.worlds, plan.pairs, plan.test) == (found.needed, 5 * found.needed, "e-process")


@pytest.mark.parametrize(
    ("margin", "each"), [pytest.param(0.2, None, marks=pytest.mark.deep), (0.15, 5)], ids=["pairs", "worlds"]
)
def test_so_many_trials_show_that_nothing_got_worse_by_more(margin: float, each: int | None) -> None:
    """The runs are decided as those of `run --against --margin` are; the plan has drawn others."""
    found = until_not_worse(margin, 0.2, each, 0.05, 0.8)
    assert found is not None
    chance, runs, asked = np.random.default_rng(5), 200, Against(run_id="a", alpha=0.05, margin=margin)
    answers = [decide(_paired(chance, found.needed, each or 1), asked).answer for _ in range(runs)]
    assert abs(answers.count("not worse") / runs - 0.8) < 2 * (0.8 * 0.2 / runs) ** 0.5 + 0.02
    half = [decide(_paired(chance, found.median, each or 1), asked).answer for _ in range(runs)]
    assert abs(half.count("not worse") / runs - 0.5) < 2 * (0.25 / runs) ** 0.5


def _paired(chance: np.random.Generator, worlds: int, each: int) -> list[PairedTrials]:
    """Trials of two runs with the same pass rate, of which a fifth differ."""
    before = np.where(chance.random((worlds, each)) < 0.7, PASSED, FAILED).astype(np.int8)
    # Of 0.7 that pass 0.1 fail then, and of 0.3 that fail 0.1 pass then.
    flips = chance.random((worlds, each)) < np.where(before == PASSED, 0.1 / 0.7, 0.1 / 0.3)
    after = np.where(flips, np.where(before == PASSED, FAILED, PASSED), before).astype(np.int8)
    return [PairedTrials(f"world {index}", *both) for index, both in enumerate(zip(before, after, strict=True))]


@pytest.mark.deep
def test_a_margin_that_the_bets_cannot_rule_out_is_refused() -> None:
    with pytest.raises(ConfigurationError, match=r"seldom shows that nothing got worse by 0.5 points where 90% of"):
        plan_pairs(Question("margin", 0.005, discordant=0.9, stops=True), PlannedTrials(40, 40), None)


def test_a_plan_says_when_such_a_run_stops_and_what_it_lacks() -> None:
    plan = plan_pairs(Question("difference", 0.1, discordant=0.2, stops=True), PlannedTrials(40, 40), None)
    assert (plan.pairs, plan.median, plan.more, plan.worlds) == (241, 136, 201, None)
    fixed = plan_pairs(Question("difference", 0.1, discordant=0.2), PlannedTrials(40, 40), None)
    assert (fixed.pairs, fixed.median) == (168, None)


def test_what_the_bets_cannot_show_is_refused_with_what_would_do() -> None:
    """If 20 % differ, 11.5 get better and 8.5 worse: every bet loses in the long run."""
    assert pairs_until_decided(0.03, 0.2, 0.05, 0.8) is None
    with pytest.raises(ConfigurationError, match=r"leave --against out, and compare runs of 1800 trials"):
        plan_pairs(Question("difference", 0.03, discordant=0.2, stops=True), PlannedTrials(40, 40), None)
