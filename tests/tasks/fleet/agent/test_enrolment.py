"""Enrolling, also when answers get lost."""

import hashlib
import stat
from pathlib import Path

import pytest
from helpers.agent_robot import ENROLMENT_TOKEN, ROBOT, AgentProcess, FleetServer, serving
from helpers.tuf_repository import TufRepository

from prefect_robomaker.deployments.cli.main import main


@pytest.fixture
def server(tmp_path: Path) -> FleetServer:
    return FleetServer(TufRepository(tmp_path / "repository"))


def test_the_token_is_kept_and_the_same_is_asked_again_when_the_answer_is_lost(
    server: FleetServer, tmp_path: Path
) -> None:
    agent = AgentProcess(tmp_path / "home")
    server.lost_enrolments = 1
    with serving(server) as url:
        first = agent.enroll(url, server.repository.first_root)
        second = agent.enroll(url, server.repository.first_root)
        third = agent.enroll(url, server.repository.first_root)

    assert (first.returncode, "HTTP status 502" in first.stderr) == (1, True)
    assert second.stdout == f"{ROBOT} is enrolled at {url}; `run` begins.\n", second.stderr
    assert "is enrolled already; --again" in third.stderr
    files = [agent.home / name for name in ("agent.json", "root.json")]
    assert [stat.S_IMODE(file.stat().st_mode) for file in files] == [0o600, 0o600]


@pytest.mark.parametrize(
    ("token", "said"),
    [
        ("x", "TOKEN is not right"),
        (f"{'f' * 40}-{{root}}", "does not take the token for rover"),
        (f"{ENROLMENT_TOKEN}-{'0' * 64}", "root of trust has SHA-256"),
    ],
)
def test_what_is_wrong_is_told_and_nothing_is_stored(
    server: FleetServer, tmp_path: Path, token: str, said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    root = hashlib.sha256(server.repository.first_root).hexdigest()
    words = ["agent", "enroll", "--home", str(tmp_path / "home"), "--name", ROBOT, token.replace("{root}", root)]
    with serving(server) as url:
        assert main([*words, "--url", url]) != 0

    assert said in capsys.readouterr().err
    assert not (tmp_path / "home/agent.json").exists()


def test_arguments_that_are_wrong_are_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["agent", "enroll", "--home", str(tmp_path), "x" * 40]
    assert main([*words, "--name", ROBOT, "--url", "fleet"]) != 0
    assert main([*words, "--name", "a b", "--url", "http://fleet"]) != 0
    assert main(["agent", "run", "--home", str(tmp_path)]) != 0

    said = capsys.readouterr().err
    assert "--url: 'fleet' is not right" in said
    assert "--name: 'a b' is not right" in said
    assert "enroll this robot first" in said
