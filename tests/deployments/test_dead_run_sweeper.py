"""The thread that closes dead runs: what breaks a sweep is logged once; dead runs say what finishes them."""

import logging
import threading
from contextlib import nullcontext, suppress
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any
from unittest.mock import Mock
from uuid import uuid4

import pytest
from prefect import flow
from prefect.client.orchestration import get_client
from prefect.states import Cancelling, Completed, Running

from prefect_robomaker.deployments import dead_run_sweeper
from prefect_robomaker.deployments.dead_run_sweeper import _close_until_end, tell_of_broken_off
from prefect_robomaker.schemas.reports.run_record import Order
from prefect_robomaker.schemas.settings import Settings
from prefect_robomaker.tasks.backends.backend import JOB_WORKER_FLOW
from prefect_robomaker.tasks.execution.dead_flow_runs import SILENCE_S, has_open_runs
from prefect_robomaker.tasks.nights.open_runs import OpenRun


def test_a_defect_is_logged_once_and_the_thread_goes_on(
    caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(dead_run_sweeper, "_RETRY_S", 0.01)
    calls: list[str] = []

    settings = Settings.from_environment({"ROBOMAKER_HOME": str(tmp_path)})

    def connect() -> Any:
        calls.append("connect")
        if len(calls) < 3:
            raise ValueError("an answer that cannot be read")
        raise SystemExit

    def sweep_until_told_to_end() -> None:
        with suppress(SystemExit):
            _close_until_end(connect, settings)

    with caplog.at_level(logging.WARNING):
        thread = threading.Thread(target=sweep_until_told_to_end)
        thread.start()
        thread.join(200)

    assert len(calls) == 3
    assert caplog.messages == ["dead runs are not closed: ValueError: an answer that cannot be read"]


def test_a_flow_run_whose_process_died_says_what_finishes_it(settings: Settings, prefect_server: str) -> None:
    del prefect_server

    @flow(name="RunPipeline")
    def pipeline() -> None:
        """Is never run."""

    folder = settings.home / "runs" / "night-20261127T020000000"
    folder.mkdir(parents=True)
    with get_client(sync_client=True) as client:
        flow_run = client.create_flow_run(pipeline, state=Running()).id
        order = Order(run_id=folder.name, text="", filename="", spec_path="", command=["true"], flow_run=str(flow_run))
        run = OpenRun.begin(folder, order)
        told: set[tuple[str, int]] = set()
        tell_of_broken_off(client, settings, told)
        state = client.read_flow_run(flow_run).state
        assert state is not None
        assert state.is_running()  # its process lives

        run.pass_on()  # as when its process dies
        tell_of_broken_off(client, settings, told)
        state = client.read_flow_run(flow_run).state
        assert state is not None
        assert state.is_crashed()
        assert state.message is not None
        assert state.message.startswith("its process died; robomaker serve or a Prefect worker finishes it")
        assert state.message.endswith(f"or: robomaker perform {folder.name}")


class ManualClock:
    """Time that passes only while the sweeper waits; in place of the module `time` and of its event."""

    def __init__(self, ends_at_s: float) -> None:
        self.now_s = 0.0
        self._ends_at_s = ends_at_s

    def monotonic(self) -> float:
        return self.now_s

    time = monotonic

    def wait(self, duration_s: float) -> bool:
        self.now_s += duration_s
        if self.now_s > self._ends_at_s:
            raise SystemExit
        return False


@pytest.mark.parametrize("closed_s", [1300.0, 1203.0])
def test_an_idle_server_is_swept_seldom_and_a_run_that_begins_is_seen_before_it_can_count_as_dead(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, closed_s: float
) -> None:
    begun_s, end_s = 1201.0, 1500.0
    clock = ManualClock(end_s)
    sweeps: list[float] = []
    monkeypatch.setattr(dead_run_sweeper, "time", clock)
    monkeypatch.setattr(dead_run_sweeper.threading, "Event", lambda: clock)

    def is_open(client: object, flows: set[str], since: datetime | None = None) -> bool:
        del client
        assert JOB_WORKER_FLOW in flows  # it gives signs of life, and is no operation
        ended_at_s = max(closed_s, since.timestamp() if since else clock.now_s)
        return begun_s <= clock.now_s < closed_s or ended_at_s == closed_s < clock.now_s

    monkeypatch.setattr(dead_run_sweeper, "has_open_runs", is_open)
    monkeypatch.setattr(dead_run_sweeper, "tell_ends", lambda *_: sweeps.append(clock.now_s))
    for name in ("sweep", "close_unheard", "remove_leftover_limits"):
        monkeypatch.setattr(dead_run_sweeper, name, lambda *_, **__: None)

    with suppress(SystemExit):
        client: Any = nullcontext(Mock())
        _close_until_end(lambda: client, Settings.from_environment({"ROBOMAKER_HOME": str(tmp_path)}))

    idle = [at_s for at_s in sweeps if 100 < at_s < begun_s]
    assert len(idle) <= 20  # in more than 18 minutes
    first = next(at_s for at_s in sweeps if at_s > begun_s)
    assert first - begun_s < SILENCE_S
    # What is on its way, when the last run has ended, is waited for at the quick pace.
    assert [at_s for at_s in sweeps if first <= at_s < closed_s + 50] == pytest.approx(
        [first + 5 * turn for turn in range(round((closed_s + 50 - first) / 5))], abs=5
    )


def test_open_runs_are_those_of_our_flows_that_had_not_ended_at_the_last_look(prefect_server: str) -> None:
    del prefect_server
    name = f"of-this-test-{uuid4().hex[:8]}"

    @flow(name=name)
    def begun() -> None:
        """Is never run."""

    with get_client(sync_client=True) as client:
        run = client.create_flow_run(begun, state=Running()).id
        before, later = datetime.now(UTC) - timedelta(hours=1), datetime.now(UTC) + timedelta(hours=1)
        assert has_open_runs(client, {name}, later)
        assert not has_open_runs(client, {f"{name}-of-others"}, before)
        client.set_flow_run_state(run, Cancelling(), force=True)
        assert has_open_runs(client, {name}, later)
        client.set_flow_run_state(run, Completed(), force=True)
        assert not has_open_runs(client, {name}, later)
        assert has_open_runs(client, {name}, before)  # parts of it may still be open
        assert not has_open_runs(client, {f"{name}-of-others"}, before)
