"""Forecasts in lines."""

from datetime import UTC, datetime
from typing import Any

import pytest

from prefect_robomaker.deployments.cli.output.forecast import forecast_lines, size
from prefect_robomaker.schemas.reports.forecast import Forecast, Places, ProbedJob, StepForecast


def forecast(**changes: Any) -> Forecast:
    quick = StepForecast(
        step="template", operation="CreateWorldTemplate", parts=0, concurrency=1, start_s=0.7, wall_time_s=0.7,
        cpu_time_s=0.0, size_bytes=0,
    )  # fmt: skip
    drive = StepForecast(
        step="drive", operation="StartSimulationJobBatch", parts=20, concurrency=4, start_s=4.2, wall_time_s=3600.0,
        cpu_time_s=5400.0, size_bytes=18_620_000,
    )  # fmt: skip
    values: dict[str, Any] = {
        "name": "night",
        "made_at": datetime(2026, 3, 1, tzinfo=UTC),
        "backend": "dask:tcp://head:8786",
        "places": Places(machines=2, jobs_per_machine=2, cpus=2),
        "steps": [quick, drive],
        "wall_time_s": 3600.7,
        "cpu_time_s": 5400.0,
        "size_bytes": 18_620_000,
        "price_per_hour": 0.5,
        "cost": 1.0002,
        "assumed": ["all 20 jobs take as long as the 2 that ran"],
        "probes": ["night-probe-1"],
    }
    return Forecast.model_validate(values | changes)


def test_what_a_reader_wants_to_know_comes_first() -> None:
    assert forecast_lines(forecast()) == [
        "forecast for 2 machines, backend dask:tcp://head:8786:",
        "  wall time  1 h",
        "  CPU        1.5 hours",
        "  outputs    18.6 MB",
        "  cost       1.0002, at 0.5 for an hour of a machine",
        "",
        "  template  0.7 s",
        "  drive     1 h: 20, 4 at a time, 4.2 s of it start and end",
        "",
        "  assumed: all 20 jobs take as long as the 2 that ran",
        "  measured: night-probe-1",
    ]


def test_what_does_not_finish_in_time_and_what_the_probe_found_is_said() -> None:
    [quick, drive] = forecast().steps
    late = {"timeout_s": 600.0, "longest_batch_s": 3600.0, "over_limit": 3, "job_s": 90.0, "job_limit_s": 60.0}
    ran = [
        ProbedJob(job="sim-1", verdict="PASS", trials=4, trials_passed=4),
        ProbedJob(job="sim-2", verdict="FAIL", reason="quick: late\nmore", trials=4, trials_passed=1),
        ProbedJob(job="sim-3", verdict="NONE"),
    ]

    lines = forecast_lines(forecast(steps=[quick, drive.model_copy(update=late)], ran=ran))

    assert lines[8:16] == [
        "",
        "  warning: drive: its batch takes 1 h and is ended after 10 min (batchPolicy.timeoutInSeconds is 600); "
        "jobs that have not finished by then fail",
        "  warning: drive: 3 jobs are ended by the limit (maxJobDurationInSeconds is 60); about 1 min 30 s would be "
        "right",
        "",
        "  ran: 3 jobs: 1 PASS, 1 FAIL, 1 NONE",
        "    sim-2 FAIL, 1 of 4 trials passed: quick: late",
        "    sim-3 NONE",
        "",
    ]
    cut = drive.model_copy(update={"over_limit": 1, "job_s": 60.5, "job_limit_s": 60.0})
    [warning] = [line for line in forecast_lines(forecast(steps=[cut])) if "warning" in line]
    assert warning == (
        "  warning: drive: 1 job is ended by the limit (maxJobDurationInSeconds is 60); more would be right"
    )
    in_time = drive.model_copy(update={"timeout_s": 3600.0, "longest_batch_s": 3600.0})
    assert not any("warning" in line for line in forecast_lines(forecast(steps=[in_time])))


def test_what_is_not_known_is_left_out_or_said() -> None:
    lines = forecast_lines(forecast(cpu_time_s=None, price_per_hour=None, cost=None, assumed=[]))
    assert "  CPU        not known" in lines
    assert not any("cost" in line or "assumed" in line for line in lines)


@pytest.mark.parametrize(
    ("size_bytes", "said"), [(0, "0 bytes"), (999, "999 bytes"), (1500, "1.5 kB"), (2 * 10**12, "2 TB")]
)
def test_sizes(size_bytes: int, said: str) -> None:
    assert size(size_bytes) == said
