"""The journal: what was saved is read again, whatever happens while it is written."""

import errno
from pathlib import Path

import pytest

from prefect_robomaker.tasks.fleet.agent.deployment import Deployment, File, Launch, Order, Version
from prefect_robomaker.tasks.fleet.agent.errors import AgentError
from prefect_robomaker.tasks.fleet.agent.journal import Journal
from prefect_robomaker.tasks.fleet.agent.state_machine import End, Phase, Probation, State

VERSION = Version("courier", "2", "0" * 64, Launch("courier", "drive", "before", None, {"A": "1"}), "job-2", {"B": "2"})
BUNDLE = File("applications/courier/bundles/x", 7, "0" * 64)
ORDER = Order(7, "applications/courier/deployments/job-2.json", {"B": "2"})
STATE = State(
    Phase.RETURNING,
    ORDER,
    Deployment(VERSION, BUNDLE, BUNDLE, 8),
    VERSION,
    VERSION,
    ("RobotDeploymentAborted", "it was unhealthy"),
    End(Order(6, ""), "closed", "failure", 1004, ("Launching", "it ended"), is_delivered=True),
    3,
    {"root": 1, "timestamp": 8},
    1_700_000_000.5,
    7,
    Probation(ORDER, VERSION, 2),
)


@pytest.mark.parametrize("state", [State(), STATE])
def test_what_was_saved_is_read_again(state: State, tmp_path: Path) -> None:
    Journal(tmp_path).save(state)

    assert Journal(tmp_path).load() == state
    assert (tmp_path / "journal.json").stat().st_mode & 0o777 == 0o600


def test_a_new_robot_has_nothing(tmp_path: Path) -> None:
    assert Journal(tmp_path).load() == State()


def test_what_was_saved_before_stays_where_the_disk_is_full(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    Journal(tmp_path).save(STATE)

    def full(_descriptor: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("os.fsync", full)
    with pytest.raises(OSError, match="No space"):
        Journal(tmp_path).save(State())
    assert Journal(tmp_path).load() == STATE
    assert [path.name for path in tmp_path.iterdir()] == ["journal.json"]


@pytest.mark.parametrize(("content", "said"), [("{", "is no JSON"), ('{"format": 2}', "another format than 1")])
def test_another_journal_is_told(content: str, said: str, tmp_path: Path) -> None:
    (tmp_path / "journal.json").write_text(content)

    with pytest.raises(AgentError, match=said):
        Journal(tmp_path).load()
