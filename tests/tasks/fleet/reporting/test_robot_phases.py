"""What a robot did from when to when."""

from itertools import pairwise
from typing import Any

import pytest
from helpers.simulated_rollouts import simulate
from hypothesis import given
from hypothesis import strategies as st

from prefect_robomaker.schemas.fleet.rollouts.rollout import RobotDeploymentState
from prefect_robomaker.tasks.fleet.reporting.chart import COLUMNS, Scale, blocks_of
from prefect_robomaker.tasks.fleet.reporting.robot_phases import PHASES, end_of, spans_of
from prefect_robomaker.tasks.reporting.outcomes import Outcome


def robot(**members: Any) -> RobotDeploymentState:
    return RobotDeploymentState.model_validate(members)


def told(state: RobotDeploymentState, until_s: float = 100) -> list[tuple[str, float, float]]:
    return [(span.phase, span.from_s, span.until_s) for span in spans_of(state, until_s)]


def test_phases_follow_one_another() -> None:
    steps = {"DownloadingExtracting": 12, "ExecutingPreLaunch": 20, "Launching": 22, "ExecutingPostLaunch": 25}
    state = robot(order="closed", offered_s=10, started_s=11, step_times=steps, outcome="succeeded", finished_s=30)

    assert told(state) == [("offered", 10, 11), ("downloading", 11, 20), ("installing", 20, 22), ("launching", 22, 30)]


def test_what_goes_on_is_cut_off_and_what_is_not_begun_is_empty() -> None:
    assert told(robot(order="fetched", offered_s=10, started_s=11), until_s=15) == [
        ("offered", 10, 11),
        ("downloading", 11, 15),
    ]
    assert told(robot(order="offered", offered_s=10), until_s=15) == [("offered", 10, 15)]
    assert told(robot()) == []


def test_a_step_back_is_not_drawn() -> None:
    steps = {"Launching": 20, "DownloadingExtracting": 22}
    state = robot(order="fetched", offered_s=10, started_s=11, step_times=steps)

    assert [phase for phase, *_ in told(state)] == ["offered", "downloading", "launching"]


def test_an_order_after_the_end_goes_on() -> None:
    """A robot that did not answer, and has returned: its outcome is older than its order."""
    state = robot(order="fetched", offered_s=50, started_s=52, outcome="failed", finished_s=20)

    assert told(state, until_s=60) == [("offered", 50, 52), ("downloading", 52, 60)]


@pytest.mark.parametrize(
    ("members", "active", "outcome", "word"),
    [
        ({"outcome": "succeeded"}, True, Outcome.PASSED, "in sync"),
        ({"outcome": "failed", "failure_code": "PreLaunchFileFailure"}, True, Outcome.FAILED, "failed"),
        ({"outcome": "failed", "failure_code": "RobotDeploymentNoResponse"}, True, Outcome.BROKEN, "no response"),
        ({"outcome": "failed", "failure_code": "RobotDeploymentAborted"}, False, Outcome.CANCELED, "aborted"),
        ({"gone": "deleted"}, True, Outcome.CANCELED, "deleted"),
        ({"gone": "left"}, True, Outcome.CANCELED, "left the fleet"),
        ({"order": "fetched"}, False, Outcome.UNFINISHED, "deploying"),
        ({"order": "offered"}, True, Outcome.UNFINISHED, "has an order"),
        ({}, True, Outcome.UNFINISHED, "waits"),
        ({}, False, Outcome.UNJUDGED, "not reached"),
    ],
)
def test_each_end_has_a_sign_and_a_word(members: dict[str, Any], active: bool, outcome: Outcome, word: str) -> None:
    end = end_of(robot(**members), active=active)

    assert (end.outcome, end.word) == (outcome, word)


@given(st.integers(1, 40), st.integers(0, 2**16), st.floats(0, 200))
def test_spans_touch_and_stay_within_the_chart(robots: int, seed: int, until_s: float) -> None:
    rollout = simulate([f"r{number}" for number in range(robots)], bad=lambda n: n % 3 == 1, until_s=until_s, seed=seed)
    end_s = rollout.began_s + until_s / 2
    for state in rollout.robots.values():
        spans = spans_of(state, end_s)
        assert all(span.from_s < span.until_s <= end_s for span in spans)
        assert all(early.until_s == late.from_s for early, late in pairwise(spans))
        places = [list(PHASES).index(span.phase) for span in spans]
        assert places == sorted(set(places))


@given(st.integers(1, 40), st.integers(0, 2**16))
def test_blocks_show_each_robot_once_at_any_time(robots: int, seed: int) -> None:
    rollout = simulate([f"r{number}" for number in range(robots)], concurrent=100, seed=seed)
    scale = Scale(rollout.began_s, rollout.now_s)
    spans = [spans_of(state, rollout.now_s) for state in rollout.robots.values()]

    blocks = blocks_of(spans, scale)

    for column in range(COLUMNS):
        here = sorted((b for b in blocks if b.column <= column < b.column + b.columns), key=lambda b: b.below)
        assert sum(block.share for block in here) <= 1 + 1e-9
        top = 0.0
        for block in here:  # without gaps, those that are furthest at the bottom
            assert block.below == pytest.approx(top)
            top += block.share
        order = [list(PHASES).index(block.phase) for block in here]
        assert order == sorted(order, reverse=True)
    drawn = sum(block.share * block.columns for block in blocks) * robots
    cells = [
        max(0, min(COLUMNS, round(scale.part(span.until_s) * COLUMNS)) - round(scale.part(span.from_s) * COLUMNS))
        for some in spans
        for span in some
    ]
    assert drawn == pytest.approx(sum(cells))
