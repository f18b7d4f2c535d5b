from typing import Any

import pytest

from prefect_robomaker.tasks.reporting.outcomes import (
    Outcome,
    count_outcomes,
    headline,
    outcome_of,
    why_no_video_of_trial,
)


@pytest.mark.parametrize(
    ("status", "verdict", "expected"),
    [
        ("Completed", "PASS", Outcome.PASSED),
        ("Completed", "FAIL", Outcome.FAILED),
        ("Completed", "ERROR", Outcome.BROKEN),
        ("Completed", "NONE", Outcome.UNJUDGED),
        ("Completed", None, Outcome.UNJUDGED),
        # A verdict written before the crash is not trusted.
        ("Failed", "PASS", Outcome.BROKEN),
        ("Failed", None, Outcome.BROKEN),
        ("NotCreated", None, Outcome.BROKEN),
        ("Canceled", "FAIL", Outcome.CANCELED),
        ("Running", None, Outcome.UNFINISHED),
    ],
)
def test_outcome_follows_status_then_verdict(
    make_job: Any, make_result: Any, status: str, verdict: str | None, expected: Outcome
) -> None:
    result = make_result(verdict, 3) if verdict else None
    assert outcome_of(make_job("sim-1", None, status=status, result=result)) is expected


def test_a_request_that_was_cancelled_before_it_was_a_job_is_no_failure(make_job: Any) -> None:
    unmade = make_job("request 3", None, arn=None, status="NotCreated", failure_code="BatchCanceled")
    assert outcome_of(unmade) is Outcome.CANCELED
    assert outcome_of(unmade.model_copy(update={"failure_code": "BatchTimedOut"})) is Outcome.BROKEN


def test_counts_are_ordered_by_severity(mixed_report: Any) -> None:
    assert list(count_outcomes(mixed_report.jobs).items()) == [
        (Outcome.BROKEN, 1),
        (Outcome.FAILED, 1),
        (Outcome.CANCELED, 1),
        (Outcome.PASSED, 2),
    ]


def test_headline_counts_in_words(mixed_report: Any, make_report: Any, make_world: Any, make_job: Any) -> None:
    assert headline(mixed_report) == "2 of 5 jobs passed; 1 broken, 1 failed, 1 canceled"
    assert headline(make_report([], [])) == "Nothing was simulated"
    assert headline(make_report([make_world()], [])) == "No simulation jobs; 1 world"
    assert headline(make_report([], [make_job("sim-1", None)])) == "0 of 1 job passed; 1 no verdict"


@pytest.mark.parametrize(
    ("policy", "verdict", "words"),
    [
        ("none", "FAIL", "asks for none"),
        ("on-failure", "PASS", "did not fail"),
        ("on-failure", "FAIL", "as many as `record_failed` says"),
        ("always", "PASS", "none is stored"),
        ("on-failure", "", "none is stored"),
    ],
)
def test_a_recorded_trial_without_video_says_the_true_reason(policy: str, verdict: str, words: str) -> None:
    assert words in why_no_video_of_trial(policy, verdict)
