"""The thread that closes dead runs: what breaks a sweep is logged once; dead runs say what finishes them."""

import logging
import threading
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

from prefect_robomaker.deployments import dead_run_sweeper
from prefect_robomaker.deployments.dead_run_sweeper import _close_until_end, tell_of_broken_off
from prefect_robomaker.schemas.reports.run_record import Order
from prefect_robomaker.schemas.settings import Settings
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
        thread.join(60)

    assert len(calls) == 3
    assert caplog.messages == ["dead runs are not closed: ValueError: an answer that cannot be read"]


def test_a_flow_run_whose_process_died_says_what_finishes_it(settings: Settings, prefect_server: str) -> None:
    from prefect import flow
    from prefect.client.orchestration import get_client
    from prefect.states import Running

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
