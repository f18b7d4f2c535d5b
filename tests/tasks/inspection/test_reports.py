"""Short records of jobs: what of a result they have."""

from typing import Any

import pytest

from prefect_robomaker.schemas.reports.report import ReportedJob
from prefect_robomaker.schemas.runs.plan import ENVIRONMENT_VERDICT, Requirement, RunResult
from prefect_robomaker.schemas.runs.trial_rows import SUMMARY_NAME
from prefect_robomaker.tasks.inspection.reports import job_records
from prefect_robomaker.tasks.service.service import Service


@pytest.mark.parametrize(
    ("extra", "besides"),
    [
        ({}, False),
        ({ENVIRONMENT_VERDICT: "FAIL"}, True),
        ({SUMMARY_NAME: {"planned": 3, "counts": {"passed": 1, "failed": 2}}}, False),
        ({SUMMARY_NAME: {"planned": 3, "counts": {"passed": 1, "failed": 1, "errors": 1}}}, True),
        ({SUMMARY_NAME: {"planned": 3, "counts": {"passed": 1, "failed": 1, "unjudged": 1}}}, True),
        ({SUMMARY_NAME: {"planned": 3, "counts": {"failed": 1}, "stopped_in": 1}}, True),
    ],
)
def test_a_failure_for_more_than_requirements_is_told(service: Service, extra: dict[str, Any], besides: bool) -> None:
    missed = Requirement(name="trials", satisfied=False, detail="1 of 3 trials did not pass")
    result = RunResult(
        verdict="FAIL", requirements=[missed], extra=extra, sim_time_s=1.0, wall_time_s=1.0, real_time_factor=1.0,
        ended_by="environment", seed=1,
    )  # fmt: skip
    (record,) = job_records([ReportedJob(label="sim-1", status="Completed", result=result)], {}, service)
    assert record.unnamed_failure == besides
