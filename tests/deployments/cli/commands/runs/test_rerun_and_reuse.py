"""Rerun and reuse, as users type them: what failed is run again, what is there already is not."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from helpers.batch_task_runs import task_runs
from helpers.cartpole_spec import PACKAGE, poles

from prefect_robomaker.schemas.reports.run_record import RunRecord

Robomaker = Callable[..., Any]


def job(seed: int, limit: str) -> str:
    """Members of a job; what takes half a second misses a time limit of 0.1 s."""
    return f"seed: {seed}\n          requirements: [{{name: rule, kind: time_limit, limit_s: {limit}}}]"


def jobs(*limits: str) -> str:
    """A specification with a job for each time limit."""
    return poles(*(job(seed, limit) for seed, limit in enumerate(limits, 1)))


@pytest.fixture
def package(tmp_path: Path) -> Path:
    """The folder that the example's package is imported from."""
    return shutil.copytree(PACKAGE, tmp_path / "package", ignore=shutil.ignore_patterns("__pycache__"))


@pytest.fixture
def robomaker(robomaker_at_server: Robomaker, package: Path, monkeypatch: pytest.MonkeyPatch) -> Robomaker:
    """Runs the command where the package can be imported: by itself, and by the processes that it starts."""
    monkeypatch.setenv("PYTHONPATH", str(package))
    monkeypatch.setenv("PYTHONDONTWRITEBYTECODE", "1")
    monkeypatch.syspath_prepend(str(package))
    return robomaker_at_server


@pytest.mark.deep
@pytest.mark.timeout(900)
def test_what_failed_is_run_again_and_what_is_there_is_taken_over(
    robomaker: Robomaker, package: Path, tmp_path: Path
) -> None:
    def record_of(ended: Any) -> RunRecord:
        return RunRecord.model_validate_json(ended.out)

    spec = tmp_path / "poles.yaml"
    spec.write_text(jobs("1", "0.1", "1"))
    first = record_of(robomaker("run", spec, "-o", "json"))
    assert [job.verdict for job in first.jobs] == ["PASS", "FAIL", "PASS"]

    rerun = robomaker("rerun", "latest", "--failed", "-o", "json")
    again = record_of(rerun)
    assert rerun.code == 1, rerun.err
    assert [job.verdict for job in again.jobs] == ["FAIL"], "one job, with the same seed and request"
    assert again.jobs[0].verdict_reason == first.jobs[1].verdict_reason
    assert again.jobs[0].earlier == f"{first.jobs[1].label}: FAIL"
    assert again.rerun_of is not None
    assert (again.rerun_of.run_id, again.rerun_of.jobs_total) == (first.run_id, 3)
    page = (again.run_dir / "report.html").read_text()
    assert f"{first.run_id}: 1 of 3 jobs (failed)" in page
    assert robomaker("report", again.run_id).code == 0
    assert (again.run_dir / "report.html").read_text() == page

    plan = json.loads(robomaker("plan", spec, "--reuse", "-o", "json").out)["steps"][2]["parts"]
    assert [(part["part"], part["reuse"]) for part in plan] == [(f"request {n}", True) for n in (1, 2, 3)]
    reused = robomaker("run", spec, "--reuse", "-o", "json")
    assert reused.code == 1, "a verdict of FAIL is what the same inputs give again"
    taken = record_of(reused)
    assert [job.reused_from for job in taken.jobs] == [first.run_id, again.run_id, first.run_id], "the newest of each"
    assert [job.metrics for job in taken.jobs] == [job.metrics for job in first.jobs]
    assert [job.output_uri for job in taken.jobs][::2] == [job.output_uri for job in first.jobs][::2]
    assert f"results taken over from <code>{first.run_id}</code>" in (taken.run_dir / "report.html").read_text()

    spec.write_text(jobs("1", "2", "1"))
    (package / "my_cartpole" / "more.py").write_text("# the package has changed\n")
    lines = robomaker("plan", spec, "--reuse").out
    assert "run    request 1: the robot application has changed; the simulation application has changed\n" in lines
    (package / "my_cartpole" / "more.py").unlink()
    lines = robomaker("plan", spec, "--reuse").out
    assert f"reuse  request 1: results of {first.run_id}" in lines
    assert "run    request 2: requirements[0].limit_s: 0.1 is now 2.0" in lines
    mixed = record_of(robomaker("run", spec, "--reuse", "-o", "json"))
    assert [bool(job.reused_from) for job in mixed.jobs] == [True, False, True]
    assert (mixed.state, [job.verdict for job in mixed.jobs]) == ("succeeded", ["PASS"] * 3)

    nothing = robomaker("rerun", mixed.run_dir, "--failed")
    assert (nothing.code, nothing.err) == (0, "")
    assert f"nothing to run again: no job of the run {mixed.run_id} is failed" in nothing.out
    for words, problem in [
        (("--job", "sim-none"), f"has no job 'sim-none'; it has {mixed.jobs[0].name} ({mixed.jobs[0].label})"),
        (("--world", "world-1"), "has no job in the world 'world-1'; its jobs have no worlds"),
    ]:
        refused = robomaker("rerun", "latest", *words)
        assert refused.code == 2
        assert problem in refused.err


@pytest.mark.endurance
@pytest.mark.timeout(900)
def test_more_requests_than_a_batch_may_have_are_one_step_of_several_batches(
    robomaker: Robomaker, tmp_path: Path, prefect_server: str
) -> None:
    spec = tmp_path / "poles.yaml"
    spec.write_text(jobs("1"))
    assert robomaker("run", spec, "-o", "json").code == 0
    spec.write_text(poles(*[job(1, "1")] * 1001))

    planned = json.loads(robomaker("plan", spec, "--reuse", "-o", "json").out)["steps"][2]["parts"]
    assert [part["reuse"] for part in planned] == [True] * 1001
    ended = robomaker("run", spec, "--reuse", "-o", "json")

    assert ended.code == 0, ended.err
    record = RunRecord.model_validate_json(ended.out)
    assert [step.name for step in record.steps][2:] == ["balance_1_of_2", "balance_2_of_2"]
    assert len(record.jobs) == 1001
    assert all(job.verdict == "PASS" and job.reused_from for job in record.jobs)
    one_of_the_second = record.jobs[1000].label
    again = robomaker("rerun", record.run_id, "--job", one_of_the_second, "-o", "json")
    assert again.code == 0, again.err
    assert [step.name for step in RunRecord.model_validate_json(again.out).steps] == ["balance_2_of_2"]

    spec.write_text(poles(*[job(1, "1")] * 998, job(2, "1"), job(3, "0.1"), job(4, "1")))
    mixed = robomaker("run", spec, "--reuse", "-o", "json")
    assert mixed.code == 1, mixed.err
    batches = [step.arn or "" for step in RunRecord.model_validate_json(mixed.out).steps][2:]
    assert [[(run.name, run.state and run.state.message) for run in task_runs(batch)] for batch in batches] == [
        [("simulate-request x 2", "1000 jobs: 999 passed, 1 failed")],
        [("simulate-request x 1", "1 job: 1 passed")],
    ]
