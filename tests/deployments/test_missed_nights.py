"""Nights that Prefect had and that did not happen: the data home knows them, and tells of them once."""

import json
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import pytest
from helpers.command_here import Command
from helpers.night_records import FIRST_NIGHT, make_night, store_night
from helpers.processes import wait_for
from helpers.receivers import Webhook

from prefect_robomaker.schemas.reports.run_record import BEFORE_STEPS, Order, StepRecord, new_run_id
from prefect_robomaker.schemas.settings import Settings
from prefect_robomaker.tasks.nights.missed_nights import missed_nights, note_schedule, schedules_of
from prefect_robomaker.tasks.nights.open_runs import OpenRun

if TYPE_CHECKING:
    from prefect.client.schemas.objects import FlowRun

DAY = timedelta(days=1)


@pytest.fixture
def deployment(prefect_server: str, tmp_path: Any) -> Any:
    """A deployment whose schedule begins a night each day, in a pool without a worker.

    The next is due in 14 hours: later looks are hours away from when one is too late, whatever the time is.
    """
    from prefect.client.orchestration import get_client
    from prefect.client.schemas.actions import DeploymentScheduleCreate, WorkPoolCreate
    from prefect.client.schemas.schedules import CronSchedule

    del prefect_server
    due_at = datetime.now(UTC) + timedelta(hours=14)
    with get_client(sync_client=True) as client:
        client.create_work_pool(WorkPoolCreate(name=tmp_path.name, type="process"))
        each_night = DeploymentScheduleCreate(
            schedule=CronSchedule(cron=f"{due_at.minute} {due_at.hour} * * *"), active=True
        )
        yield client.create_deployment(
            flow_id=client.create_flow_from_name("RunPipeline"),
            name=tmp_path.name,
            work_pool_name=tmp_path.name,
            entrypoint="prefect_robomaker.flows.pipelines:RunPipeline",
            schedules=[each_night],
            parameters={"text": '{"version": 1, "name": "nightly", "steps": {"list": {"operation": "ListWorlds"}}}'},
            job_variables={"env": {"ROBOMAKER_HOME": str(tmp_path / "home of the runs")}},
        )


def wait_for_runs(deployment: Any) -> "list[FlowRun]":
    """Waits until the server has made runs for the schedule, which takes it some seconds."""
    from prefect.client.orchestration import get_client
    from prefect.client.schemas.filters import DeploymentFilter, DeploymentFilterId

    chosen = DeploymentFilter(id=DeploymentFilterId(any_=[deployment]))
    with get_client(sync_client=True) as client:
        return wait_for(lambda: client.read_flow_runs(deployment_filter=chosen), "the server to make runs")


def test_a_first_night_that_never_began_is_told(
    deployment: Any, robomaker_at_server: Command, tmp_path: Any, webhook: Webhook, monkeypatch: pytest.MonkeyPatch
) -> None:
    home = tmp_path / "home of the runs"
    monkeypatch.setenv("ROBOMAKER_HOME", str(home))
    robomaker_at_server("doctor")  # notes that there is a schedule, of which no run ever began
    [schedule] = schedules_of(home)
    assert (schedule.deployment, schedule.name) == (str(deployment), "nightly")

    from prefect_robomaker.deployments.missed_nights import look_for_missed_nights

    notify = f"json://{webhook.address}/hook"
    settings = Settings.from_environment({"ROBOMAKER_HOME": str(home), "ROBOMAKER_NOTIFY": notify})
    in_two_days = datetime.now(UTC) + 2 * DAY

    wait_for_runs(deployment)
    look_for_missed_nights(settings, in_two_days)
    assert missed_nights(home, "nightly")[0].reason == "no Prefect worker was running"
    assert "no night on" in webhook.got[0]["title"]
    told = robomaker_at_server("history", "nightly")
    assert told.code != 0
    assert "there is no run of 'nightly'" in told.err
    assert "no Prefect worker was running" in told.err

    other = Settings.from_environment({"ROBOMAKER_HOME": str(tmp_path / "other")})
    look_for_missed_nights(other, in_two_days)
    assert schedules_of(other.home) == []  # its runs have another home


def test_no_server_is_started_to_look_for_nights(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A thread that looks may outlive the settings with which it was started."""
    from prefect.settings import PREFECT_API_URL, temporary_settings

    from prefect_robomaker.deployments import missed_nights as looking

    monkeypatch.setattr(looking, "asking_once", lambda: pytest.fail("Prefect was asked"))
    monkeypatch.delenv("PREFECT_API_URL", raising=False)
    with temporary_settings(restore_defaults={PREFECT_API_URL}):
        looking.look_for_missed_nights(Settings.from_environment({"ROBOMAKER_HOME": str(tmp_path / "home")}))


def test_a_night_that_ended_before_it_had_kept_anything_is_told(
    deployment: Any, prefect_server: str, tmp_path: Path
) -> None:
    """Nothing finishes it: there is no run of it. It was killed, or its code could not be loaded."""
    from prefect.client.orchestration import get_client
    from prefect.states import Crashed, Failed, Running

    from prefect_robomaker.deployments.missed_nights import look_for_missed_nights

    del prefect_server
    homes = [tmp_path / "without its run", tmp_path / "with its run"]
    for home in homes:
        note_schedule(home, str(deployment), "nightly", datetime.now(UTC))
    with get_client(sync_client=True) as client:
        runs = wait_for_runs(deployment)
        due: list[datetime] = []
        ends = (Crashed(message="killed by SIGKILL"), Failed(message="no module named x"))
        for run, end in zip(sorted(runs, key=lambda run: str(run.expected_start_time)), ends, strict=False):
            for state in (Running(), end):
                client.set_flow_run_state(run.id, state, force=True)
            due.append(cast("datetime", run.expected_start_time))
            began = cast("datetime", client.read_flow_run(run.id).start_time)
            (homes[1] / "runs" / new_run_id("nightly", began)).mkdir(parents=True)

    for home in homes:
        settings = Settings.from_environment({"ROBOMAKER_HOME": str(home)})
        look_for_missed_nights(settings, due[1] + DAY)

    told = {night.due_at: night.reason for night in missed_nights(homes[0], "nightly")}
    assert [told[at] for at in due] == [
        "its run crashed before it began: killed by SIGKILL",
        "its run failed before it began: no module named x",
    ]
    assert not {*due} & {night.due_at for night in missed_nights(homes[1], "nightly")}


def test_missed_nights_are_kept_and_told_once(
    deployment: Any, robomaker_at_server: Command, home: Any, webhook: Webhook, monkeypatch: pytest.MonkeyPatch
) -> None:
    from prefect.client.orchestration import get_client

    from prefect_robomaker.deployments.missed_nights import look_for_missed_nights

    settings = Settings.from_environment(
        {"ROBOMAKER_HOME": str(home), "ROBOMAKER_NOTIFY": f"json://{webhook.address}/hook"}
    )
    now = datetime.now(UTC)
    note_schedule(home, str(deployment), "nightly", now)

    def look(days: float) -> Any:
        look_for_missed_nights(settings, now + days * DAY)
        return schedules_of(home)[0]

    # The server makes the runs of a schedule some seconds after it was told of it.
    first = wait_for(lambda: (found := look(0.0)).expected and found, "the server to know the next nights")
    assert len(first.expected) >= 3
    assert first.missed == []

    two = look(2.0)
    assert [night.reason for night in two.missed[:1]] == ["no Prefect worker was running"]
    assert len(webhook.got) == 1
    assert "no night on" in webhook.got[0]["title"]
    assert "no Prefect worker was running" in webhook.got[0]["title"]
    assert look(2.0) == two
    assert len(webhook.got) == 1

    with get_client(sync_client=True) as client:
        client.pause_deployment(deployment)
        assert look(2.01).paused_since is not None
        assert look(3.5).missed[-1].reason == "its schedule was paused"
        assert len(webhook.got) == 2
        look(4.5)
        assert len(webhook.got) == 2  # somebody paused it: that is told once

    # History and doctor have them, and what is not finished.
    folder = home / "runs" / "nightly-20261127T020000000"
    folder.mkdir(parents=True)
    order = Order(
        run_id=folder.name, text="", filename="", spec_path="", command=["true"], name="nightly", started_at=now
    )
    OpenRun.begin(folder, order).pass_on()  # as when its process dies
    store_night(make_night("P", name="nightly", runs=home / "runs"))
    told = robomaker_at_server("history", "nightly")
    assert told.code == 0, told.err
    assert f"no night: {two.missed[0].reason}" in told.out
    assert "not finished: its process died; the next process that may run jobs finishes it" in told.out
    page = (home / "history" / "nightly.html").read_text()
    assert "Nights that did not happen or are not finished" in page
    as_json = json.loads(robomaker_at_server("history", "nightly", "-o", "json").out)
    assert [each["has_begun"] for each in as_json["missed"]].count(False) == len(missed_nights(home, "nightly"))

    refused = StepRecord(name=BEFORE_STEPS, operation="RunPipeline", status="Failed", error="no world 'gone'\nnor flat")
    night = make_night("", (now - FIRST_NIGHT).days, name="nightly", runs=home / "runs")
    store_night(night.model_copy(update={"steps": [refused], "state": "broken"}))
    doctor = json.loads(robomaker_at_server("doctor", "-o", "json").out)
    [finding] = [each for each in doctor["findings"] if each["subject"] == "nights"]
    assert finding["health"] == "warning"
    assert "no Prefect worker of the pool" in finding["found"]
    assert "its schedule is paused" in finding["found"]
    assert f"nightly: refused on {night.started_at.day} {night.started_at:%B} (" in finding["found"]
    assert "UTC): no world 'gone'" in finding["found"]

    with get_client(sync_client=True) as client:
        client.delete_deployment(deployment)
    look_for_missed_nights(settings)
    assert schedules_of(home) == []
