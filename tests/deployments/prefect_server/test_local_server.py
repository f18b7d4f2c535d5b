import http.server
import json
import os
import shutil
import signal
import socket
import subprocess
import sys
import threading
import urllib.request
import uuid
from collections.abc import Iterator
from pathlib import Path

import pytest
from helpers.ports import free_port
from helpers.prefect_server import server_settings
from helpers.processes import started, wait_for

from prefect_robomaker.deployments.prefect_server import local_server, outage
from prefect_robomaker.deployments.prefect_server.local_server import (
    LocalServerError,
    client_variables,
    configured_api_url,
    ensure_server,
    server_status,
    stop_server,
)
from prefect_robomaker.schemas.settings import Settings
from prefect_robomaker.schemas.wire.errors import ConfigurationError

NOTHING = {"PREFECT_PROFILES_PATH": "/nowhere"}


def test_the_server_is_started_once_and_reused(prefect_server: str) -> None:
    status = server_status(server_settings(), {})

    assert ensure_server(server_settings(), {}) == prefect_server == status.api_url
    assert status.running
    assert prefect_server.startswith("http://127.0.0.1:")
    with urllib.request.urlopen(f"{prefect_server}/health") as answer:
        assert answer.status == 200


def test_the_page_of_the_server_is_told_where_its_api_is(prefect_server: str) -> None:
    with urllib.request.urlopen(f"{prefect_server.removesuffix('/api')}/ui-settings") as answer:
        assert json.load(answer)["api_url"] == prefect_server


@pytest.mark.deep
@pytest.mark.slow
def test_an_active_schedule_gets_runs(prefect_server: str) -> None:
    from prefect.client.orchestration import get_client
    from prefect.client.schemas.actions import DeploymentScheduleCreate
    from prefect.client.schemas.filters import DeploymentFilter, DeploymentFilterId
    from prefect.client.schemas.schedules import CronSchedule

    with get_client(sync_client=True) as client:
        flow_id = client.create_flow_from_name(f"nightly-{uuid.uuid4().hex}")
        schedule = DeploymentScheduleCreate(schedule=CronSchedule(cron="* * * * *", timezone="UTC"), active=True)
        deployment_id = client.create_deployment(flow_id, "nightly", schedules=[schedule])
        wanted = DeploymentFilter(id=DeploymentFilterId(any_=[deployment_id]))
        try:
            # The server looks for schedules every few seconds, slower under load.
            runs = wait_for(lambda: client.read_flow_runs(deployment_filter=wanted), "a run of an active cron", 240)
        finally:
            client.delete_deployment(deployment_id)

    assert {run.state_name for run in runs} <= {"Scheduled", "Late"}
    log = Path(str(server_settings().home / "prefect" / "server.log")).read_text()
    assert "bulk DML" not in log


def test_the_server_of_the_home_that_was_copied_is_not_the_one_of_the_copy(
    settings: Settings, prefect_server: str
) -> None:
    shared = server_settings()
    copy = settings.home / "prefect"
    copy.mkdir(parents=True)
    shutil.copyfile(shared.home / "prefect" / "server.json", copy / "server.json")

    assert not server_status(settings, NOTHING).running
    assert not stop_server(settings)
    assert server_status(shared, NOTHING).running


def test_a_state_file_of_a_dead_server_is_not_believed(settings: Settings) -> None:
    folder = settings.home / "prefect"
    folder.mkdir(parents=True)
    (folder / "server.json").write_text('{"running": true, "api_url": "http://127.0.0.1:1/api", "pid": 1}')

    assert not server_status(settings, {}).running
    assert not stop_server(settings)


def test_a_server_that_is_started_again_has_the_port_it_had(tmp_path: Path) -> None:
    memory = tmp_path / "port"

    def port() -> int:
        with local_server._listener(memory) as listener:
            return listener.getsockname()[1]

    first = port()
    assert port() == first
    assert first < 32_768, "no client is given it while the server is away"
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", first))
        taken.listen()
        assert port() != first
    for nonsense in ("nonsense", "99999999"):
        memory.write_text(nonsense)
        assert port() > 0


def test_a_damaged_state_file_counts_as_no_server(settings: Settings) -> None:
    folder = settings.home / "prefect"
    folder.mkdir(parents=True)
    (folder / "server.json").write_text("{")

    assert not server_status(settings, {}).running


def test_a_configured_server_that_does_not_answer_is_named(settings: Settings) -> None:
    with pytest.raises(ConfigurationError, match=r"http://127\.0\.0\.1:1/api"):
        ensure_server(settings, {"PREFECT_API_URL": "http://127.0.0.1:1/api"})


SMALL = """
import http.server, sys

class Answer(http.server.BaseHTTPRequestHandler):
    def do_GET(self):
        self.send_response(200)
        self.send_header("content-length", "0")
        self.end_headers()

http.server.HTTPServer(("127.0.0.1", int(sys.argv[-1])), Answer).serve_forever()
"""
"""Facts about a server: its program, its port, and that it answers."""


@pytest.fixture
def small_server(settings: Settings) -> Iterator[int]:
    """The process of a small program that counts as the local server; the test may stop it for a while."""
    port, folder = free_port(), settings.home / "prefect"
    folder.mkdir(parents=True)
    command = [sys.executable, "-c", SMALL, local_server._PROGRAM, "--port", str(port)]
    with started(command, {}, stderr=subprocess.DEVNULL) as process:
        state = {"running": True, "api_url": f"http://127.0.0.1:{port}/api", "pid": process.pid}
        (folder / "server.json").write_text(json.dumps(state))
        wait_for(lambda: server_status(settings, NOTHING).running, "the server")
        yield process.pid


def test_a_server_that_is_busy_is_waited_for_and_not_started_anew(
    small_server: int, settings: Settings, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = server_status(settings, NOTHING)
    url = str(before.api_url)
    for environ in (NOTHING, {"PREFECT_API_URL": url}):
        caplog.clear()

        def go_on_once_it_is_waited_for() -> None:
            wait_for(lambda: f"the Prefect server at {url} is busy and does not answer; waiting" in caplog.text, "it")
            os.kill(small_server, signal.SIGCONT)

        going_on = threading.Thread(target=go_on_once_it_is_waited_for)
        os.kill(small_server, signal.SIGSTOP)
        going_on.start()
        with monkeypatch.context() as impatient:
            impatient.setattr(outage, "_TIMEOUT_S", 1.0)
            assert ensure_server(settings, environ) == url
        going_on.join()
        assert server_status(settings, NOTHING) == before, "the same process"


def test_the_active_prefect_profile_is_respected(tmp_path: Path) -> None:
    profiles = tmp_path / "profiles.toml"
    profiles.write_text('active = "team"\n[profiles.team]\nPREFECT_API_URL = "https://prefect.example/api"\n')

    assert configured_api_url({"PREFECT_PROFILES_PATH": str(profiles)}) == "https://prefect.example/api"
    assert configured_api_url({"PREFECT_PROFILES_PATH": str(profiles), "PREFECT_PROFILE": "other"}) is None
    assert configured_api_url({"PREFECT_HOME": str(tmp_path / "nowhere")}) is None


def test_no_other_program_can_take_the_port_while_the_server_starts(
    settings: Settings, monkeypatch: pytest.MonkeyPatch
) -> None:
    def take(process: subprocess.Popen[bytes], api_url: str, log: Path) -> None:
        with socket.socket() as squatter:
            squatter.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            squatter.bind(("127.0.0.1", int(api_url.removesuffix("/api").rpartition(":")[2])))
            squatter.listen()

    monkeypatch.setattr(local_server, "_wait_until_healthy", take)
    try:
        with pytest.raises(OSError, match="Address already in use"):
            ensure_server(settings, {"PREFECT_HOME": str(settings.home)})
    finally:
        stop_server(settings)


def test_a_server_that_dies_while_it_starts_is_not_waited_for(
    settings: Settings, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(local_server, "_PROGRAM", "no_such_module")

    with pytest.raises(LocalServerError, match="No module named no_such_module"):
        ensure_server(settings, {"PREFECT_HOME": str(settings.home)})


def test_the_secret_is_not_for_what_answers_at_the_address_of_a_dead_server(settings: Settings) -> None:
    folder = settings.home / "prefect"
    folder.mkdir(parents=True)
    url = "http://127.0.0.1:1/api"
    (folder / "server.json").write_text(json.dumps({"running": True, "api_url": url, "pid": 1}))

    assert client_variables(url, settings, {"PREFECT_API_URL": url}) == {"PREFECT_API_URL": url}


def test_an_interrupted_start_leaves_no_server(settings: Settings, monkeypatch: pytest.MonkeyPatch) -> None:
    started: list[subprocess.Popen[bytes]] = []
    imported: list[str] = []

    def interrupt(process: subprocess.Popen[bytes], api_url: str, _: object) -> None:
        assert imported == [api_url], "before the server is waited for"
        started.append(process)
        raise KeyboardInterrupt

    monkeypatch.setattr(local_server, "_wait_until_healthy", interrupt)
    with pytest.raises(KeyboardInterrupt):
        ensure_server(settings, {"PREFECT_HOME": str(settings.home)}, meanwhile=imported.append)

    assert started[0].returncode is not None
    assert not server_status(settings, {}).running


def test_a_process_with_the_id_of_a_dead_server_is_not_stopped(settings: Settings) -> None:
    folder = settings.home / "prefect"
    folder.mkdir(parents=True)
    with subprocess.Popen(["sleep", "60"]) as other:
        state = {"running": True, "api_url": "http://127.0.0.1:1/api", "pid": other.pid}
        (folder / "server.json").write_text(json.dumps(state))

        assert not stop_server(settings)
        assert other.poll() is None
        other.kill()


@pytest.mark.deep
def test_a_server_that_does_not_end_has_ended_when_it_counts_as_stopped(settings: Settings) -> None:
    folder = settings.home / "prefect"
    folder.mkdir(parents=True)
    program = """if True:
        import signal, socket, time
        signal.signal(signal.SIGTERM, signal.SIG_IGN)
        ballast = bytearray(2**30)
        listener = socket.create_server(("127.0.0.1", 0))
        print(listener.getsockname()[1], flush=True)
        time.sleep(300)
    """
    command = [sys.executable, "-c", program, local_server._PROGRAM, "--port", "1"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, start_new_session=True) as stubborn:
        assert stubborn.stdout is not None
        port = int(stubborn.stdout.readline())
        state = {"running": True, "api_url": "http://127.0.0.1:1/api", "pid": stubborn.pid}
        (folder / "server.json").write_text(json.dumps(state))

        assert stop_server(settings)
        with socket.create_server(("127.0.0.1", port)):
            """Its port is free."""


@pytest.mark.parametrize(("code", "usable"), [(200, True), (401, True), (403, True), (404, False), (503, False)])
def test_a_server_that_asks_for_a_login_counts_as_one(settings: Settings, code: int, usable: bool) -> None:
    class Answer(http.server.BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            self.send_response(code)
            self.send_header("Content-Length", "0")
            self.end_headers()

        def log_message(self, format: str, *arguments: object) -> None:  # noqa: A002 - its name there
            """Says nothing."""

    with http.server.HTTPServer(("127.0.0.1", 0), Answer) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        url = f"http://127.0.0.1:{server.server_address[1]}/api"
        status = server_status(settings, {"PREFECT_API_URL": url})
        server.shutdown()
        thread.join()

    assert (status.running, status.configured_elsewhere) == (usable, True)
