"""Laptops that are closed at random moments of a run, alone or with their Prefect server: it is shown as it ended."""

import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest
from helpers.prefect_server import provide_tables
from helpers.processes import descendants, started, wait_for

from prefect_robomaker.deployments.prefect_server.local_server import ensure_server, server_status, stop_server
from prefect_robomaker.deployments.prefect_server.secret import auth_string, server_folder
from prefect_robomaker.tasks.service.service import Service

pytestmark = [pytest.mark.deep, pytest.mark.endurance]
ROBOMAKER = [sys.executable, "-m", "prefect_robomaker.deployments.cli.main"]
ROUNDS = int(os.environ.get("ROBOMAKER_LID_ROUNDS") or 3)
RUN_S = 20.0
"""About as long as a run takes: the lid is closed before its end, at its end, and just after."""


def shown_by(url: str, secret: str) -> dict[str, list[str]]:
    """Flow runs by the names of their states, with the names of open task runs and of concurrency limits."""
    from prefect.client.orchestration import SyncPrefectClient

    with SyncPrefectClient(url, auth_string=secret) as client:
        found: dict[str, list[str]] = {}
        for run in client.read_flow_runs():
            found.setdefault((run.state and run.state.name) or "", []).append(run.name)
        found["open tasks"] = [
            task.name for task in client.read_task_runs() if not task.state or not task.state.is_final()
        ]
        found["limits"] = [limit.name for limit in client.read_global_concurrency_limits(limit=10, offset=0)]
    return {name: values for name, values in found.items() if values}


@pytest.mark.timeout(3600)
def test_a_run_is_shown_as_it_ended_whenever_the_lid_was_closed(
    service: Service, order: Callable[..., dict[str, Any]], spec: Callable[..., Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    seed = int(os.environ.get("ROBOMAKER_KILLS_SEED") or random.SystemRandom().randrange(10**6))
    chance = random.Random(seed)
    print(f"seed {seed}")
    for name in ("PREFECT_API_URL", "PREFECT_API_AUTH_STRING"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("PREFECT_PROFILES_PATH", os.devnull)
    provide_tables(server_folder(service.settings))
    url = ensure_server(service.settings, {})
    requests = [order({"DURATION_S": "3"}) for _ in range(3)]
    batch = {"createSimulationJobRequests": requests, "batchPolicy": {"maxConcurrency": 2}}
    path = spec({"drive": {"operation": "StartSimulationJobBatch", "input": batch}})
    environ = {"ROBOMAKER_HOME": str(service.settings.home), "CI": "true"}
    try:
        for number in range(ROUNDS):
            with_server, after_s, for_s = chance.random() < 0.5, chance.uniform(0, RUN_S), chance.uniform(32, 50)
            with started([*ROBOMAKER, "run", str(path)], environ, stderr=subprocess.PIPE) as robomaker:
                time.sleep(after_s)
                asleep = {robomaker.pid, *descendants(robomaker.pid)}
                asleep |= {server_status(service.settings, {}).pid or 0} - {0} if with_server else set()
                send(asleep, signal.SIGSTOP)
                time.sleep(for_s)
                send(asleep, signal.SIGCONT)
                _, err = robomaker.communicate(timeout=400)
            print(f"{number}: closed after {after_s:.1f} s for {for_s:.0f} s, with the server: {with_server}")
            assert robomaker.returncode == 0, err
            assert "Traceback" not in err
            wait_for(
                lambda: set(shown_by(url, auth_string(service.settings))) <= {"Completed", "open tasks"}, "the ends"
            )
        wait_for(lambda: set(shown_by(url, auth_string(service.settings))) == {"Completed"}, "the ends of tasks", 500)
    finally:
        print(shown_by(url, auth_string(service.settings)))
        stop_server(service.settings)


def send(pids: set[int], number: signal.Signals) -> None:
    """Sends a signal to processes, of which some may have ended."""
    for pid in pids:
        with suppress(ProcessLookupError):
            os.kill(pid, number)
