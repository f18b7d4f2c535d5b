"""The yard's sabotages, and who catches what: shared by all ways of running it.

`tests/tasks/runtime/requirements/test_sabotage.py` says which tests walk the ways.
"""

from collections.abc import Mapping
from typing import Any

from helpers.paths import BUNDLES
from prefect_robomaker.schemas.runs.plan import RunResult

YARD = BUNDLES / "yard"
SABOTAGES = ("idle", "ghost", "blind", "nan", "reversed", "gone")
ASKED: Mapping[str, dict[str, Any]] = {
    "goal": {"name": "east", "x": 1.2, "y": 0.5, "within_m": 0.2},
    "no_collision": {"name": "gentle", "max_force_N": 5.0},
    "time_limit": {"name": "quick", "limit_s": 4.5},
    "clearance": {"name": "polite", "min_m": 0.05},
    "predicate": {"name": "moves", "attribute": "yard.moves"},
    "progress": {"name": "gets-on", "max_stuck_s": 1.0, "until": "east"},
    "path_length": {"name": "direct", "goal": "east", "min_ratio": 0.5},
    "expression": {"name": "arrives", "formula": "eventually (x > 1 and clearance > 0.1)"},
}
"""One requirement of each kind, which the unspoiled robot meets."""

JUDGED_ELSEWHERE: Mapping[str, str] = dict.fromkeys(
    ("speed", "upright", "coverage", "all_rooms", "localization"),
    "tests/tasks/runtime/requirements/test_motion.py::test_who_is_spoilt_is_caught",
) | {
    "topic": "tests/tasks/runtime/requirements/test_topic_rule.py::test_who_is_spoilt_is_caught",
    "off": "tests/tasks/runtime/episode/test_run_results.py::test_switching_off_what_is_not_there_is_an_error",
}
"""Tests of kinds that need more than the yard has, such as a world or a robot that can fall."""

CAUGHT_BY: Mapping[str, Mapping[str, str]] = {
    "goal": {
        "idle": "east",
        "blind": "east",
        "reversed": "east",
        "nan": "physics",
        "gone": "simulated",
    },
    "no_collision": {
        "ghost": "gentle",
        "blind": "gentle",
        "reversed": "gentle",
        "nan": "physics",
        "gone": "simulated",
    },
    "time_limit": {
        "idle": "quick",
        "blind": "quick",
        "reversed": "quick",
        "nan": "physics",
        "gone": "simulated",
    },
    "clearance": {
        "ghost": "polite",
        "blind": "polite",
        "reversed": "polite",
        "nan": "physics",
        "gone": "simulated",
    },
    "predicate": {
        "idle": "moves",
        "nan": "physics",
        "gone": "simulated",
    },
    "progress": {
        "idle": "gets-on",
        "blind": "gets-on",
        "reversed": "gets-on",
        "nan": "physics",
        "gone": "simulated",
    },
    "path_length": {
        "idle": "direct",
        "blind": "direct",
        "reversed": "direct",
        "nan": "physics",
        "gone": "simulated",
    },
    "expression": {
        "idle": "arrives",
        "blind": "arrives",
        "reversed": "arrives",
        "nan": "physics",
        "gone": "simulated",
    },
}
"""Catchers of each sabotage by kind of requirement: the requirement itself, or a watcher of physics and steps."""

FAILS_THE_JOB: Mapping[str, tuple[str, ...]] = {
    "nan": ("the action [nan, nan] has numbers that are not finite", "the action is [nan, nan]; it has to be finite"),
    "gone": ("without connecting to the simulation",),
}
"""Sabotages for which a job may be `Failed` instead: the loop or the robot's client may refuse them."""


def asked() -> list[dict[str, Any]]:
    """All of `ASKED`, as a job asks for them."""
    return [{"kind": kind, **members} for kind, members in ASKED.items()]


def assert_caught(status: str, reason: str | None, result: bytes | None, sabotage: str) -> None:
    """Asserts that a run did not pass, and that for each kind of requirement somebody caught the sabotage.

    Args:
        status: How the run ended.
        reason: Why it failed.
        result: Its `result.json`.
        sabotage: What it was spoilt by; the empty string if it was not, then it has to pass.
    """
    if status == "Failed" and sabotage in FAILS_THE_JOB:
        assert any(words in (reason or "") for words in FAILS_THE_JOB[sabotage]), reason
        return
    assert (status, result is None) == ("Completed", False), reason
    judged = RunResult.model_validate_json(result or b"")
    if not sabotage:
        assert (judged.verdict, judged.reason) == ("PASS", None), "the unspoiled robot passes, or nothing is shown"
        return
    assert judged.verdict in ("FAIL", "ERROR")
    missed = {item.name for item in judged.requirements if not item.satisfied}
    for kind, caught in CAUGHT_BY.items():
        if sabotage in caught:
            assert caught[sabotage] in missed, (kind, missed)
