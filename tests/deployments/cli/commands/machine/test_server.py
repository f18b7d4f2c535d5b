"""`robomaker server stop` does not take the server from under those who use it without a word."""

import os
import re
import socket
import uuid
from typing import Any

import pytest
from helpers.prefect_server import server_settings

from prefect_robomaker.deployments.cli.commands.machine import server
from prefect_robomaker.deployments.prefect_server import local_server
from prefect_robomaker.tasks.reporting.console_pages import forget_console, note_console


@pytest.mark.parametrize(
    ("users", "options", "stops"),
    [([], [], True), (["the run nightly"], [], False), (["the run nightly"], ["--force"], True)],
    ids=["unused", "used", "forced"],
)
def test_a_server_that_is_in_use_is_stopped_only_by_force(
    robomaker: Any, monkeypatch: pytest.MonkeyPatch, users: list[str], options: list[str], stops: bool
) -> None:
    stopped: list[object] = []
    monkeypatch.setattr(server, "_users", lambda _: users)
    monkeypatch.setattr(local_server, "stop_server", lambda settings: bool(stopped.append(settings)) or True)

    ended = robomaker("server", "stop", *options)

    assert (ended.code, bool(stopped)) == (0 if stops else 2, stops)
    in_use = "was not stopped, as it is in use: the run nightly; wait for the runs and end the others, or add"
    assert (in_use in ended.err) is not stops


def test_force_is_for_stop_alone(robomaker: Any) -> None:
    ended = robomaker("server", "status", "--force")
    assert ended.code == 2
    assert "--force is for stop; status takes no options" in ended.err


def test_runs_that_go_on_use_the_server(prefect_server: str) -> None:
    from prefect import flow
    from prefect.client.orchestration import get_client
    from prefect.states import Completed, Running

    @flow(name="night")
    def night() -> None:
        """Does nothing."""

    with get_client(sync_client=True) as client:
        run = client.create_flow_run(night, name="nightly-in-use", state=Running())
        in_use = server._users(server_settings())
        client.set_flow_run_state(run.id, Completed())
    assert in_use, "there may be those of other tests, too"


def test_a_prefect_worker_is_named_with_when_it_was_heard_of(prefect_server: str) -> None:
    """One that has just been ended is there for the server until its heartbeats have been missed."""
    from prefect.client.orchestration import get_client
    from prefect.client.schemas.actions import WorkPoolCreate

    name = f"heard-{uuid.uuid4().hex[:8]}"
    with get_client(sync_client=True) as client:
        client.create_work_pool(WorkPoolCreate(name=name, type="process"))
        client.send_worker_heartbeat(name, name)
        in_use = server._users(server_settings())
        client.delete_work_pool(name)
    (told,) = [each for each in in_use if name in each]
    assert re.fullmatch(rf"the Prefect worker {name} \(last heard of \d+ s ago\)", told)


def test_a_serve_without_jobs_uses_the_server(prefect_server: str) -> None:
    home = server_settings().home
    with socket.create_server(("127.0.0.1", 0)) as listener:
        url = f"http://127.0.0.1:{listener.getsockname()[1]}/console"
        said = f"robomaker serve at {url}, process {os.getpid()}"
        found = []
        for prefect_url in (prefect_server.removesuffix("/api"), "http://127.0.0.1:9", None):
            note_console(home, url, prefect_url)
            found.append(said in server._users(server_settings()))
    assert found == [True, False, False]
    note_console(home, url, prefect_server.removesuffix("/api"))
    assert said not in server._users(server_settings()), "it has ended"
    forget_console(home)


def test_a_server_that_does_not_say_who_uses_it_is_stopped_only_by_force(
    robomaker: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A busy one, with many runs, answers late."""
    stopped: list[object] = []
    busy = local_server.ServerStatus(running=False, api_url="http://127.0.0.1:9/api", busy=True)
    monkeypatch.setattr(local_server, "server_status", lambda *_: busy)
    monkeypatch.setattr(local_server, "stop_server", lambda settings: bool(stopped.append(settings)) or True)

    ended = robomaker("server", "stop")

    assert (ended.code, stopped) == (2, [])
    assert "it does not say who uses it" in ended.err
    assert (robomaker("server", "stop", "--force").code, len(stopped)) == (0, 1)
