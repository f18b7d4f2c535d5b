"""Evidence holds judged trials only, each once, and says how those that failed did so."""

from collections.abc import Callable
from typing import Any

import pytest

from prefect_robomaker.tasks.causes.evidence import Signature, evidence_of, signature_of
from prefect_robomaker.tasks.causes.explanation import explain
from prefect_robomaker.tasks.reporting.causes import why_in_lines

from .conftest import Row, table_of

GOALS = [
    {"name": "kitchen", "kind": "goal", "satisfied": True, "detail": "", "value": 12.0, "unit": "s"},
    {"name": "bed", "kind": "goal", "satisfied": True, "detail": "", "value": 40.0, "unit": "s"},
]


def test_what_broke_was_cancelled_or_has_no_verdict_is_no_evidence(made: Callable[..., Any]) -> None:
    outcomes = ["passed", "failed", "broken", "canceled", "unfinished", "no verdict", "passed"]
    evidence = evidence_of(made([{"outcome": outcome} for outcome in outcomes]))
    assert evidence.rows.tolist() == [0, 1, 6]
    assert evidence.failed.tolist() == [False, True, False]


def test_trials_that_went_through_the_same_states_with_the_same_axes_count_once(made: Callable[..., Any]) -> None:
    rows = [
        {"axes": {"mass": 1.0}, "state_digest": "a", "seed": 1},
        {"axes": {"mass": 1.0}, "state_digest": "a", "seed": 2},
        {"axes": {"mass": 1.2}, "state_digest": "a", "seed": 1},  # the axis changes nothing, which is evidence
        {"axes": {"mass": 1.0}, "state_digest": "a", "seed": 1, "world": 1},
        {"axes": {"mass": 1.0}, "seed": 3},
        {"axes": {"mass": 1.0}, "seed": 4},
    ]
    evidence = evidence_of(made(rows))
    assert evidence.rows.tolist() == [0, 2, 3, 4, 5]
    assert evidence.twins == 1


def test_trials_that_differ_in_an_axis_that_changes_nothing_count_once(made: Callable[..., Any]) -> None:
    """Else one trial would be as many as such an axis has values."""

    def row(mass: float, unread: float, seed: int) -> dict[str, Any]:
        return {"axes": {"mass": mass, "unread": unread}, "seed": seed, "state_digest": f"{mass} {seed}"}

    rows = [row(mass, unread, seed) for mass in (1.0, 2.0) for unread in (1.0, 2.0, 3.0) for seed in (1, 2)]
    evidence = evidence_of(made(rows))
    assert evidence.rows.tolist() == [0, 1, 6, 7]
    assert (evidence.idle, evidence.twins) == (("unread",), 0)
    assert [axis.name for axis in evidence.axes] == ["mass"]
    rows[2]["state_digest"] = "another"
    assert evidence_of(made(rows)).rows.tolist() == list(range(12))


def test_jobs_whose_trials_are_all_copies_of_another_jobs_count_once(made: Callable[..., Any]) -> None:
    """An axis of a step, or a seed, that changes nothing made twice the evidence: "too few" became a claim."""

    def row(surface: str, seed: int, load: float) -> dict[str, Any]:
        axes = {"surface": surface, "load": load}
        return {"axes": axes, "job": f"{surface} {seed}", "seed": seed, "state_digest": f"{load} {seed % 2}"}

    rows = [row(surface, seed, load) for surface in ("tiles", "ice") for seed in range(4) for load in (1.0, 2.0, 4.0)]
    evidence = evidence_of(made(rows))
    assert evidence.rows.tolist() == list(range(6))  # seeds 0 and 1 of the first surface
    assert (evidence.idle, evidence.twins) == (("surface",), 18)
    assert [axis.name for axis in evidence.axes] == ["load"]
    rows[15]["state_digest"] = "ice matters here"
    evidence = evidence_of(made(rows))
    assert evidence.rows.tolist() == [*range(6), 15, 16, 17]  # the job as a whole, as its copies are no chance
    assert evidence.idle == ()


def test_jobs_with_trials_without_digests_are_no_copies(made: Callable[..., Any]) -> None:
    rows = [{"axes": {"load": load}, "job": f"sim-{job}"} for job in range(2) for load in (1.0, 2.0)]
    assert len(evidence_of(made(rows))) == 4


def test_jobs_without_trials_that_went_through_the_same_states_count_once(made: Callable[..., Any]) -> None:
    """Seeds that change nothing make jobs that are all alike, whose digests are not in the table."""
    rows = [{"world": world, "trial": None, "job": f"sim-{seed}", "seed": seed} for seed in range(3) for world in "ab"]
    assert len(evidence_of(made(rows))) == 6
    evidence = evidence_of(made(rows), [f"states in {row['world']}" for row in rows])
    assert evidence.rows.tolist() == [0, 1]
    assert evidence.twins == 4
    rows[2] |= {"outcome": "failed", "requirements": [{"name": "strict", "satisfied": False, "detail": ""}]}
    assert evidence_of(made(rows), [f"states in {row['world']}" for row in rows]).rows.tolist() == [0, 1, 2]


def test_the_first_requirement_that_was_missed_names_the_failure(miss: Callable[..., dict[str, Any]]) -> None:
    asked = [
        *GOALS,
        miss("late", first_violation_s=50.0),
        miss("polite", first_violation_s=13.5, room="Kitchen", other="chair_12"),
        miss("broken", first_violation_s=1.0, error="no topic"),
        miss("aside", first_violation_s=2.0, counts=False),
    ]
    assert signature_of(asked) == Signature("polite", "Kitchen", "chair", "after kitchen")


@pytest.mark.parametrize(
    ("at_s", "phase"), [(3.0, "before kitchen"), (12.0, "after kitchen"), (39.9, "after kitchen"), (41.0, "after bed")]
)
def test_a_phase_is_the_last_goal_that_was_reached(
    at_s: float, phase: str, miss: Callable[..., dict[str, Any]]
) -> None:
    assert signature_of([*GOALS, miss(first_violation_s=at_s)]).phase == phase


def test_a_goal_that_is_reached_at_once_is_reached(miss: Callable[..., dict[str, Any]]) -> None:
    start = {"name": "start", "kind": "goal", "satisfied": True, "detail": "", "value": 0.0, "unit": "s"}
    never = {
        "name": "never",
        "kind": "goal",
        "satisfied": False,
        "counts": False,
        "detail": "",
        "value": None,
        "unit": "s",
    }
    assert signature_of([never, start, miss(first_violation_s=0.0)]).phase == "after start"
    assert signature_of([never, miss(first_violation_s=3.0)]).phase == "before never"


def test_a_failure_without_a_missed_requirement_is_of_its_verdict() -> None:
    assert signature_of(GOALS) == Signature("verdict")


def test_a_value_that_a_cell_does_not_name_is_a_value_of_its_own(made: Callable[..., Any]) -> None:
    evidence = evidence_of(made([{"axes": {"mass": 1.0}}, {"axes": {}}, {"axes": {"mass": 2.0}}]))
    [mass] = evidence.axes
    assert [mass.label(code) for code in mass.codes] == ["1", "as built", "2"]


def test_a_cause_without_a_failure_elsewhere_has_no_lift() -> None:
    """The ratio has no size then: how large it comes out is the correction's doing."""
    rows: list[Row] = [
        {"axes": {"delay": 0.6 * (number % 2)}, "seed": number // 2, "outcome": ("passed", "failed")[number % 2]}
        for number in range(72)
    ]
    why = explain(table_of(rows))
    assert why is not None
    assert why.groups[0].in_words == (
        "polite: 36 trials missed it first; delay = 0.6: all 36 failed; elsewhere none of 36 did, in these worlds only"
    )
    assert why.headline == (
        "with delay = 0.6, all 36 trials missed polite; elsewhere none of 36 did, in these worlds only"
    )


def test_copies_of_failures_are_counted_apart() -> None:
    """As half of those that did not pass are in no group, the line says where they are."""
    rows: list[Row] = [
        {"outcome": "failed" if each < 22 else "passed", "seed": each, "state_digest": str(each // 2)}
        for each in range(40)
    ]
    why = explain(table_of(rows))
    assert why is not None
    assert (why.failed, why.copies) == (11, 11)
    assert why.size == "11 of 20 trials failed (11 more are copies, not counted)"
    [line, *_] = why_in_lines(why)
    assert line.startswith("polite: 11 trials missed it first (11 more are copies, not counted); robomaker repro ")
    assert why.headline == "", "without axes, and in 1 world, no cause was looked for"
