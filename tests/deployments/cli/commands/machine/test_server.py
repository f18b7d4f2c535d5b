"""`robomaker server stop` does not take the server from under those who use it without asking."""

import io
import sys
from typing import Any

import pytest
from helpers.prefect_server import server_settings

from prefect_robomaker.deployments.cli.commands.machine import server
from prefect_robomaker.deployments.prefect_server import local_server


class Terminal(io.StringIO):
    """Standard input that is a terminal."""

    def isatty(self) -> bool:
        """Says so."""
        return True


@pytest.mark.parametrize(
    ("users", "typed", "stops"),
    [
        ([], Terminal(""), True),
        (["the run nightly"], Terminal("n\n"), False),
        (["the run nightly"], Terminal("\n"), False),
        (["the run nightly"], Terminal("y\n"), True),
        (["the run nightly"], io.StringIO(), True),  # a script, or systemd
    ],
    ids=["unused", "no", "return", "yes", "no terminal"],
)
def test_stopping_a_server_that_is_in_use_is_asked_for_in_a_terminal(
    robomaker: Any, monkeypatch: pytest.MonkeyPatch, users: list[str], typed: Any, stops: bool
) -> None:
    stopped: list[object] = []
    monkeypatch.setattr(server, "_users", lambda _: users)
    monkeypatch.setattr(local_server, "stop_server", lambda settings: bool(stopped.append(settings)) or True)
    monkeypatch.setattr(sys, "stdin", typed)

    ended = robomaker("server", "stop")

    assert (ended.code, bool(stopped)) == (0, stops)
    assert ("the run nightly" in ended.err) == bool(users)


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
