"""Rules about how and where a robot moves, without physics."""

import math
from typing import Any

import pytest
from helpers.examples import examples
from hypothesis import given
from hypothesis import strategies as st

from prefect_robomaker.schemas.runs.requirement_kinds.all_rooms import AllRoomsRule
from prefect_robomaker.schemas.runs.requirement_kinds.coverage import CoverageRule
from prefect_robomaker.schemas.runs.requirement_kinds.expression import ExpressionRule
from prefect_robomaker.schemas.runs.requirement_kinds.kind import yaw_rad
from prefect_robomaker.schemas.runs.requirement_kinds.localization import LocalizationRule, pose_of
from prefect_robomaker.schemas.runs.requirement_kinds.progress import ProgressRule
from prefect_robomaker.schemas.runs.requirement_kinds.speed import SpeedRule
from prefect_robomaker.schemas.runs.requirement_kinds.upright import UprightRule, tilt_deg
from prefect_robomaker.schemas.runs.requirements import parse_requirements
from prefect_robomaker.tasks.runtime.requirements.observer import make_rules

EAST = {"kind": "goal", "name": "east", "x": 5, "y": 0}


def rules_of(*requirements: dict[str, Any]) -> list[Any]:
    return make_rules(parse_requirements([{"name": "it", **each} for each in requirements], "requirements"))


def rule_of(kind: str, **members: Any) -> Any:
    return rules_of({"kind": kind, **members})[0]


@examples(50)
@given(st.lists(st.floats(0, 3), min_size=1, max_size=20), st.floats(0.1, 3))
def test_the_highest_mean_speed_decides(speeds: list[float], limit: float) -> None:
    rule: SpeedRule = rule_of("speed", max_mps=limit)
    x = 0.0
    rule.update(0.0, (0.0, 0.0, 0.0))
    for index, speed in enumerate(speeds, 1):
        x += speed * 0.5
        rule.update(index * 0.5, (x, 0.0, 0.0))
    judged = rule.judged(len(speeds) * 0.5, "agent")
    assert judged.value == pytest.approx(max(speeds), abs=1e-5)
    assert judged.margin == pytest.approx(limit - max(speeds), abs=1e-5)
    if abs(limit - max(speeds)) > 1e-5:
        assert judged.satisfied == (max(speeds) <= limit)


def test_a_speed_limit_of_a_room_counts_there_and_needs_the_robot_there() -> None:
    rule: SpeedRule = rule_of("speed", max_mps=1, room="Hall")
    rule.update(0.0, (0.0, 0.0, 0.0), counts=False)
    rule.update(1.0, (5.0, 0.0, 0.0), counts=False)
    assert rule.judged(1.0, "agent").error == "the robot was not seen in Hall, so there was no speed to judge"
    rule = rule_of("speed", max_mps=1, room="Hall")
    rule.update(0.0, (0.0, 0.0, 0.0), counts=False)
    rule.update(1.0, (5.0, 0.0, 0.0), counts=False)
    rule.update(2.0, (5.0, 2.0, 0.0))
    judged = rule.judged(2.0, "agent")
    assert judged.detail == "reached 2.00 m/s in Hall; at most 1 m/s is allowed, first at 2.00 s"
    assert (judged.satisfied, judged.margin, judged.first_violation_s) == (False, -1.0, 2.0)


def test_one_look_is_no_speed() -> None:
    rule: SpeedRule = rule_of("speed", max_mps=1)
    rule.update(0.0, (0.0, 0.0, 0.0))
    assert "before a second look" in (rule.judged(0.0, "agent").error or "")


@examples(50)
@given(st.floats(-math.pi, math.pi), st.floats(0, math.pi))
def test_the_tilt_is_that_of_the_z_axis_however_it_is_turned(yaw: float, roll: float) -> None:
    turned, tipped = (math.cos(yaw / 2), math.sin(yaw / 2)), (math.cos(roll / 2), math.sin(roll / 2))
    orientation = (turned[0] * tipped[0], turned[0] * tipped[1], turned[1] * tipped[1], turned[1] * tipped[0])
    assert tilt_deg(orientation) == pytest.approx(math.degrees(roll), abs=1e-6)
    assert yaw_rad((turned[0], 0.0, 0.0, turned[1])) == pytest.approx(yaw, abs=1e-9)


def test_the_largest_tilt_decides() -> None:
    rule: UprightRule = rule_of("upright", max_tilt_deg=20)
    for time_s, tilt in enumerate([1.0, 25.0, 40.0, 3.0]):
        rule.update(time_s, tilt)
    judged = rule.judged(3, "agent")
    assert (judged.satisfied, judged.value, judged.margin, judged.unit) == (False, 40.0, -20.0, "deg")
    assert judged.detail == "tilted by 40.0 deg; at most 20 deg is allowed, first at 1.00 s"
    assert rule_of("upright", max_tilt_deg=20).judged(0, "agent").error == "the robot's tilt was never measured"


@examples(50)
@given(st.lists(st.integers(1, 30), min_size=1, max_size=8), st.integers(1, 30))
def test_the_longest_stop_decides(stops: list[int], limit: int) -> None:
    """A robot that rests at each metre for so many seconds, and jumps to the next."""
    rule: ProgressRule = rule_of("progress", max_stuck_s=limit)
    time_s = 0
    for metre, stop_s in enumerate(stops):
        for _ in range(stop_s + 1):
            rule.update(time_s, (float(metre), 0.0))
            time_s += 1
    judged = rule.judged(time_s, "agent")
    assert judged.value == max(stops)
    assert judged.satisfied == (max(stops) <= limit)
    assert judged.margin == limit - max(stops)


def test_creeping_within_reach_is_being_stuck_and_a_short_run_is_told() -> None:
    rule: ProgressRule = rule_of("progress", max_stuck_s=3)
    for time_s in range(6):
        rule.update(time_s, (0.05 * (time_s % 2), 0.0))
    judged = rule.judged(5, "duration limit")
    assert judged.detail == "stayed for 5.00 s within 0.1 m of (0.00, 0.00); at most 3 s is allowed, first at 4.00 s"
    short: ProgressRule = rule_of("progress", max_stuck_s=30)
    short.update(0.0, (0.0, 0.0))
    assert short.judged(2, "environment").satisfied
    assert short.remark() == "it: the run took 2.00 s, so the robot could not be stuck for 30 s"
    cut: ProgressRule = rule_of("progress", max_stuck_s=30)
    cut.update(0.0, (0.0, 0.0))
    assert "before it could be stuck for 30 s" in (cut.judged(2, "duration limit").error or "")


def test_a_robot_may_rest_where_it_had_to_go() -> None:
    goal, rule = rules_of(EAST, {"kind": "progress", "max_stuck_s": 3, "until": "east"})
    for time_s in range(20):
        x = min(5.0, time_s)
        goal.update(time_s, 5 - x)
        rule.update(time_s, (x, 0.0))
    assert rule.judged(20, "duration limit").satisfied


def drive(rules: list[Any], way: list[tuple[float, float]], shortest_m: float | None) -> Any:
    goal, rule = rules  # of `EAST`, and of the way there
    for time_s, (x, y) in enumerate(way):
        goal.update(time_s, math.hypot(x - 5, y))
        if time_s == 0:
            rule.begin(shortest_m)
        rule.update(time_s, (x, y, 0.0))
    return rule.judged(len(way), "environment")


def test_success_weighted_by_path_length() -> None:
    asked = {"kind": "path_length", "goal": "east", "min_ratio": 0.8}
    straight = drive(rules_of(EAST, asked), [(0, 0), (3, 0), (4.6, 0), (9, 0)], 4.5)
    assert (straight.satisfied, straight.value) == (True, pytest.approx(4.5 / 4.6, abs=1e-6))
    detour = drive(rules_of(EAST, asked), [(0, 0), (0, 3), (5, 3), (5, 0)], 4.5)
    assert (detour.satisfied, detour.value) == (False, pytest.approx(4.5 / 11, abs=1e-6))
    assert detour.margin == pytest.approx(4.5 / 11 - 0.8, abs=1e-6)
    assert detour.detail == (
        "0.409 of success weighted by path length, 0.8 asked for: the shortest way is 4.50 m, it took 11.00 m"
    )
    missed = drive(rules_of(EAST, asked), [(0, 0), (1, 0)], 4.5)
    assert (missed.satisfied, missed.value) == (False, 0.0)
    assert missed.detail == "0, since east was not reached; 0.8 asked for"


@pytest.mark.parametrize(("shortest_m", "words"), [(None, "the map has no way to east"), (0.0, "is reached already")])
def test_a_way_that_cannot_be_missed_or_is_none(shortest_m: float | None, words: str) -> None:
    asked = {"kind": "path_length", "goal": "east", "min_ratio": 0.8}
    assert words in drive(rules_of(EAST, asked), [(5, 0), (5, 0)], shortest_m).error


def cover(rule: CoverageRule, passed: list[set[int]], cells: int = 10) -> Any:
    rule._cells = cells
    for time_s, each in enumerate(passed):
        rule.update(time_s, each)
        rule._last = (0.0, 0.0)
    return rule.judged(len(passed), "environment")


def test_the_share_of_the_floor_decides() -> None:
    judged = cover(rule_of("coverage", min_share=0.4, radius_m=0.2), [{1}, {1, 2}, {3}])
    assert (judged.satisfied, judged.value, judged.margin) == (False, 0.3, pytest.approx(-0.1))
    judged = cover(rule_of("coverage", min_share=0.4, radius_m=0.2), [{1}, {1, 2}, {3, 4}, {5}])
    assert (judged.satisfied, judged.value) == (True, 0.5)
    assert "reached at 2.00 s" in judged.detail
    late = cover(rule_of("coverage", min_share=0.4, radius_m=0.2, by_s=1), [{1}, {1, 2}, {3, 4}])
    assert (late.satisfied, late.value, late.first_violation_s) == (False, 0.2, 1.0)
    start = cover(rule_of("coverage", min_share=0.4, radius_m=0.2), [{1, 2, 3, 4}, {5}])
    assert "covers so much where it starts" in start.error


def visit(rule: AllRoomsRule, *rooms: str | None) -> Any:
    rule.begin(["hall", "bath", "den"])
    for time_s, room in enumerate(rooms):
        rule.update(float(time_s), room)
    return rule.judged(float(len(rooms)), "environment")


def test_every_room_has_to_be_visited() -> None:
    judged = visit(rule_of("all_rooms"), "hall", None, "bath", "hall")
    assert (judged.satisfied, judged.value, judged.limit, judged.margin) == (False, 2.0, 3.0, -1.0)
    assert judged.detail == "2 of 3 rooms visited; not den"
    judged = visit(rule_of("all_rooms", by_s=3), "hall", "den", "bath")
    assert judged.detail == "all 3 rooms visited at 2.00 s, 3 s asked for"
    assert judged.margin == 0
    late = visit(rule_of("all_rooms", by_s=1), "hall", "den", "bath")
    assert (late.satisfied, late.margin, late.first_violation_s) == (False, -1.0, 1.0)


def test_the_worst_estimate_decides() -> None:
    rule: LocalizationRule = rule_of("localization", attribute="a.b", max_m=0.2, max_deg=10)
    rule.update(1.0, (0.1, 0.0, math.pi - 0.05), (0.0, 0.0, -math.pi + 0.05))
    judged = rule.judged(2, "agent")
    assert (judged.satisfied, judged.value, judged.unit) == (True, pytest.approx(math.degrees(0.1), abs=1e-5), "deg")
    rule.update(3.0, (0.5, 0.0, 0.0), (0.0, 0.0, 0.0))
    judged = rule.judged(4, "agent")
    assert (judged.satisfied, judged.value, judged.unit, judged.margin) == (False, 0.5, "m", pytest.approx(-0.3))
    rule.update(5.0, None, (0.0, 0.0, 0.0))
    judged = rule.judged(6, "agent")
    assert judged.detail.startswith("no estimate in 1 of 3 checks; 0.500 m off; at most 0.2 m is allowed; its yaw")


def test_an_estimate_that_is_none_or_the_truth_is_told() -> None:
    rule: LocalizationRule = rule_of("localization", attribute="a.b", max_m=0.2, from_s=5)
    assert rule.judged(2, "agent").error == "the run ended at 2.00 s, before from_s, 5 s"
    rule = rule_of("localization", attribute="a.b", max_m=0.2)
    rule.update(1.0, (1.0, 2.0, None), (1.0, 2.0, 0.0))
    assert rule.judged(2, "agent").satisfied
    assert "is the true place to the last digit" in (rule.remark() or "")
    rule = rule_of("localization", attribute="a.b", max_m=0.2, max_deg=5)
    rule.update(1.0, (1.0, 2.0, None), (1.0, 2.0, 0.0))
    assert rule.judged(2, "agent").error == "a.b gives no yaw, so max_deg cannot be judged"
    assert pose_of([1, 2]) == (1.0, 2.0, None)
    assert pose_of((1, 2, 3)) == (1.0, 2.0, 3.0)
    assert [pose_of(each) for each in ("ab", 5, [1], [1, math.nan])] == ["ab", "5", "[1]", "[1, nan]"]


def sample(rule: ExpressionRule, end_s: float, *values: tuple[float, dict[str, float]]) -> Any:
    for time_s, signals in values:
        rule.update(time_s, signals)
    return rule.judged(end_s, "environment")


def test_a_formula_is_judged_by_its_robustness() -> None:
    rule: ExpressionRule = rule_of("expression", formula="always (clearance < 0.5 -> speed < 0.3)")
    near = [(0.1 * i, {"clearance": c, "speed": s}) for i, (c, s) in enumerate([(1, 2), (0.4, 0.2), (0.4, 0.8)])]
    judged = sample(rule, 0.2, *near)
    assert (judged.satisfied, judged.margin, judged.first_violation_s) == (False, pytest.approx(-0.1), 0.2)
    assert judged.detail == ("always (clearance < 0.5 -> speed < 0.3) does not hold, robustness -0.1, first at 0.20 s")
    rule = rule_of("expression", formula="always (clearance < 0.5 -> speed < 0.3)")
    assert sample(rule, 0.1, *near[:1], (0.1, {"clearance": 0.9, "speed": 0.2})).satisfied
    assert rule.remark() == "it: clearance < 0.5 never held, so what was to follow was not put to the test"


def test_a_run_that_is_too_short_for_a_formula_is_no_pass() -> None:
    rule: ExpressionRule = rule_of("expression", formula="always[0, 5] x < 1")
    judged = sample(rule, 0.3, *((0.1 * i, {"x": 0.0}) for i in range(4)))
    assert judged.error.startswith("the run ended at 0.30 s, before it was decided")
    assert "before a second look" in sample(rule_of("expression", formula="x < 1"), 0, (0.0, {"x": 0.0})).error


def test_late_looks_and_the_last_one_are_samples_too() -> None:
    rule: ExpressionRule = rule_of("expression", formula="always (x < 9 and speed < 9)")
    for time_s, x in ((0.0, 1.0), (0.12, 2.0), (0.24, 3.0), (0.6, 4.0), (0.61, 5.0)):
        rule.update(time_s, {"x": x, "speed": 10 * x})
    assert rule.samples["x"] == [1, 1, 2, 3, 3, 3, 4, 5]
    assert rule.samples["speed"] == [20, 20, 20, 30, 40, 40, 40, 50]


def test_numbers_that_are_none_are_neither_met_nor_missed() -> None:
    big = " * 1e99" * 4
    rule: ExpressionRule = rule_of("expression", formula=f"always (x{big} - y{big} < 1)")
    judged = sample(rule, 0.1, *((0.1 * i, {"x": 1.0, "y": 1.0}) for i in range(2)))
    assert "too large to compare" in (judged.error or "")


@pytest.mark.parametrize("seconds", [0.0, 0.3])
def test_the_only_room_is_no_visit_where_the_robot_is_first_seen(seconds: float) -> None:
    """Recordings may have no pose at the beginning."""
    rule: AllRoomsRule = rule_of("all_rooms")
    rule.begin(["living"])
    rule.update(seconds, "living")
    assert "starts in the only room" in (rule.judged(1.0, "environment").error or "")
