"""The block that ends a run."""

import json
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest

from prefect_robomaker.deployments.cli.output.summary import summary_lines
from prefect_robomaker.schemas.reports.forecast import ForecastCheck
from prefect_robomaker.schemas.reports.live_comparison import AgainstAnswer
from prefect_robomaker.schemas.reports.run_record import JobRecord, RunRecord, StepRecord
from prefect_robomaker.schemas.runs.plan import Requirement


def record(**changes: Any) -> RunRecord:
    began = datetime(2026, 1, 2, 3, 4, 5, tzinfo=UTC)
    jobs = [
        JobRecord(
            label="sim-1", variant="SPEED=1", arn="arn:1", status="Completed", verdict="PASS", world="g/world-1",
            rooms_visited=4, rooms_total=4, duration_s=31, output_uri="file:///store/robomaker/quickstart/sim-1/run-1",
        ),
        JobRecord(
            label="sim-2", variant="SPEED=2", arn="arn:2", status="Failed", failure_code="RobotApplicationCrash",
            failure_reason="it crashed\nLast lines of logs/stderr.log:\nTraceback\nno x", output_uri="file:///store/robomaker/quickstart/sim-2/run-1",
        ),
        JobRecord(label="request 3", status="NotCreated", failure_code="InvalidInput", failure_reason="no role"),
    ]  # fmt: skip
    values: dict[str, Any] = {
        "run_id": "night-1",
        "name": "night",
        "spec_path": "night.yaml",
        "state": "broken",
        "exit_code": 3,
        "started_at": began,
        "ended_at": began + timedelta(seconds=185),
        "steps": [StepRecord(name="export", operation="CreateWorldExportJob", status="Failed", error="no bucket")],
        "jobs": jobs,
        "report_path": Path("/runs/night-1/report.html"),
        "run_dir": Path("/runs/night-1"),
    }
    return RunRecord.model_validate(values | changes)


def lines(shown: RunRecord) -> list[str]:
    command = ["robomaker", "run", "my spec.yaml"]
    return ["".join(text for text, _ in line) for line in summary_lines(shown, command)]


def test_what_jobs_had_to_do_without_is_said_once() -> None:
    wish = "no camera in the recording: ROBOMAKER_RECORD_CAMERA: there is no camera 'frnt'"
    first, second, third = record().jobs
    jobs = [first.model_copy(update={"remarks": [wish, "no video: no driver"]}), second, third]
    assert lines(record(jobs=jobs))[9:12] == [f"  sim-1: {wish}", "  sim-1: no video: no driver", ""]
    jobs[1] = second.model_copy(update={"remarks": [wish]})
    assert lines(record(jobs=jobs))[9:12] == [f"  2 jobs: {wish}", "  sim-1: no video: no driver", ""]


def test_the_trial_with_the_smallest_margin_of_all_jobs_is_named_with_its_command() -> None:
    """Not of requirements that a trial missed, whose reason names it, nor of the environment's own."""
    polite = Requirement(
        name="polite", kind="clearance", satisfied=True, detail="met", margin=0.0288, unit="m", trial=24
    )
    near = polite.model_copy(update={"margin": 0.3, "trial": 3})
    own = polite.model_copy(update={"name": "upright", "kind": None})
    late = polite.model_copy(update={"name": "late", "satisfied": False})
    jobs = [
        JobRecord(label=f"sim-{place}", status="Completed", verdict="PASS", requirements=[each, own, late])
        for place, each in enumerate((near, polite))
    ]
    assert [line for line in lines(record(jobs=jobs)) if "margin" in line] == [
        "  polite: smallest margin 0.029 m, trial 24: robomaker repro sim-1 --trial 24"
    ]


@pytest.mark.parametrize(
    "other",
    [
        {"status": "Canceled", "verdict": None},
        {"status": "Failed", "verdict": "PASS", "failure_code": "RobotApplicationCrash"},
        {"verdict": "ERROR"},
        {"verdict": "NONE"},
        {"verdict": "FAIL", "unnamed_failure": True},
    ],
)
def test_no_smallest_margin_is_told_where_some_trials_were_not_judged(other: dict[str, Any]) -> None:
    polite = Requirement(name="polite", kind="clearance", satisfied=True, detail="met", margin=0.3, unit="m", trial=2)
    late = Requirement(name="late", satisfied=False, detail="missed in 1 of 3", trial=1)
    own = Requirement(name="trials", satisfied=False, detail="1 of 3 trials did not pass")
    job = JobRecord(label="sim-1", status="Completed", verdict="FAIL", requirements=[own, polite, late])

    def told(*jobs: JobRecord) -> bool:
        return any("smallest margin" in line for line in lines(record(jobs=[*jobs])))

    assert told(job)
    assert not told(job, job.model_copy(update=other)), "it may have had a smaller one"


def test_a_verdict_counts_only_when_the_job_ended_by_itself() -> None:
    first, second, third = record().jobs
    shown = record(jobs=[first, second.model_copy(update={"verdict": "PASS"}), third])
    assert lines(shown)[1] == "night: broken, 1 of 3 jobs passed, 2 broke, after 3 min 05 s"


def test_the_final_block_leads_to_the_page_in_the_console() -> None:
    page = "http://127.0.0.1:8057/console/runs/night-1"
    shown = summary_lines(record(), ["robomaker", "run", "spec.yaml"], page=page)

    assert f"  console  {page}" in ["".join(text for text, _ in line) for line in shown]


def test_the_final_block() -> None:
    assert lines(record()) == [
        "",
        "night: broken, 1 of 3 jobs passed, 2 broke, after 3 min 05 s",
        "",
        "  ✗ export (CreateWorldExportJob): no bucket",
        "",
        "  #  job        verdict     world      setting  rooms  wall time",
        "  1  sim-1      PASS        g/world-1  SPEED=1  4/4    31 s",
        "  2  sim-2      Failed                 SPEED=2                    "
        "RobotApplicationCrash: it crashed; its log ends with: no x",
        "  3  request 3  NotCreated                                        InvalidInput: no role",
        "",
        "  report   /runs/night-1/report.html",
        "  outputs  file:///store/robomaker/quickstart",
        "  record   /runs/night-1/run.json",
        "  again    robomaker run 'my spec.yaml'",
    ]


def test_jobs_are_shown_by_name_with_the_id_beside() -> None:
    first, second, third = record().jobs
    jobs = [
        first.model_copy(update={"name": "scout in flat 1, SPEED=1", "world_name": "flat 1", "sim_time_s": 95.0}),
        second.model_copy(update={"name": "scout in flat 1, SPEED=2", "remarks": ["no video: no driver"]}),
        third.model_copy(update={"name": "scout in flat 2"}),
    ]
    assert lines(record(jobs=jobs))[5:10] == [
        "  #  job                       verdict     rooms  simulated   wall time  id",
        "  1  scout in flat 1, SPEED=1  PASS        4/4    1 min 35 s  31 s       sim-1",
        "  2  scout in flat 1, SPEED=2  Failed                                    sim-2      "
        "RobotApplicationCrash: it crashed; its log ends with: no x",
        "  3  scout in flat 2           NotCreated                                request 3  InvalidInput: no role",
        "  scout in flat 1, SPEED=2: no video: no driver",
    ]


def test_what_the_last_line_of_a_log_repeats_is_said_once() -> None:
    reason = "robot.yaml:7:13: no 'lef'"
    log = f"{reason}\nLast lines of logs/stderr.log:\n  File x\nLaunchError: {reason}"
    jobs = [record().jobs[1].model_copy(update={"failure_reason": log})]
    assert next(line for line in lines(record(jobs=jobs)) if "robot.yaml" in line).endswith(f"Crash: {reason}")
    steps = [record().steps[0].model_copy(update={"error": log})]
    assert next(line for line in lines(record(steps=steps)) if "✗" in line).endswith(f"): {reason}")
    whole = f"Robot application rover has no robot that can be used: {reason}"
    jobs = [jobs[0].model_copy(update={"failure_reason": log.replace(reason, whole, 1)})]
    assert next(line for line in lines(record(jobs=jobs)) if "robot.yaml" in line).endswith(f"Crash: {whole}")


def test_a_run_that_was_forecast_says_how_far_off_that_was() -> None:
    check = ForecastCheck(made_at=datetime(2026, 1, 1, tzinfo=UTC), forecast_s=171.3, took_s=185.0)
    assert lines(record(forecast=check))[1:3] == [
        "night: broken, 1 of 3 jobs passed, 2 broke, after 3 min 05 s",
        "forecast 2 min 51 s, took 3 min 05 s (8 % more)",
    ]


def test_the_final_block_of_a_run_without_jobs() -> None:
    shown = lines(record(jobs=[], steps=[], state="succeeded", exit_code=0))
    assert shown[1] == "night: succeeded after 3 min 05 s"
    assert not any("outputs" in line or "verdict" in line for line in shown)


def test_a_run_that_made_worlds_says_how_to_look_at_them() -> None:
    arn = "arn:aws:robomaker:us-east-1:000000000000:world-generation-job/generation-82856b0yq33y"
    made = {"finishedWorldsSummary": {"finishedCount": 1, "succeededWorlds": ["arn:w"]}}
    step = StepRecord(name="worlds", operation="CreateWorldGenerationJob", status="Completed", arn=arn, output=made)
    shown = "  worlds   robomaker world sheet generation-82856b0yq33y"

    assert shown in lines(record(steps=[step]))
    assert shown not in lines(record(steps=[step.model_copy(update={"output": {}})]))


def test_what_was_cut_short_has_no_verdict_and_long_reasons_are_cut() -> None:
    jobs = [
        JobRecord(label="sim-1", status="Canceled", verdict="NONE"),
        JobRecord(label="sim-2", status="Failed", failure_reason="it crashed: KeyError\nLast lines of x:\nKeyError"),
        JobRecord(label="sim-3", status="Failed", failure_reason="x" * 1000),
    ]
    shown = lines(record(jobs=jobs, steps=[]))
    assert shown[1] == "night: broken, 0 of 3 jobs passed, 2 broke, 1 canceled, after 3 min 05 s"
    assert [line.split() for line in shown[4:6]] == [
        ["1", "sim-1", "Canceled"],
        ["2", "sim-2", "Failed", "it", "crashed:", "KeyError"],
    ]
    assert shown[6].endswith("xxx … (cut here; the report has all of it)")
    assert len(shown[6]) < 600


@pytest.mark.parametrize(
    ("stopped_early", "said"),
    [
        (True, "18 jobs were not needed: it was decided before"),
        (False, "18 jobs were not started: the batch was canceled before"),
    ],
)
def test_jobs_that_never_began_are_one_line(stopped_early: bool, said: str) -> None:
    answer = AgainstAnswer(
        run_id="night-0", alpha=0.05, answer="better", why="decided after 8 of 30 pairs", pairs=8, planned=30,
        stopped_early=stopped_early,
    )  # fmt: skip
    why = "the batch ended before a job was made of this request"
    unmade = [
        JobRecord(label=f"request {each}", status="NotCreated", failure_code="BatchCanceled", failure_reason=why)
        for each in range(2, 20)
    ]
    jobs = [JobRecord(label="sim-1", arn="arn:1", status="Completed", verdict="PASS"), *unmade]
    shown = lines(record(jobs=jobs, steps=[], against=answer))
    assert said in [line.strip() for line in shown]
    assert not [line for line in shown if "request " in line or why in line]
    assert said in [line.strip() for line in lines(record(jobs=unmade, steps=[], against=answer))]


def test_a_long_reason_loses_its_end_after_a_word_and_keeps_what_its_log_says() -> None:
    """The middle was left out, and with it what to do: `11 would do, which takes 132 trials instead…of 36`."""
    reason = f"{'too few trials to tell ' * 30}\nLast lines of logs/stderr.log:\nIn file:\nKeyError: 'door'"
    shown = lines(record(jobs=[JobRecord(label="sim-1", status="Failed", failure_reason=reason)], steps=[]))[4]
    before, _, after = shown.partition(" …; its log ends with: ")
    assert before.endswith(("too", "few", "trials", "to", "tell"))
    assert after == "KeyError: 'door' (cut here; the report has all of it)"


def test_a_crash_names_the_joint_however_long_the_words_before_are() -> None:
    reason = (
        "Simulation application trouble failed in environment.step(): dm_control.rl.control.PhysicsError: Physics "
        "state is invalid. Warning(s) raised: mjWARN_BADQPOS, in step 10, at 0.018 s simulated, bad numbers at joint "
        "'wrist_hinge' of body 'wrist' (engine.py, line 366)\nLast lines of logs/stderr.log:\n    self.physics.step()"
    )
    job = JobRecord(label="sim-1", status="Failed", failure_code="SimulationApplicationCrash", failure_reason=reason)

    shown = lines(record(jobs=[job], steps=[]))[4]

    assert "SimulationApplicationCrash: Simulation application trouble failed in environment.step()" in shown
    assert "self.physics.step()" in shown
    assert "joint 'wrist_hinge'" in shown


def test_a_large_batch_does_not_flood_the_terminal() -> None:
    jobs = [JobRecord(label=f"sim-{number}", status="Completed", verdict="PASS") for number in range(1000)]
    shown = lines(record(jobs=jobs))
    assert len(shown) < 60
    assert any("… and 960 more" in line for line in shown)


def test_records_survive_being_written() -> None:
    assert RunRecord.model_validate_json(record().model_dump_json(exclude_none=True)) == record()
    assert json.loads(record().model_dump_json())["started_at"] == "2026-01-02T03:04:05Z"


def test_groups_of_failures_are_told_before_the_places() -> None:
    line = "polite, in Kitchen: 98 trials; noise ≥ 0.021: 90 of 400; robomaker repro sim-1 --trial 3"
    lines = ["".join(text for text, _ in cells) for cells in summary_lines(record(), ["robomaker"], why=[line])]
    assert f"  why: {line}" in lines
    assert lines.index(f"  why: {line}") < next(at for at, text in enumerate(lines) if text.startswith("  report"))
    assert not [text for text in lines if "why:" in text and line not in text]
