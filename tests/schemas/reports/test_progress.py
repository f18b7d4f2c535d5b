"""Progress events in the words of a log."""

import pytest

from prefect_robomaker.schemas.reports.progress import StepEnded


@pytest.mark.parametrize(
    ("ended", "told"),
    [
        (StepEnded("drive", "Completed", 8.0, "arn:x", {"failed": 6}), "0 of 6 jobs passed: arn:x"),
        (StepEnded("drive", "TimedOut", 8.0, "too late", {"passed": 1}), "TimedOut, 1 of 1 job passed: too late"),
        (StepEnded("worlds", "Completed", 8.0, "arn:x"), "Completed: arn:x"),
        (StepEnded("later", "Skipped", 0.0), "Skipped"),
    ],
)
def test_a_step_with_jobs_is_logged_with_how_many_passed(ended: StepEnded, told: str) -> None:
    assert ended.in_log == told
