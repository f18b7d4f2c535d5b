"""The policy of nights, and what Prefect really does: overlapping runs, missed ones, the two odd nights of the year."""

import os
import sqlite3
import subprocess
import sys
import uuid
from collections.abc import Callable, Iterator
from contextlib import closing
from datetime import UTC, date, datetime, timedelta
from pathlib import Path
from typing import Any
from zoneinfo import ZoneInfo

import pytest
from helpers.prefect_server import server_settings
from prefect.client.orchestration import SyncPrefectClient, get_client
from prefect.client.schemas.objects import FlowRun
from prefect.server.schemas.schedules import CronSchedule
from prefect.states import Cancelled, Completed, Paused, Pending, Running, Scheduled

from prefect_robomaker.tasks.execution.schedule_overlaps import OVERLAP, RUNS_AT_ONCE

SPEC = '{"version": 1, "name": "tiny", "steps": {"list": {"operation": "ListWorlds"}}}'
BERLIN = ZoneInfo("Europe/Berlin")
MakeNight = Callable[[], FlowRun]


@pytest.fixture
def client(prefect_server: str) -> Iterator[SyncPrefectClient]:
    with get_client(sync_client=True) as client:
        yield client


@pytest.fixture
def night(client: SyncPrefectClient, tmp_path: Path) -> Iterator[MakeNight]:
    """Makes runs of one deployment, due now."""
    spec = tmp_path / "tiny.yaml"
    spec.write_text(SPEC)
    deployment = client.create_deployment(
        flow_id=client.create_flow_from_name("RunPipeline"),
        name=f"night-{uuid.uuid4().hex}",
        entrypoint="prefect_robomaker.flows.pipelines:RunPipeline",
        parameters={"spec": str(spec)},
        concurrency_limit=RUNS_AT_ONCE,
        concurrency_options=OVERLAP,
    )

    yield lambda: client.create_flow_run_from_deployment(deployment, state=Scheduled())
    client.delete_deployment(deployment)


def test_a_night_waits_for_the_last_one_and_keeps_its_time(client: SyncPrefectClient, night: MakeNight) -> None:
    first, second = night(), night()
    for state in (Pending(), Running()):
        assert client.set_flow_run_state(first.id, state).status.value == "ACCEPT"

    answer = client.set_flow_run_state(second.id, Pending())

    assert (answer.status.value, answer.state and answer.state.name) == ("REJECT", "AwaitingConcurrencySlot")
    waiting = client.read_flow_run(second.id)
    assert waiting.expected_start_time == second.expected_start_time, "lateness counts from when it was due"
    client.set_flow_run_state(first.id, Completed())
    assert client.set_flow_run_state(second.id, Pending(), force=False).status.value == "ACCEPT"


def scheduled_at(run: FlowRun, due: datetime) -> None:
    """Makes a run one that a schedule made for a time in the past; Prefect takes no such thing from clients."""
    change_run(run, "auto_scheduled", 1)
    change_run(run, "expected_start_time", f"{due:%F %T.%f}")


def change_run(run: FlowRun, column: str, value: str | int) -> None:
    """Changes a run in the server's database."""
    with closing(sqlite3.connect(server_settings().home / "prefect" / "prefect.db", timeout=60)) as database, database:
        change = f"UPDATE flow_run SET {column} = ? WHERE id = ?"
        assert database.execute(change, (value, str(run.id))).rowcount == 1


def execute(run: FlowRun, api_url: str, folder: Path) -> subprocess.CompletedProcess[str]:
    """Runs a flow run in the process that a Prefect worker starts for it."""
    environ = {**os.environ, "PREFECT_API_URL": api_url, "ROBOMAKER_HOME": str(folder / "home")}
    environ["PREFECT__FLOW_RUN_ID"] = str(run.id)
    command = [sys.executable, "-m", "prefect.engine"]
    return subprocess.run(command, env=environ, cwd=folder, capture_output=True, text=True, check=False, timeout=240)


@pytest.mark.deep
def test_a_night_gives_its_place_to_one_that_was_due_earlier_and_still_waits(
    client: SyncPrefectClient, night: MakeNight, prefect_server: str, tmp_path: Path
) -> None:
    """Three that were due before both wait no more: the worker of one is gone, others were cancelled or paused."""
    before, gone, cancelled, paused, earlier, later = (night() for _ in range(6))
    scheduled_at(earlier, datetime.now(UTC) - timedelta(hours=5))  # missed, and not too late to be made up for
    for hours, run in enumerate((gone, cancelled, paused), 6):
        change_run(run, "expected_start_time", f"{datetime.now(UTC) - timedelta(hours=hours):%F %T.%f}")
    client.set_flow_run_state(before.id, Pending())
    for run in (gone, cancelled, paused, earlier, later):
        answer = client.set_flow_run_state(run.id, Pending())
        assert answer.state is not None
        assert answer.state.name == "AwaitingConcurrencySlot"
    change_run(gone, "next_scheduled_start_time", f"{datetime.now(UTC) - timedelta(minutes=5):%F %T.%f}")
    client.set_flow_run_state(cancelled.id, Cancelled(), force=True)
    client.set_flow_run_state(paused.id, Paused(timeout_seconds=3600), force=True)
    client.set_flow_run_state(before.id, Completed())

    assert client.set_flow_run_state(later.id, Pending()).status.value == "ACCEPT"  # it asked first
    done = execute(later, prefect_server, tmp_path)

    after = client.read_flow_run(later.id)
    assert done.returncode == 0, done.stderr
    assert after.state is not None
    assert (after.state.type.value, after.state.name) == ("SCHEDULED", "AwaitingConcurrencySlot"), done.stderr
    assert after.state.message == f"waits until the runs before it have begun: {earlier.name}"
    assert after.expected_start_time == later.expected_start_time, "lateness counts from when it was due"
    waits = client.read_flow_run(earlier.id)
    assert waits.next_scheduled_start_time is not None
    assert after.next_scheduled_start_time is not None
    assert after.next_scheduled_start_time > waits.next_scheduled_start_time
    assert not (tmp_path / "home" / "runs").exists()
    # Its place is free: the earlier one begins, and the later one after it.
    for count, run in enumerate((earlier, later), 1):
        assert client.set_flow_run_state(run.id, Pending()).status.value == "ACCEPT"
        done = execute(run, prefect_server, tmp_path)
        ended = client.read_flow_run(run.id).state
        assert ended is not None
        assert ended.is_completed(), done.stderr
        assert len([*(tmp_path / "home" / "runs").glob("*/run.json")]) == count, done.stderr


@pytest.mark.deep
def test_a_night_that_was_missed_for_too_long_is_skipped(
    client: SyncPrefectClient, night: MakeNight, prefect_server: str, tmp_path: Path
) -> None:
    run = night()
    scheduled_at(run, datetime.now(UTC) - timedelta(hours=7))

    ended = execute(run, prefect_server, tmp_path)

    state = client.read_flow_run(run.id).state
    assert state is not None, ended.stderr
    assert state.name == "Skipped", ended.stderr
    assert state.is_cancelled()
    assert not (tmp_path / "home" / "runs").exists()
    assert "begun 7.0 h later; at most 6 h are allowed (ROBOMAKER_MAX_LATE_HOURS)" in (state.message or "")


async def dates(cron: str, timezone: str, year: int) -> list[datetime]:
    start = datetime(year, 1, 1, tzinfo=ZoneInfo(timezone))
    schedule = CronSchedule(cron=cron, timezone=timezone)  # type: ignore[arg-type]
    return [each.astimezone(UTC) for each in await schedule.get_dates(365, start=start)]


@pytest.mark.parametrize("cron", ["0 2 * * *", "30 2 * * *", "0 3 * * *", "0 1 * * *"])
def test_each_night_of_a_year_has_one_run_also_the_two_odd_ones(cron: str) -> None:
    found = run_async(dates(cron, "Europe/Berlin", 2026))

    nights: list[date] = [each.astimezone(BERLIN).date() for each in found]
    assert nights == [date(2026, 1, 1) + timedelta(days=day) for day in range(365)]


def test_times_that_a_night_lacks_or_has_twice() -> None:
    """What the documentation says: an hour early in spring, the first of both in autumn, UTC is always the same."""
    berlin = run_async(dates("30 2 * * *", "Europe/Berlin", 2026))
    utc = run_async(dates("30 2 * * *", "UTC", 2026))

    assert datetime(2026, 3, 29, 0, 30, tzinfo=UTC) in berlin, "01:30 in winter's time; there is no 02:30"
    assert datetime(2026, 10, 25, 0, 30, tzinfo=UTC) in berlin, "02:30 in summer's time; there are two"
    assert {each.strftime("%H:%M") for each in utc} == {"02:30"}


def run_async(work: Any) -> Any:
    import asyncio

    return asyncio.run(work)
