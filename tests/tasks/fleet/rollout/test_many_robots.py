"""Thousands of robots with losses of power, silence and failures: none is stuck, and the model counts the same."""

from collections import Counter

import pytest
from helpers.many_robots import LONGEST_S, draw_scripts, model_for, plan_for
from helpers.rollout_ledger import LedgerService
from helpers.rollout_robots import watch


def counts(facts: dict[str, object]) -> Counter[tuple[object, object]]:
    """How many robots ended how."""
    robots = facts["robots"]
    assert isinstance(robots, dict)
    return Counter((outcome, code) for _, _, outcome, code in robots.values())


def roll_out(
    robots: int, seed: int, failing: float, threshold: int, canaries: int = 10
) -> Counter[tuple[object, object]]:
    scripts = draw_scripts(robots, seed, failing)
    product = LedgerService(plan_for(scripts, threshold, canaries), 1000)
    model = model_for(scripts, 1000, threshold, canaries)
    seen = watch(product, scripts, LONGEST_S, repeats_seed=seed, facts_every_s=LONGEST_S // 10)
    expected = watch(model, scripts, LONGEST_S, repeats_seed=seed, facts_every_s=LONGEST_S // 10)

    assert seen == expected
    assert product.most_open <= robots // 5
    assert product.ledger.open_orders == 0
    assert product.ledger.status != "InProgress"
    return counts(seen[-1])


def test_a_good_version_reaches_its_robots_in_spite_of_losses_of_power() -> None:
    ends = roll_out(250, 1, 0.05, 60)

    assert ends["succeeded", None] > 200
    assert ends["failed", "RobotAgentConnectionTimeout"] > 0
    assert ends["failed", "RobotDeploymentNoResponse"] == 0  # they were away, returned and are in sync
    assert ends[None, None] == 0


def test_a_bad_version_stops_at_the_threshold() -> None:
    ends = roll_out(400, 2, 0.9, 20, canaries=0)

    failed = sum(count for (outcome, _), count in ends.items() if outcome == "failed")
    assert 80 <= failed < 80 + 80  # the threshold, and at most as many as were under way


@pytest.mark.parametrize(
    "robots", [pytest.param(2000, marks=pytest.mark.deep), pytest.param(10_000, marks=pytest.mark.endurance)]
)
@pytest.mark.timeout(900)
def test_thousands_of_robots(robots: int) -> None:
    ends = roll_out(robots, 3, 0.05, 60)

    assert ends[None, None] == 0
    assert ends["failed", "RobotDeploymentNoResponse"] == 0


def test_a_bad_version_stops_at_its_canaries() -> None:
    ends = roll_out(400, 2, 0.9, 20)

    assert 390 <= ends[None, None] <= 398  # two of ten are the threshold
