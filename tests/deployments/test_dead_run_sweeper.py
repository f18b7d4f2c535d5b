"""The thread that closes dead runs: what breaks a sweep is logged once, and the next one comes."""

import logging
import threading
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

from prefect_robomaker.deployments import dead_run_sweeper
from prefect_robomaker.deployments.dead_run_sweeper import _close_until_end
from prefect_robomaker.schemas.settings import Settings


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
