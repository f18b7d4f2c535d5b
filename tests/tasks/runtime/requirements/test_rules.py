"""Requirement rules, without physics."""

from typing import Any

import pytest
from helpers.examples import examples
from hypothesis import given
from hypothesis import strategies as st

from prefect_robomaker.schemas.runs.requirement_kinds.clearance import ClearanceRule
from prefect_robomaker.schemas.runs.requirement_kinds.goal import GoalRule
from prefect_robomaker.schemas.runs.requirement_kinds.no_collision import SEPARATION_S, CollisionRule
from prefect_robomaker.schemas.runs.requirement_kinds.predicate import PredicateRule
from prefect_robomaker.schemas.runs.requirement_kinds.time_limit import TimeLimitRule
from prefect_robomaker.schemas.runs.requirements import parse_requirements
from prefect_robomaker.tasks.runtime.requirements.observer import make_rules

times = st.lists(st.floats(0, 100), min_size=1, max_size=30, unique=True).map(sorted)
forces = st.floats(0, 1e4)


def rule_of(kind: str, **members: Any) -> Any:
    return make_rules(parse_requirements([{"kind": kind, "name": "it", **members}], "requirements"))[0]


@examples(50)
@given(st.data(), times, st.floats(0, 1e3))
def test_a_collision_is_a_force_above_the_limit(data: st.DataObject, at: list[float], limit: float) -> None:
    rule: CollisionRule = rule_of("no_collision", max_force_N=limit)
    felt = [data.draw(forces) for _ in at]
    for time_s, force in zip(at, felt, strict=True):
        rule.update(time_s, {"wall": force})
    judged = rule.judged(at[-1], "agent")
    hard = [time_s for time_s, force in zip(at, felt, strict=True) if force > limit]
    assert judged.satisfied == (not hard)
    assert judged.first_violation_s == (pytest.approx(hard[0], abs=1e-6) if hard else None)
    assert judged.value == pytest.approx(max(felt), abs=1e-5)
    assert judged.margin is not None
    assert (judged.margin >= 0) == judged.satisfied or abs(judged.margin) < 1e-5
    assert (judged.limit, judged.unit) == (limit, "N")


@examples(50)
@given(st.lists(st.booleans(), min_size=1, max_size=60), st.integers(0, 5))
def test_touches_are_counted_from_contact_to_separation(touching: list[bool], allowed: int) -> None:
    """Each run of contacts is one touch when what separates runs is longer than bouncing."""
    rule: CollisionRule = rule_of("no_collision", max_force_N=1, max_count=allowed)
    for index, touches in enumerate(touching):
        rule.update(index * SEPARATION_S * 0.75, {"wall": 2.0} if touches else {})
    runs = [
        index for index, touches in enumerate(touching) if touches and True not in touching[max(0, index - 1) : index]
    ]
    assert rule.hard.total() == len(runs)
    judged = rule.judged(99, "agent")
    assert judged.satisfied == (len(runs) <= allowed)
    if allowed:
        assert (judged.value, judged.limit) == (len(runs), allowed)
        assert judged.margin == allowed - len(runs)


def test_only_what_is_meant_counts_as_a_collision() -> None:
    rule: CollisionRule = rule_of("no_collision", max_force_N=1, others=["Beds*", "wall"], ignore=["Beds-2"])
    rule.update(1.0, {"Beds-2": 9.0, "Toy": 9.0})
    assert rule.judged(2, "agent").detail == "nothing was touched"
    rule.update(1.5, {"Beds-1": 3.0, "wall": 0.5})
    judged = rule.judged(2, "agent")
    assert judged.detail == "hardest touch 3.0 N (Beds-1), 1 N allowed; 1 harder, 0 allowed: Beds-1 1x"
    assert judged.first_violation_s == 1.5


@examples(50)
@given(st.data(), times, st.floats(0.01, 5))
def test_the_smallest_distance_decides(data: st.DataObject, at: list[float], limit: float) -> None:
    rule: ClearanceRule = rule_of("clearance", min_m=limit)
    found = [data.draw(st.floats(-1, 10)) for _ in at]
    for time_s, distance in zip(at, found, strict=True):
        rule.update(time_s, distance, "table")
    judged = rule.judged(at[-1], "agent")
    assert judged.satisfied == (min(found) >= limit)
    assert judged.value == pytest.approx(min(found), abs=1e-5)
    assert judged.margin == pytest.approx(min(found) - limit, abs=1e-5)


def test_a_clearance_of_nothing_is_kept() -> None:
    judged = rule_of("clearance", min_m=1).judged(3, "agent")
    assert (judged.satisfied, judged.value, judged.margin) == (True, None, None)


@examples(50)
@given(times, st.floats(1, 50), st.floats(0, 100))
def test_a_run_is_over_in_time_if_it_ends_in_time(at: list[float], limit: float, more: float) -> None:
    rule: TimeLimitRule = rule_of("time_limit", limit_s=limit)
    for time_s in at:
        rule.update(time_s)
    end_s = at[-1] + more
    judged = rule.judged(end_s, "agent")
    assert judged.satisfied == (end_s <= limit + 1e-6)
    assert judged.margin == pytest.approx(limit - end_s, abs=1e-5)


@examples(50)
@given(st.data(), times, st.one_of(st.none(), st.floats(1, 100)))
def test_a_goal_counts_from_its_first_visit(data: st.DataObject, at: list[float], by_s: float | None) -> None:
    rule: GoalRule = rule_of("goal", x=0, y=0, within_m=1, by_s=by_s)
    away = [data.draw(st.floats(0, 3)) for _ in at]
    for time_s, distance in zip(at, away, strict=True):
        rule.update(time_s, distance)
    there = [time_s for time_s, distance in zip(at, away, strict=True) if distance <= 1]
    judged = rule.judged(at[-1], "agent")
    assert rule.reached_s == (there[0] if there else None)
    assert judged.satisfied == (bool(there) and (by_s is None or there[0] <= by_s + 1e-6))
    if not there:
        assert (judged.value, judged.unit) == (pytest.approx(min(away), abs=1e-5), "m")
        assert judged.margin is not None
        assert judged.margin < 1e-6


def test_goals_in_order() -> None:
    first, second = make_rules(
        parse_requirements(
            [
                {"kind": "goal", "name": "one", "x": 0, "y": 0},
                {"kind": "goal", "name": "two", "x": 9, "y": 0, "after": "one"},
            ],
            "requirements",
        )
    )
    assert isinstance(first, GoalRule)
    assert isinstance(second, GoalRule)
    for time_s, x in enumerate([9, 5, 0, 5, 9]):
        first.update(time_s, abs(x))
        second.update(time_s, abs(x - 9))
    assert (first.reached_s, second.reached_s) == (2, 4)


def test_a_goal_out_of_order_says_what_came_first() -> None:
    goals = [
        {"kind": "goal", "name": "one", "x": 0, "y": 0},
        {"kind": "goal", "name": "two", "x": 9, "y": 0, "after": "one"},
    ]
    first, second = make_rules(parse_requirements(goals, "requirements"))
    assert isinstance(first, GoalRule)
    assert isinstance(second, GoalRule)
    first.update(1, 9.0)
    second.update(1, 0.0)
    judged = second.judged(3, "duration limit")
    assert not judged.satisfied
    assert judged.detail.endswith("one comes first and was not reached either; ended by duration limit")


def test_only_what_was_near_in_its_turn_counts_for_a_goal_after_another() -> None:
    goals = [
        {"kind": "goal", "name": "cook", "x": 4, "y": 0},
        {"kind": "goal", "name": "home", "x": 0, "y": 0, "after": "cook"},
    ]
    cook, home = make_rules(parse_requirements(goals, "requirements"))
    assert isinstance(cook, GoalRule)
    assert isinstance(home, GoalRule)
    home.update(0, 0.0)
    before = home.judged(1, "duration limit")
    assert (before.value, before.margin) == (None, None)
    assert "nearest" not in before.detail
    for time_s, x in enumerate([0, 2, 4, 3, 1.5, 2]):
        cook.update(time_s, abs(x - 4))
        home.update(time_s, x)
    judged = home.judged(5, "duration limit")
    assert (judged.satisfied, judged.value, judged.limit, judged.margin) == (False, 1.5, 0.5, -1.0)
    assert judged.detail.startswith("(0, 0) not reached in 5.00 s, nearest after cook 1.50 m, 0.5 m asked for;")


@examples(50)
@given(st.lists(st.booleans(), min_size=1, max_size=20))
def test_a_predicate_holds_always_or_not(answers: list[bool]) -> None:
    rule: PredicateRule = rule_of("predicate", attribute="a.b")
    for index, holds in enumerate(answers):
        rule.update(float(index), holds, "" if holds else f"no {index}")
    judged = rule.judged(99, "agent")
    assert judged.satisfied == all(answers)
    if not all(answers):
        first = answers.index(False)
        assert judged.first_violation_s == first
        assert judged.detail.endswith(f"no {first}")
        assert judged.value == answers.count(False)


def test_what_cannot_be_judged_is_an_error_and_no_failure() -> None:
    rule: PredicateRule = rule_of("predicate", attribute="a.b", stop=True)
    assert not rule.is_over
    rule.fail("it raised ValueError: no")
    rule.fail("another")
    judged = rule.judged(1, "agent")
    assert rule.is_over
    assert judged.error == "it raised ValueError: no"
    assert not judged.satisfied
