"""What a message says and when one is due."""

from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest
from helpers.night_records import make_job, make_night

from prefect_robomaker.schemas.reports.report import RunState
from prefect_robomaker.schemas.reports.run_record import BEFORE_STEPS, JobRecord, RunRecord, StepRecord
from prefect_robomaker.schemas.runs.plan import Requirement
from prefect_robomaker.schemas.settings import NotifyWhen, Settings
from prefect_robomaker.schemas.wire.errors import ConfigurationError
from prefect_robomaker.tasks.comparison.compared_runs import NightRun
from prefect_robomaker.tasks.comparison.history import since_last_run
from prefect_robomaker.tasks.notifications.notices import is_due
from prefect_robomaker.tasks.notifications.notification_texts import failed_jobs, message_of
from prefect_robomaker.tasks.reporting.console_pages import ConsolePages

MOMENT = datetime(2026, 11, 23, tzinfo=UTC)


def record(state: RunState, jobs: list[JobRecord] | None = None, **members: Any) -> RunRecord:
    return RunRecord(
        run_id="night-1", name="night", spec_path="night.yaml", state=state, exit_code=0, started_at=MOMENT,
        ended_at=MOMENT, run_dir=Path("/runs/night-1"), jobs=jobs or [],
        **{"steps": [], "report_path": Path("/runs/night-1/report.html"), **members},
    )  # fmt: skip


def missed(count: int) -> list[Requirement]:
    return [Requirement(name=f"goal-{number}", satisfied=False, detail=f"{number} of 9") for number in range(count)]


@pytest.mark.parametrize(
    ("when", "state", "before", "due"),
    [
        ("failure", "failed", None, True),
        ("failure", "broken", "failed", True),
        ("failure", "timed out", "succeeded", True),
        ("failure", "succeeded", "failed", False),
        ("failure", "canceled", "succeeded", False),
        ("recovery", "succeeded", "failed", True),
        ("recovery", "succeeded", "succeeded", False),
        ("recovery", "succeeded", None, False),
        ("recovery", "failed", "succeeded", False),
        ("change", "failed", None, True),
        ("change", "failed", "succeeded", True),
        ("change", "broken", "failed", False),
        ("change", "succeeded", "broken", True),
        ("change", "succeeded", "succeeded", False),
        ("always", "succeeded", "succeeded", True),
        ("always", "canceled", None, True),
    ],
)
def test_when_somebody_is_told(when: NotifyWhen, state: RunState, before: RunState | None, due: bool) -> None:
    last = None if before is None else record(before)

    assert is_due(frozenset({when}), record(state), last) == due


def test_the_message_names_the_three_worst_and_how_to_run_them_again() -> None:
    jobs = [
        JobRecord(label="sim-a", status="Completed", verdict="PASS"),
        JobRecord(label="sim-b", status="Completed", verdict="FAIL", world="flat/world-2", requirements=missed(1)),
        JobRecord(label="sim-c", status="Completed", verdict="FAIL", world="flat/world-3", requirements=missed(2)),
        JobRecord(label="sim-d", status="Failed", failure_code="SimulationApplicationCrash", failure_reason="it\nfell"),
        JobRecord(label="sim-e", status="Completed", verdict="FAIL", verdict_reason="x" * 1000),
        JobRecord(label="sim-f", status="Canceled", verdict="FAIL"),
    ]
    run = record("broken", jobs)
    assert [job.label for job in failed_jobs(run)] == ["sim-d", "sim-c", "sim-b", "sim-e"]

    message = message_of(run, None)

    assert message.title == "night: broken, 1 of 6 jobs passed, 3 failed, 1 broke, 1 canceled"
    assert not message.good
    assert message.body.splitlines() == [
        "1 of 6 jobs passed, 3 failed, 1 broke, 1 canceled.",
        "",
        "1. sim-d: SimulationApplicationCrash: it fell",
        "2. sim-c in flat/world-3: goal-0: 0 of 9; goal-1: 1 of 9",
        "3. sim-b in flat/world-2: goal-0: 0 of 9",
        "and 1 more",
        "",
        "Report: /runs/night-1/report.html",
        "Open it: robomaker report night-1 --open",
        "Run these again: robomaker rerun night-1 --failed",
    ]


def test_known_failures_are_counted_by_themselves_and_come_last() -> None:
    known = "anna until 2027-01-15: ticket 512"
    jobs = [
        JobRecord(label="sim-a", status="Completed", verdict="FAIL", requirements=missed(2), known=known),
        JobRecord(label="sim-b", status="Completed", verdict="FAIL", requirements=missed(1)),
        JobRecord(label="sim-c", status="Completed", verdict="PASS"),
    ]

    message = message_of(record("failed", jobs), None)

    assert message.title == "night: failed, 1 of 3 jobs passed, 1 failed, 1 known"
    assert message.body.splitlines()[:4] == [
        "1 of 3 jobs passed, 1 failed, 1 known.",
        "",
        "1. sim-b: goal-0: 0 of 9",
        "2. sim-a: known, anna until 2027-01-15: ticket 512: goal-0: 0 of 9; goal-1: 1 of 9",
    ]


def test_reasons_are_in_the_order_of_the_verdict() -> None:
    reason = "goal-1: 1 of 9; goal-0: 0 of 9"
    job = JobRecord(label="sim-a", status="Completed", verdict="FAIL", requirements=missed(2), verdict_reason=reason)
    assert f"1. sim-a: {reason}" in message_of(record("failed", [job]), None).body.splitlines()


def test_jobs_are_named_as_people_name_them() -> None:
    job = JobRecord(
        label="sim-b",
        name="scout in flat 2",
        status="Completed",
        verdict="FAIL",
        world="g/world-2",
        requirements=missed(1),
    )
    assert "1. scout in flat 2 (sim-b): goal-0: 0 of 9" in message_of(record("failed", [job]), None).body.splitlines()


def test_pages_that_open_elsewhere_are_named_and_the_machine_that_has_the_report() -> None:
    arn = "arn:aws:robomaker:us-east-1:000000000000:simulation-job/sim-b"
    jobs = [JobRecord(label="sim-b", status="Completed", verdict="FAIL", verdict_reason="late", arn=arn)]

    message = message_of(record("failed", jobs), None, None, ConsolePages("https://robots.example/console"), "lab-7")

    assert message.body.splitlines()[2:] == [
        "1. sim-b: late",
        "https://robots.example/console/jobs/sim-b",
        "",
        "Run: https://robots.example/console/runs/night-1",
        "Report: /runs/night-1/report.html on lab-7",
        "Run these again: robomaker rerun night-1 --failed",
    ]


def test_all_failures_count_and_the_worst_comes_first_however_many_there_are() -> None:
    jobs = [JobRecord(label=f"sim-{number}", status="Completed", verdict="FAIL") for number in range(300)]
    broken = JobRecord(label="sim-last", status="Failed", failure_code="RobotApplicationCrash", failure_reason="gone")

    message = message_of(record("broken", [*jobs, broken]), None)

    assert message.title == "night: broken, 0 of 301 jobs passed, 300 failed, 1 broke"
    assert message.body.splitlines()[2] == "1. sim-last: RobotApplicationCrash: gone"
    assert "and 298 more" in message.body.splitlines()


def test_a_run_without_a_report_is_not_said_to_have_made_no_jobs() -> None:
    assert "It made no simulation jobs." in message_of(record("succeeded"), None).body
    assert "Its report could not be written." in message_of(record("broken", report_path=None), None).body


def test_a_run_that_broke_before_its_jobs_has_the_reason_in_its_title() -> None:
    reason = f"there is no robot application 'brisc' (night.yaml:42:28){' and more' * 30}"
    step = StepRecord(name=BEFORE_STEPS, operation="RunPipeline", status="Failed", error=reason)
    refused = message_of(record("broken", steps=[step]), None)
    assert refused.title.startswith("night: refused, there is no robot application 'brisc' (night.yaml:42:28) and")
    assert len(refused.title) == len("night: refused, ") + 120
    assert f"It was refused before its first step: {reason[:200]}" in refused.body

    broke = message_of(record("broken", steps=[step.model_copy(update={"name": "robot", "error": "no archive"})]), None)
    assert broke.title == "night: broken, step robot: no archive"


def test_a_good_night_after_bad_ones_says_so() -> None:
    message = message_of(
        record("succeeded", [JobRecord(label="a", status="Completed", verdict="PASS")]), record("failed")
    )

    assert message.title == "night: passed, good again, 1 of 1 job passed"
    assert message.good
    assert "rerun" not in message.body


def test_a_step_that_failed_is_told() -> None:
    step = StepRecord(name="worlds", operation="CreateWorldGenerationJob", status="Failed", error="no walls\nmet")

    message = message_of(record("broken", steps=[step]), None)

    assert message.title == "night: broken, step worlds: no walls met"
    assert "Step worlds (CreateWorldGenerationJob): no walls met" in message.body.splitlines()


def test_long_reasons_are_cut() -> None:
    job = JobRecord(label="a", status="Failed", failure_reason="y" * 1000 + "\nLast lines of the log:\nz")

    assert len(max(message_of(record("broken", [job]), None).body.splitlines(), key=len)) < 320


def test_settings_say_who_is_told_and_when() -> None:
    settings = Settings.from_environment(
        {"ROBOMAKER_NOTIFY": "json://a/b \n mailto://c.d", "ROBOMAKER_NOTIFY_WHEN": "change, always"}
    )

    assert settings.notify == ("json://a/b", "mailto://c.d")
    assert settings.notify_when == {"change", "always"}
    assert "json://" not in repr(settings), "addresses hold secrets"
    assert Settings.from_environment({}).notify_when == {"failure", "recovery"}
    with pytest.raises(
        ConfigurationError, match="ROBOMAKER_NOTIFY_WHEN is 'never'; it has to be some of failure, reco"
    ):
        Settings.from_environment({"ROBOMAKER_NOTIFY_WHEN": "never"})


def test_another_way_of_failing_is_in_the_title() -> None:
    """Both nights fail; a reader of titles sees that this one is another."""

    def night(number: int, *missed: str) -> RunRecord:
        job = make_job(0, "F", night=number)
        asked = [
            job.requirements[0].model_copy(update={"name": name, "satisfied": name not in missed})
            for name in ("goal", "gentle", "upright")
        ]
        night = make_night([job.model_copy(update={"requirements": asked})], number)
        return night.model_copy(update={"state": "failed"})

    first, second = night(0, "goal"), night(1, "gentle", "upright")
    since = since_last_run([NightRun.of(first), NightRun.of(second)])
    message = message_of(second, first, since)
    assert message.title == f"nightly: {second.state}, 0 of 1 job passed, 1 failed, newly missed: gentle, upright"
    missed = "gentle: newly missed in 1 of 1 trial"
    assert f"{missed}; world and seed are the same; `robomaker flaky` tells whether it is chance" in message.body
    assert "goal: newly met in 1 of 1 trial" in message.body
    assert since.still_failing[0].newly_missed == ["gentle", "upright"]


def test_run_these_again_is_a_command_that_runs_these_again() -> None:
    """Jobs decide, not the state: a known failure leaves that as it is, and what broke may be no job."""
    passed = JobRecord(label="sim-a", status="Completed", verdict="PASS")
    known = JobRecord(label="sim-b", status="Completed", verdict="FAIL", known="anna until 2027-01-15")
    message = message_of(record("succeeded", [passed, known]), None)
    assert message.body.splitlines()[-1] == "Run these again: robomaker rerun night-1 --failed"
    assert record("broken", [passed]).again == "robomaker rerun night-1", "none has failed"
    for status in ("Canceled", "Running", "NotCreated"):
        ended = passed.model_copy(update={"status": status})
        assert record("succeeded", [passed, ended]).again == "robomaker rerun night-1 --failed"
