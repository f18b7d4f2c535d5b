"""How servers do: one that answers, one that listens and is silent, none at all; and waiting for a silent one."""

import socket

import pytest

from prefect_robomaker.deployments.prefect_server import outage
from prefect_robomaker.deployments.prefect_server.outage import Health, health_of, wait_while_busy


def test_a_server_that_answers_is_healthy(prefect_server: str) -> None:
    assert health_of(prefect_server) is Health.HEALTHY


def test_a_program_that_listens_and_is_silent_is_busy(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(outage, "_TIMEOUT_S", 0.2)
    with socket.create_server(("127.0.0.1", 0)) as silent:
        assert health_of(f"http://127.0.0.1:{silent.getsockname()[1]}/api") is Health.BUSY


@pytest.mark.parametrize("api_url", ["http://127.0.0.1:1/api", "nonsense"])
def test_none_is_away(api_url: str) -> None:
    assert health_of(api_url) is Health.AWAY


@pytest.mark.parametrize("last", [Health.HEALTHY, Health.AWAY])
def test_waiting_ends_with_the_first_answer_and_is_told(last: Health, caplog: pytest.LogCaptureFixture) -> None:
    answers = iter([Health.BUSY, Health.BUSY, last])
    assert wait_while_busy(lambda: next(answers), "the server") is last
    assert caplog.text.count("the server is busy and does not answer; waiting for it, 90 s at most") == 1


def test_patience_ends() -> None:
    now = iter(range(0, 1000, 5))
    assert wait_while_busy(lambda: Health.BUSY, "the server", 20, lambda: next(now)) is Health.BUSY
