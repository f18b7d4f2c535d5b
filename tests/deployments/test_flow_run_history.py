"""Old flow runs of a real Prefect server: they go with task runs, logs and artifacts; others' stay."""

import fcntl
import sqlite3
import uuid
from collections.abc import Callable, Iterator
from contextlib import closing
from datetime import UTC, datetime, timedelta
from typing import Any

import pytest
from helpers.prefect_server import server_settings
from helpers.processes import wait_for
from prefect.client.orchestration import SyncPrefectClient, get_client
from prefect.client.schemas.actions import LogCreate
from prefect.client.schemas.filters import FlowRunFilter, FlowRunFilterId, LogFilter, LogFilterFlowRunId
from prefect.client.schemas.objects import FlowRun, State
from prefect.states import Completed, Failed, Running
from prefect.types import DateTime

from prefect_robomaker.deployments.flow_run_history import collect_flow_runs
from prefect_robomaker.deployments.prefect_database import database_file, measure_database
from prefect_robomaker.schemas.reports.retention import RetentionPolicy
from prefect_robomaker.schemas.settings import Settings

NOW = datetime.now(UTC)
# Far enough back that runs of other tests on the same server are never old.
YEARS = RetentionPolicy(older_than=timedelta(days=3000))
MakeRun = Callable[..., FlowRun]


@pytest.fixture(autouse=True)
def alone(prefect_server: str) -> Iterator[None]:
    """No other process of pytest makes or counts old flow runs on the server that all share."""
    with (server_settings().home / "old-flow-runs.lock").open("w") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        yield


@pytest.fixture
def client(prefect_server: str) -> Iterator[SyncPrefectClient]:
    with get_client(sync_client=True) as client:
        yield client


@pytest.fixture
def flow_run(client: SyncPrefectClient) -> Iterator[MakeRun]:
    """Makes flow runs that ended long ago, with a task run, a log line and an artifact; removes what is left."""
    made: list[Any] = []

    def make(flow: str = "ListWorlds", end: State[Any] | None = None, days: int = 4000) -> FlowRun:
        flow_id = str(client.create_flow_from_name(flow))
        body = {
            "flow_id": flow_id,
            "name": f"old-{uuid.uuid4().hex[:6]}",
            "state": {"type": "PENDING"},
        }
        run = FlowRun.model_validate(client.request("POST", "/flow_runs/", json=body).json())
        made.append(run.id)
        for state in (Running(), end or Completed()):
            client.set_flow_run_state(run.id, state, force=True)
        backdate(run.id, NOW - timedelta(days=days))
        task = {"flow_run_id": str(run.id), "task_key": "t", "dynamic_key": "0", "name": "t"}
        client.request("POST", "/task_runs/", json=task)
        client.request("POST", "/artifacts/", json={"flow_run_id": str(run.id), "key": f"k-{run.name}", "data": "x"})
        log = LogCreate(name="t", level=20, message="said", timestamp=DateTime.now("UTC"), flow_run_id=run.id)
        client.create_logs([log])
        return run

    yield make
    for run_id in made:
        if exists(client, run_id):
            client.delete_flow_run(run_id)


def backdate(run_id: Any, ended: datetime) -> None:
    """Prefect takes no times from clients, so its database is told; a run that goes on has none."""
    with closing(sqlite3.connect(server_settings().home / "prefect" / "prefect.db", timeout=60)) as database, database:
        change = "UPDATE flow_run SET end_time = ? WHERE id = ? AND end_time IS NOT NULL"
        database.execute(change, (f"{ended:%Y-%m-%d %H:%M:%S.%f}", str(run_id)))


def exists(client: SyncPrefectClient, run_id: Any) -> bool:
    return bool(client.read_flow_runs(flow_run_filter=FlowRunFilter(id=FlowRunFilterId(any_=[run_id]))))


def left(client: SyncPrefectClient, run_id: Any) -> tuple[int, int, int]:
    """Task runs, artifacts and lines of log."""
    tasks = client.request("POST", "/task_runs/filter", json={"task_runs": {"flow_run_id": {"any_": [str(run_id)]}}})
    artifacts = client.request("POST", "/artifacts/filter", json={}).json()
    logs = client.read_logs(log_filter=LogFilter(flow_run_id=LogFilterFlowRunId(any_=[run_id])))
    return len(tasks.json()), len([each for each in artifacts if each["flow_run_id"] == str(run_id)]), len(logs)


def test_old_flow_runs_go_with_all_that_is_theirs(client: SyncPrefectClient, flow_run: MakeRun) -> None:
    old, young, theirs = flow_run(), flow_run(days=10), flow_run("their-own-flow")
    assert left(client, old.id) == (1, 1, 1)

    looked = collect_flow_runs(server_settings(), YEARS, NOW, act=False)
    assert (looked.count, looked.problem) == (1, None)
    assert exists(client, old.id)
    told = collect_flow_runs(server_settings(), YEARS, NOW, act=True)

    assert (told.count, told.problem) == (1, None)
    assert [exists(client, run.id) for run in (old, young, theirs)] == [False, True, True]
    wait_for(lambda: left(client, old.id) == (0, 0, 0), "the removal of its logs, a little later", 120)
    assert left(client, theirs.id) == (1, 1, 1)


def test_failures_stay_where_they_are_kept(client: SyncPrefectClient, flow_run: MakeRun) -> None:
    passed, failed = flow_run(), flow_run(end=Failed(message="verdict"))
    kept = YEARS.model_copy(update={"keep_failures": True})

    assert collect_flow_runs(server_settings(), kept, NOW, act=True).count == 1
    assert [exists(client, run.id) for run in (passed, failed)] == [False, True]


def test_a_run_that_goes_on_stays(client: SyncPrefectClient, flow_run: MakeRun) -> None:
    run = flow_run(end=Running())

    assert collect_flow_runs(server_settings(), YEARS, NOW, act=True).count == 0
    assert exists(client, run.id)


def test_the_database_shrinks_while_its_server_goes_on(client: SyncPrefectClient, flow_run: MakeRun) -> None:
    path = database_file(server_settings())
    with closing(sqlite3.connect(path, timeout=60)) as database, database:
        database.execute("CREATE TABLE ballast (text)")
        database.executemany("INSERT INTO ballast VALUES (?)", [("x" * 4000,) for _ in range(1000)])
    with closing(sqlite3.connect(path, timeout=60)) as database, database:
        database.execute("DROP TABLE ballast")

    looked = collect_flow_runs(server_settings(), YEARS, NOW, act=False)
    told = collect_flow_runs(server_settings(), YEARS, NOW, act=True)

    assert looked.freed_bytes > 3_000_000
    assert told.problem is None
    assert told.freed_bytes > 3_000_000
    # Other tests write to it meanwhile.
    assert told.database_bytes == pytest.approx(measure_database(path).size_bytes, abs=1_000_000)
    assert exists(client, flow_run().id)


def test_without_an_age_or_a_server_nothing_is_looked_at(settings: Settings) -> None:
    assert "go by age" in collect_flow_runs(settings, RetentionPolicy(keep_runs=1), NOW, act=True).note
    assert "does not run" in collect_flow_runs(settings, YEARS, NOW, act=True).note
