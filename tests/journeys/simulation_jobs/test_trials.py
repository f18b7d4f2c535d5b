"""Trials: many episodes in one job, each as a job with its seed alone would be."""

import re
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest
from helpers.job_worker_process import PerformElsewhere
from helpers.processes import wait_for, working_below
from helpers.swing_fixtures import outputs_of
from helpers.variable_axes import variables

from prefect_robomaker.schemas.runs.plan import RunResult
from prefect_robomaker.schemas.runs.programs import StopReason
from prefect_robomaker.schemas.runs.trial_rows import TrialsSummary
from prefect_robomaker.schemas.runs.trials import TrialCounts
from prefect_robomaker.schemas.wire.errors import ConfigurationError, InvalidParameterException
from prefect_robomaker.tasks.inspection.replays import reproduce_run, verify_run
from prefect_robomaker.tasks.inspection.reports import report_of_job
from prefect_robomaker.tasks.jobs.job_runs import perform_job
from prefect_robomaker.tasks.operations.registry import call, registry
from prefect_robomaker.tasks.operations.simulation_jobs import perform_simulation_job
from prefect_robomaker.tasks.runtime.episode.run_timeline import read_timeline
from prefect_robomaker.tasks.service.service import Progress, Service, Timing

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
    shown = report_of_job(job["arn"], service).jobs[0]
    assert shown.drawn_trial == failing[0], "the report draws the path of the first that did not pass"
    assert shown.drawn_result is not None
    assert shown.drawn_result.verdict == "FAIL"
    assert (summary.planned, summary.counts.total, summary.counts.failed) == (8, 8, len(failing))
    # The job is judged by its trials.
    assert result.verdict == "FAIL"
    count, named = len(failing), ", ".join(map(str, failing))
    assert result.reason == f"trials: {count} of 8 trials did not pass: trials {named}; missed: low in {count}"
    assert result.metrics["pass_rate"] == (8 - len(failing)) / 8
    assert service.catalog.get(job["arn"]).document["verdict"] == "FAIL"
    trials = {"passed": 8 - len(failing), "failed": len(failing), "errors": 0}
    told = {"verdict": "FAIL", "reason": result.reason, "trials": trials}
    assert call("DescribeSimulationJob", {"job": job["arn"]}, service)["verdict"] == told
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


def test_each_trial_says_what_it_says_once_and_a_recorded_one_in_logs_of_its_own(
    service: Service, swing: Simulate
) -> None:
    job = swing(job={"trials": {"seeds": 2, "record": [1]}}, TIME_LIMIT_S="0.2")
    folder = outputs_of(service, job)
    said = [(folder / name / "logs/stderr.log").read_text().count("squeaks") for name in ("", "trials/000001")]
    assert said == [2, 1]
    recorded = read_timeline((folder / "trials/000001/timeline.json").read_bytes())
    assert recorded is not None
    assert {each.name for each in recorded.logs} == {"logs/stdout.log", "logs/stderr.log"}


def test_a_stop_while_trials_are_recorded_is_said_in_the_log(service: Service, swing: Simulate) -> None:
    trials = {"seeds": 5, "record": [0, 1, 2, 3, 4]}
    job = swing(perform=False, job={"trials": trials}, TIME_LIMIT_S="40")
    folder = service.settings.home / "jobs" / job["arn"].rpartition("/")[2]

    def stop() -> StopReason | None:
        return StopReason.CANCELED if list(folder.glob("*/output/trials/000000")) else None

    perform_job(job["arn"], service, stop)
    log = (outputs_of(service, job) / "logs/stderr.log").read_text()
    assert "was recorded until the job was stopped (canceled)" in log
    assert re.search(r"not recorded, since the job was stopped \(canceled\): trials \d", log)


@pytest.mark.parametrize(
    "kept", [{}, pytest.param({"CLOSED": "1"}, marks=pytest.mark.deep)], ids=["renewed", "made anew"]
)
def test_each_trial_has_the_states_that_a_job_with_its_seed_has(
    service: Service, swing: Simulate, kept: dict[str, str]
) -> None:
    alone = [
        result_of(service, swing(seed=seed, TIME_LIMIT_S=limit_s, **kept)) for limit_s in ("2", "3") for seed in (5, 6)
    ]

    trials = {"seeds": 2, "axes": variables({"TIME_LIMIT_S": ["2", "3"]})}
    rows = rows_of(service, swing(seed=5, job={"trials": trials}, **kept))

    assert [row["state_digest"] for row in rows] == [result.state_digest for result in alone]
    assert len({row["state_digest"] for row in rows}) == 4
    assert [row["sim_time_s"] for row in rows] == [result.sim_time_s for result in alone]
    assert [row["axis.TIME_LIMIT_S"] for row in rows] == ["2", "2", "3", "3"]
    if not kept:  # the other one does not say
        found = [row["metric.highest_rad"] for row in rows]
        assert found == [result.metrics["highest_rad"] for result in alone]


def test_any_trial_is_verified(service: Service, swing: Simulate) -> None:
    job = swing(seed=3, job={"trials": {"seeds": 2, "axes": variables({"LIMIT": ["0", "9"]})}}, TIME_LIMIT_S="0.5")
    rows = rows_of(service, job)

    answer = verify_run(job["arn"], service, trial=3)

    assert [row["verdict"] for row in rows] == ["FAIL", "FAIL", "PASS", "PASS"]
    assert (answer.answer, answer.trial) == ("bit-identical", 3)
    assert answer.digest == answer.digest_again == rows[3]["state_digest"]
    kept = outputs_of(service, job) / "trials/000000"
    assert verify_run(str(kept), service).digest == rows[0]["state_digest"]


@pytest.mark.deep
def test_any_trial_is_verified_and_taken_apart_by_itself(service: Service, swing: Simulate, tmp_path: Path) -> None:
    job = swing(seed=3, job={"trials": {"seeds": 6, "axes": variables({"LIMIT": ["0.5", "9"]})}}, TIME_LIMIT_S="2")
    rows = rows_of(service, job)
    failing = next(row["trial"] for row in rows if row["verdict"] == "FAIL")

    for number in (failing, 11):
        answer = verify_run(job["arn"], service, trial=number)
        assert (answer.answer, answer.trial) == ("bit-identical", number)
        assert answer.digest == answer.digest_again == rows[number]["state_digest"]
    assert verify_run(str(outputs_of(service, job)), service, trial=0).answer == "bit-identical"
    kept = outputs_of(service, job) / f"trials/{failing:06d}"
    assert verify_run(str(kept), service).digest == rows[failing]["state_digest"]

    made = reproduce_run(job["arn"], tmp_path / "repro", service, "none", trial=failing)
    assert (made.ending, made.same_ending) == ("ended with verdict FAIL (low)", True)
    test = next((tmp_path / "repro").glob("test_repro_*.py"))
    repeated = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", test], cwd=tmp_path, capture_output=True
    )
    assert b"2 passed" in repeated.stdout, repeated.stdout.decode()


def test_chance_that_no_seed_repeats_shows_in_its_trial(service: Service, swing: Simulate) -> None:
    axes = variables({"DRIFT_AT": ["-1", "60"]})
    job = swing(job={"trials": {"seeds": 1, "axes": axes}})
    assert verify_run(job["arn"], service, trial=0).answer == "bit-identical"
    answer = verify_run(job["arn"], service, trial=1)
    assert str(answer).startswith("diverged at t=4.000 s or before: of a trial only the digest")


def test_what_is_no_trial_is_said(service: Service, swing: Simulate) -> None:
    job, alone = swing(job={"trials": {"seeds": 2}}, TIME_LIMIT_S="0.1"), swing(TIME_LIMIT_S="0.1")
    for reference, trial, said in (
        (job, 2, "--trial 2: there is no trial 2; the trials are 0 to 1"),
        (alone, 0, "has no trials; leave --trial out"),
    ):
        with pytest.raises(ConfigurationError, match=said):
            verify_run(reference["arn"], service, trial=trial)


@pytest.mark.parametrize(
    ("variable", "said"),
    [
        ("FAIL_AT", "the rope broke, in step 30, at 0.580 s simulated, in trial 3 (seed 3, FAIL_AT=30)"),
        pytest.param("ABORT_AT", "killed by SIGABRT in trial 3", marks=pytest.mark.deep),
    ],
)
def test_a_crash_leaves_the_rows_before_it_and_says_where_it_was(
    service: Service, swing: Simulate, variable: str, said: str
) -> None:
    trials = {"seeds": 3, "axes": variables({variable: ["-1", "30"]})}
    job = swing(seed=3, job={"trials": trials}, TIME_LIMIT_S="2")

    assert (job["status"], job["failureCode"]) == ("Failed", "SimulationApplicationCrash")
    assert said in job["failureReason"]
    assert [row["trial"] for row in rows_of(service, job)] == [0, 1, 2]
    assert not (outputs_of(service, job) / "result.json").exists()
    assert verify_run(job["arn"], service, trial=2).answer == "bit-identical"
    [reason] = verify_run(job["arn"], service, trial=3).reasons
    assert "no states" in reason
    with pytest.raises(ConfigurationError, match=r"trial 4 of .* has not finished"):
        verify_run(job["arn"], service, trial=4)


def test_a_trial_that_crashed_is_taken_apart(service: Service, swing: Simulate, tmp_path: Path) -> None:
    job = swing(seed=3, job={"trials": {"seeds": 2, "axes": variables({"FAIL_AT": ["-1", "30"]})}}, TIME_LIMIT_S="2")
    made = reproduce_run(job["arn"], tmp_path / "repro", service, "none", trial=2)
    assert (made.ending, made.same_ending) == ("failed with SimulationApplicationCrash", True)


def test_with_continue_a_crash_is_the_error_of_its_trial(service: Service, swing: Simulate) -> None:
    trials = {"seeds": 2, "axes": variables({"FAIL_AT": ["-1", "30", "-2"]})}
    job = swing(job={"trials": trials, "failureBehavior": "Continue"}, TIME_LIMIT_S="2")

    assert job["status"] == "Completed"
    rows, result = rows_of(service, job), result_of(service, job)
    assert [row["verdict"] for row in rows] == ["PASS", "PASS", "ERROR", "ERROR", "PASS", "PASS"]
    assert rows[2]["reason"].startswith("RuntimeError: the rope broke")
    assert rows[2]["failure_code"] == "SimulationApplicationCrash"
    assert result.verdict == "ERROR"
    told = "trials: 2 of 6 trials did not pass: trials 2, 3; 2 broke, first trial 2: RuntimeError: the rope broke"
    assert (result.reason or "").startswith(told)
    # What follows a crash begins as if there had been none.
    assert [row["state_digest"] for row in rows[4:]] == [row["state_digest"] for row in rows[:2]]
    assert (outputs_of(service, job) / "trials/000002/recording.mcap").exists()


def test_the_time_limit_ends_the_job_in_a_trial(service: Service, swing: Simulate) -> None:
    job = swing(duration_s=2, job={"trials": {"seeds": 1000}}, TIME_LIMIT_S="0.5", SLEEP_S="0.004")

    rows, result = rows_of(service, job), result_of(service, job)
    assert job["status"] == "Completed"
    assert 0 < len(rows) < 1000
    assert (result.verdict, result.ended_by) == ("ERROR", "duration limit")
    assert result.reason == f"trials: none of {len(rows)} trials failed; stopped in trial {len(rows)} of 1000"
    assert [row["trial"] for row in rows] == list(range(len(rows)))


def test_trials_of_programs_are_refused(swing: Simulate) -> None:
    with pytest.raises(
        InvalidParameterException, match=r"trials: robotApplications\[0\]\.launchConfig\.command launches"
    ):
        swing(robot={"launchConfig": {"command": ["sleep", "1"]}}, job={"trials": {"seeds": 2}})


@pytest.mark.deep
def test_a_job_whose_worker_was_killed_goes_on_after_the_trials_that_had_finished(
    service: Service, swing: Simulate, perform_elsewhere: PerformElsewhere
) -> None:
    trials = {"seeds": 60}
    whole = rows_of(service, swing(job={"trials": trials}, TIME_LIMIT_S="1"))
    job = swing(job={"trials": trials}, perform=False, TIME_LIMIT_S="1", SLEEP_S="0.005")
    folder = service.settings.home / "jobs" / job["name"]

    def finished() -> int:
        return sum(path.read_bytes().count(b"\n") for path in folder.glob("*/checkpoints/trials.jsonl"))

    with perform_elsewhere(job["arn"]) as worker:
        wait_for(lambda: [*folder.glob("*/checkpoints/checkpoint-*.bin")] and finished() >= 10, "some trials")
        worker.kill()
        worker.wait()
        before = finished()
    wait_for(lambda: not working_below(service.settings.home), "the run to die with its job worker")
    perform_job(job["arn"], replace(service, timing=Timing(lease_s=2.0, renew_lease_every_s=0.3)))

    assert 10 <= before < 60
    document = service.catalog.get(job["arn"]).document
    assert (document["attempts"], document["verdict"]) == (2, "PASS")
    rows = rows_of(service, job)
    assert [row["state_digest"] for row in rows] == [row["state_digest"] for row in whole]
    begun = (outputs_of(service, job) / "logs" / "stdout.log").read_text().count("agent begins")
    # Each was begun once, but for the one that was cut off.
    assert begun <= 61


def test_progress_counts_trials(service: Service, swing: Simulate) -> None:
    told: list[Progress] = []
    job = swing(perform=False, job={"trials": {"seeds": 40}}, TIME_LIMIT_S="0.2", SLEEP_S="0.02")
    perform_simulation_job(job["arn"], service.watched_by(told.append))

    finished = [each.trials.finished for each in told if each.trials is not None]
    assert len(finished) > 1
    assert finished == sorted(finished)
    assert {each.trials.total for each in told if each.trials is not None} == {40}
    assert (told[-1].counts, told[-1].total) == ({"passed": 1}, 1)
    assert service.catalog.get(job["arn"]).document["trialsFinished"] == finished[-1]


@pytest.mark.deep
def test_progress_names_the_trial_that_is_recorded_again(service: Service, swing: Simulate) -> None:
    told: list[Progress] = []
    trials = {"seeds": 2, "record": [0, 1]}
    # A trial takes about four seconds, twice as long as it may take until one is told.
    job = swing(perform=False, job={"trials": trials}, TIME_LIMIT_S="0.5", SLEEP_S="0.08")
    perform_simulation_job(job["arn"], service.watched_by(told.append))

    recorded = [each.trials for each in told if each.trials and each.trials.to_record]
    assert {each.to_record for each in recorded} == {2}
    assert [each.recorded for each in recorded] == sorted(each.recorded for each in recorded)
    assert f"records trial 1 of job {job['name']}" in {each.recording for each in recorded}
    stored = service.catalog.get(job["arn"]).document["trialsRecorded"]
    assert stored["total"] == 2


@pytest.mark.deep
def test_progress_of_a_batch_counts_the_trials_of_its_jobs(
    service: Service, swing: Simulate, prefect_server: str
) -> None:
    told: list[Progress] = []
    job = swing(perform=False, job={"trials": {"seeds": 40}}, TIME_LIMIT_S="0.2", SLEEP_S="0.02")
    requests = [service.catalog.get(job["arn"]).document["request"]]
    batch = call("StartSimulationJobBatch", {"createSimulationJobRequests": requests}, service)
    registry()["StartSimulationJobBatch"].perform(batch["arn"], service.watched_by(told.append))

    finished = [progress.trials.finished for progress in told if progress.trials]
    assert finished == sorted(finished)
    assert any(0 < each < 40 for each in finished)
    assert told[-1].trials == TrialCounts(40, 40)


def test_a_job_that_was_killed_from_outside_goes_on_in_the_trial_it_was_in(service: Service, swing: Simulate) -> None:
    trials = {"seeds": 5, "axes": variables({"KILL_AT": ["-1", "30"]})}
    job = swing(job={"trials": trials}, TIME_LIMIT_S="1", SLEEP_S="0.005")

    rows = rows_of(service, job)
    document = service.catalog.get(job["arn"]).document
    assert (job["status"], document["attempts"], len(rows)) == ("Completed", 2, 10)
    digests = [row["state_digest"] for row in rows]
    assert digests[:5] == digests[5:]
    assert (outputs_of(service, job) / "logs" / "stdout.log").read_text().count("agent begins") == 11


def test_secret_axes_are_in_nothing_that_a_job_leaves(service: Service, swing: Simulate) -> None:
    values = ["hunter2-a", "hunter2-b"]
    trials = {"seeds": 1, "axes": variables({"X_TOKEN": values}), "record": [0, 1]}

    job = swing(seed=3, job={"trials": trials}, **SOME_FAIL)

    rows = rows_of(service, job)
    assert [row["axis.X_TOKEN"] for row in rows] == ["(secret)", "(secret 2)"]
    summary = TrialsSummary.of(result_of(service, job))
    assert summary is not None
    assert [each.axes["X_TOKEN"] for each in summary.cells] == ["(secret)", "(secret 2)"]
    left = [path for path in outputs_of(service, job).rglob("*") if path.is_file()]
    assert len([path for path in left if path.name == "provenance.json"]) == 3
    assert [path.name for path in left if any(value.encode() in path.read_bytes() for value in values)] == []
