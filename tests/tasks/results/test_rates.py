from typing import Any

import pyarrow as pa
from helpers.night_records import digest, make_job
from hypothesis import assume, given
from hypothesis import strategies as st

from prefect_robomaker.schemas.reports.report import ReportedJob
from prefect_robomaker.schemas.reports.run_record import JobRecord
from prefect_robomaker.schemas.runs.plan import Requirement, RoomVisit, RunResult
from prefect_robomaker.tasks.results.rates import (
    by_requirement,
    by_room,
    by_world,
    counts_by,
    of_outcomes,
    of_table,
    share_of,
    wilson_interval,
)
from prefect_robomaker.tasks.results.table import ResultTable


@given(st.integers(0, 500), st.integers(0, 500), st.integers(0, 50))
def test_a_rate_lies_in_its_interval(passed: int, failed: int, errors: int) -> None:
    share = share_of("x", passed, failed, errors)
    if passed + failed == 0:
        assert (share.rate, share.low, share.high) == (None, None, None)
        return
    assert share.low is not None
    assert share.rate is not None
    assert share.high is not None
    assert share.rate == passed / (passed + failed)
    assert 0 <= share.low <= share.rate <= share.high <= 1
    # What broke says nothing about the robot.
    assert share.model_copy(update={"errors": 0}) == share_of("x", passed, failed)


@given(st.integers(0, 300), st.integers(0, 300), st.data())
def test_copies_widen_the_interval_and_leave_the_rate(passed: int, failed: int, data: st.DataObject) -> None:
    assume(passed + failed)
    copies = data.draw(st.integers(0, passed + failed - 1))
    all_of_them, share = share_of("", passed, failed), share_of("", passed, failed, copies=copies)
    assert share.copies == copies
    assert None not in (share.low, share.high, all_of_them.low, all_of_them.high)
    assert share.low <= all_of_them.low + 1e-12 <= share.rate + 1e-12 <= all_of_them.high + 2e-12 <= share.high + 3e-12  # type: ignore[operator]


def test_trials_that_went_through_the_same_states_are_copies() -> None:
    trials = [("a", "passed"), ("a", "passed"), ("b", "failed"), (None, "passed"), (None, "passed"), ("c", "broken")]
    columns = [{"outcome": outcome, "state_digest": states} for states, outcome in trials]
    table = pa.Table.from_pylist(columns)
    results = ResultTable(table.column_names, table.num_rows, table.column)
    assert of_table("", results).copies == 1
    assert of_table("", results, errors_fail=True).copies == 1
    with_copies, without = of_table("", results), share_of("", 3, 1)
    assert with_copies.rate == 0.8
    assert without.low is not None
    assert with_copies.low is not None
    assert with_copies.low < share_of("", 4, 1).low  # type: ignore[operator]


def test_copies_are_left_out_of_the_intervals_of_every_table() -> None:
    """Three jobs that went the same way were 3 trials of their world, and of their requirement."""
    made = [make_job(0, letter, world="a") for letter in "PPPF"]
    jobs = [job.model_copy(update={"state_digest": "s", "label": f"sim-{number}"}) for number, job in enumerate(made)]
    results = ResultTable.of(jobs)

    [world], [requirement], whole = by_world(results), by_requirement(results), of_table("", results)

    for share in (world, requirement, whole):
        assert (share.passed, share.failed, share.copies) == (3, 1, 2), share.name
        assert (share.low, share.high) == wilson_interval(1.5, 2)
        assert share.remark == "2 copies not counted"


def test_the_same_states_in_another_world_are_no_copy() -> None:
    """A robot that stands still goes through the same states in both."""
    jobs = [
        make_job(index, "P", world=name).model_copy(update={"state_digest": "s"}) for index, name in enumerate("ab")
    ]
    assert of_table("", ResultTable.of(jobs)).copies == 0


@given(st.integers(1, 300), st.data())
def test_more_of_the_same_says_more(trials: int, data: st.DataObject) -> None:
    passed = data.draw(st.integers(0, trials))
    few, many = share_of("", passed, trials - passed), share_of("", 4 * passed, 4 * (trials - passed))
    assert None not in (few.low, few.high, many.low, many.high)
    assert (many.high or 0) - (many.low or 0) < (few.high or 0) - (few.low or 0)


def test_what_failed_and_what_broke_are_counted_apart() -> None:
    jobs = [make_job(index, letter, world="a" if index < 3 else "b") for index, letter in enumerate("PFCPEN")]
    results = ResultTable.of(jobs)
    of_all, strict = of_table("", results), of_table("", results, errors_fail=True)
    assert (of_all.passed, of_all.failed, of_all.errors) == (2, 1, 1)
    assert (strict.passed, strict.failed, strict.errors) == (2, 2, 0)
    assert {name: (each.passed, each.failed, each.errors) for name, each in counts_by(results, "world").items()} == {
        digest("a"): (1, 1, 0), digest("b"): (1, 0, 1)
    }  # fmt: skip


def judged(index: int, **members: Any) -> JobRecord:
    requirement = Requirement(**{"name": "apart", "satisfied": True, "detail": "", **members})
    return make_job(index, "P").model_copy(update={"requirements": [requirement], "label": "abcd"[index]})


def test_requirements_are_counted_with_the_smallest_margin() -> None:
    jobs = [
        judged(0, margin=0.4, unit="m"),
        judged(1, margin=-0.1, unit="m", satisfied=False),
        judged(2, satisfied=False, error="no"),
        judged(3, satisfied=False, counts=False),
    ]
    (share,) = by_requirement(ResultTable.of(jobs))
    assert (share.passed, share.failed, share.errors, share.rate) == (1, 1, 1, 0.5)
    assert (share.worst_margin, share.unit, share.worst_job) == (-0.1, "m", "b")


def test_a_requirement_that_was_met_until_the_run_broke_is_no_judgement() -> None:
    met, missed = (Requirement(name="apart", satisfied=satisfied, detail="") for satisfied in (True, False))
    jobs = [
        make_job(index, letter).model_copy(update={"requirements": [requirement]})
        for index, (letter, requirement) in enumerate((("P", met), ("E", met), ("E", missed), ("F", missed)))
    ]
    [share] = by_requirement(ResultTable.of(jobs))
    assert (share.passed, share.failed, share.errors) == (1, 2, 0)


def test_a_missed_requirement_has_the_margin_of_a_miss_or_none() -> None:
    """The margin of a job that met it, 0.4 m, beside a miss without one would mislead."""
    jobs = [judged(0, margin=0.4, unit="m"), judged(1, satisfied=False)]
    [share] = by_requirement(ResultTable.of(jobs))
    assert (share.failed, share.worst_margin, share.unit) == (1, None, None)


def test_margins_of_different_units_are_not_compared() -> None:
    jobs = [judged(index, margin=0.4, unit=unit) for index, unit in enumerate(("m", "s"))]
    assert by_requirement(ResultTable.of(jobs))[0].worst_margin is None


def test_rooms_are_counted_by_name() -> None:
    def job(label: str, **visited: bool) -> ReportedJob:
        rooms = [RoomVisit(name=name, visited=seen) for name, seen in visited.items()]
        result = RunResult(verdict="PASS", sim_time_s=1, wall_time_s=1, real_time_factor=1, ended_by="agent", seed=1,
                           rooms=rooms)  # fmt: skip
        return ReportedJob(label=label, status="Completed", result=result)

    shares = by_room([job("a", Living=True, Closet=True), job("b", Living=True, Closet=False)])
    assert [(share.name, share.passed, share.failed) for share in shares] == [("Closet", 1, 1), ("Living", 2, 0)]


def test_no_jobs_no_rate() -> None:
    assert of_outcomes("", [], []).rate is None
    assert {of_table("", ResultTable.of([]), errors_fail=each).rate for each in (True, False)} == {None}
