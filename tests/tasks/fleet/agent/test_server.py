"""The agent's connections to its server."""

import ssl
from dataclasses import replace

import pytest

from prefect_robomaker.tasks.fleet.agent import server
from prefect_robomaker.tasks.fleet.agent.errors import TryLater
from prefect_robomaker.tasks.fleet.agent.settings import Connection


def test_certificates_are_read_once_and_again_when_the_server_is_away(monkeypatch: pytest.MonkeyPatch) -> None:
    read: list[ssl.SSLContext] = []
    create = ssl.create_default_context

    def counted() -> ssl.SSLContext:
        read.append(create())
        return read[-1]

    monkeypatch.setattr(ssl, "create_default_context", counted)
    server._trusted_certificates.cache_clear()
    connection = Connection("https://127.0.0.1:1", "DEFAULT", "rover", "token")
    server.connect(connection)
    server.connect(replace(connection, url="http://127.0.0.1"))
    server.connect(connection)
    assert len(read) == 1, "by http none are needed"

    with pytest.raises(TryLater):
        server.exchange(connection, "GET", "/", None, {})
    server.connect(connection)
    assert len(read) == 2, "the machine's may have been renewed"


@pytest.mark.parametrize(("status", "taken"), [(200, True), (204, True), (400, False), (404, False), (429, False)])
def test_attributes_are_told_once_the_server_has_taken_them(
    status: int, taken: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(server, "exchange", lambda *_: (status, b""))
    robot = server.Server(Connection("http://127.0.0.1", "DEFAULT", "rover", "token"))

    assert robot.tell_attributes({"trouble": "version 2 kept restarting"}) is taken
