"""Trials: many episodes in one job, each as a job with its seed alone would be."""

from collections.abc import Callable
from typing import Any

import pyarrow.parquet as pq
import pytest
from helpers.swing_fixtures import outputs_of

from prefect_robomaker.schemas.runs.plan import RunResult
from prefect_robomaker.schemas.runs.trial_rows import TrialsSummary
from prefect_robomaker.tasks.service.service import Service

Simulate = Callable[..., dict[str, Any]]
Row = dict[str, Any]


def rows_of(service: Service, job: dict[str, Any]) -> list[Row]:
    return pq.read_table(outputs_of(service, job) / "trials.parquet").to_pylist()


def result_of(service: Service, job: dict[str, Any]) -> RunResult:
    return RunResult.model_validate_json((outputs_of(service, job) / "result.json").read_bytes())


SOME_FAIL = {"LIMIT": "0.5", "TIME_LIMIT_S": "2"}


def test_some_trials_fail_and_the_job_says_which(service: Service, swing: Simulate) -> None:
    trials = {"seeds": 8, "record": [1], "record_failed": 2}
    job = swing(seed=3, job={"trials": trials}, **SOME_FAIL)

    rows, result = rows_of(service, job), result_of(service, job)
    assert job["status"] == "Completed"
    assert [row["trial"] for row in rows] == list(range(8))
    assert [row["seed"] for row in rows] == list(range(3, 11))
    failing = [row["trial"] for row in rows if row["verdict"] == "FAIL"]
    assert 2 < len(failing) < 8
    assert [row["trial"] for row in rows if not row["requirement.low"]] == failing
    summary = TrialsSummary.of(result)
    assert summary is not None
    assert [each.trial for each in summary.failing] == failing
    assert (summary.planned, summary.counts.total, summary.counts.failed) == (8, 8, len(failing))
    # The job is judged by its trials.
    assert result.verdict == "FAIL"
    named = ", ".join(map(str, failing))
    assert result.reason == f"trials: {len(failing)} of 8 trials did not pass: {named}"
    assert result.metrics["pass_rate"] == (8 - len(failing)) / 8
    assert service.catalog.get(job["arn"]).document["verdict"] == "FAIL"
    # Recorded are those that were asked for, and the first that failed.
    folder = outputs_of(service, job)
    recorded = sorted(int(path.name) for path in (folder / "trials").iterdir())
    assert recorded == sorted({1, *failing[:2]}) == summary.recorded
    assert [row["trial"] for row in rows if row["recorded"]] == recorded
    for number in recorded:
        again = RunResult.model_validate_json((folder / f"trials/{number:06d}/result.json").read_bytes())
        assert (again.state_digest, again.verdict) == (rows[number]["state_digest"], rows[number]["verdict"])
        assert (folder / f"trials/{number:06d}/recording.mcap").stat().st_size > 1000
    assert not (folder / "recording.mcap").exists()


@pytest.mark.parametrize("kept", [{}, {"CLOSED": "1"}], ids=["renewed", "made anew"])
def test_each_trial_has_the_states_that_a_job_with_its_seed_has(
    service: Service, swing: Simulate, kept: dict[str, str]
) -> None:
    alone = [
        result_of(service, swing(seed=seed, TIME_LIMIT_S=limit_s, **kept)) for limit_s in ("2", "3") for seed in (5, 6)
    ]

    trials = {"seeds": 2, "parameters": {"TIME_LIMIT_S": ["2", "3"]}}
    rows = rows_of(service, swing(seed=5, job={"trials": trials}, **kept))

    assert [row["state_digest"] for row in rows] == [result.state_digest for result in alone]
    assert len({row["state_digest"] for row in rows}) == 4
    assert [row["sim_time_s"] for row in rows] == [result.sim_time_s for result in alone]
    assert [row["parameter.TIME_LIMIT_S"] for row in rows] == ["2", "2", "3", "3"]
    if not kept:  # the other one does not say
        found = [row["metric.highest_rad"] for row in rows]
        assert found == [result.metrics["highest_rad"] for result in alone]
