from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from prefect_robomaker.schemas.reports.report import Report, ReportedJob
from prefect_robomaker.schemas.runs.plan import Requirement
from prefect_robomaker.tasks.reporting import summarize
from prefect_robomaker.tasks.reporting.shares import by_requirement, by_room, of_jobs, share_of


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


@given(st.integers(1, 300), st.data())
def test_more_of_the_same_says_more(trials: int, data: st.DataObject) -> None:
    passed = data.draw(st.integers(0, trials))
    few, many = share_of("", passed, trials - passed), share_of("", 4 * passed, 4 * (trials - passed))
    assert None not in (few.low, few.high, many.low, many.high)
    assert (many.high or 0) - (many.low or 0) < (few.high or 0) - (few.low or 0)


def test_what_failed_and_what_broke_are_counted_apart(mixed_report: Report) -> None:
    summary = summarize(mixed_report)
    assert summary.counts == {"broken": 1, "failed": 1, "canceled": 1, "passed": 2}
    assert (summary.success.passed, summary.success.failed, summary.success.errors) == (2, 1, 1)
    assert (summary.success_with_errors.passed, summary.success_with_errors.failed) == (2, 2)
    assert [(share.name, share.passed, share.failed, share.errors) for share in summary.worlds] == [
        ("generation-1/world-2", 1, 0, 1),
        ("generation-1/world-1", 1, 1, 0),
    ]


def _judged(job: ReportedJob, result: Any, **members: Any) -> ReportedJob:
    requirement = Requirement(**{"name": "apart", "satisfied": True, "detail": "", **members})
    return job.model_copy(update={"result": result.model_copy(update={"requirements": [requirement]})})


def test_requirements_are_counted_with_the_smallest_margin(make_job: Any, make_result: Any) -> None:
    result = make_result("PASS", 22)
    jobs = [
        _judged(make_job("a", None), result, margin=0.4, unit="m"),
        _judged(make_job("b", None), result, margin=-0.1, unit="m", satisfied=False),
        _judged(make_job("c", None), result, satisfied=False, error="no"),
        _judged(make_job("d", None), result, satisfied=False, counts=False),
    ]
    (share,) = by_requirement(jobs)
    assert (share.passed, share.failed, share.errors, share.rate) == (1, 1, 1, 0.5)
    assert (share.worst_margin, share.unit, share.worst_job) == (-0.1, "m", "b")


def test_margins_of_different_units_are_not_compared(make_job: Any, make_result: Any) -> None:
    result = make_result("PASS", 22)
    jobs = [_judged(make_job(unit, None), result, margin=0.4, unit=unit) for unit in ("m", "s")]
    assert by_requirement(jobs)[0].worst_margin is None


def test_rooms_are_counted_by_name(make_job: Any, make_result: Any) -> None:
    jobs = [make_job("a", None, result=make_result("PASS", 22)), make_job("b", None, result=make_result("FAIL", 4))]
    shares = {share.name: (share.passed, share.failed) for share in by_room(jobs)}
    assert shares["Living_Room"] == (2, 0)
    assert shares["Closet"][1] >= 1
    rates = [share.rate for share in by_room(jobs)]
    assert rates == sorted(rates)  # type: ignore[type-var]


@pytest.mark.parametrize("errors_fail", [True, False])
def test_no_jobs_no_rate(errors_fail: bool) -> None:
    assert of_jobs("", [], errors_fail=errors_fail).rate is None
