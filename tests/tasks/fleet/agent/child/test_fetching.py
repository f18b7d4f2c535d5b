"""Fetching a file: what was signed, and nothing else, has its name in the end."""

import hashlib
import resource
from pathlib import Path

import pytest

from prefect_robomaker.tasks.fleet.agent.child.fetching import HttpStatus, Part, fetch
from prefect_robomaker.tasks.fleet.agent.deployment import File
from prefect_robomaker.tasks.fleet.agent.errors import StepFailed, TryLater

CONTENT = bytes(range(250)) * 4
FILE = File("applications/courier/bundles/x", len(CONTENT), hashlib.sha256(CONTENT).hexdigest())


class Store:
    """Sends what it is told to, and remembers from where."""

    def __init__(self, content: bytes, *, knows_ranges: bool = True, cut: int | None = None) -> None:
        self.content = content
        self.knows_ranges = knows_ranges
        self.cut = cut
        self.starts: list[int] = []

    def __call__(self, path: str, start: int) -> Part:
        assert path == f"targets/{FILE.address}"
        self.starts.append(start)
        start = start if self.knows_ranges else 0
        rest = self.content[start : self.cut]
        return Part(start, (rest[place : place + 100] for place in range(0, len(rest), 100)))


def test_what_was_cut_is_fetched_from_there_and_what_is_there_not_again(tmp_path: Path) -> None:
    told: list[tuple[int, int]] = []
    with pytest.raises(TryLater, match="300 of 1000 bytes"):
        fetch(Store(CONTENT, cut=300), FILE, tmp_path / "x")
    store = Store(CONTENT)
    fetch(store, FILE, tmp_path / "x", lambda done, of: told.append((done, of)))
    fetch(store, FILE, tmp_path / "x")

    assert (tmp_path / "x").read_bytes() == CONTENT
    assert store.starts == [300]
    assert (told[0], told[-1]) == ((300, 1000), (1000, 1000))


def test_a_server_that_knows_no_ranges_sends_all_again(tmp_path: Path) -> None:
    (tmp_path / "x.part").write_bytes(CONTENT[:300])
    fetch(Store(CONTENT, knows_ranges=False), FILE, tmp_path / "x")

    assert (tmp_path / "x").read_bytes() == CONTENT


@pytest.mark.parametrize("content", [b"\xff" + CONTENT[1:], CONTENT + b"x"], ids=["other", "longer"])
@pytest.mark.parametrize("there", [0, 300])
def test_what_was_not_signed_is_thrown_away(content: bytes, there: int, tmp_path: Path) -> None:
    (tmp_path / "x.part").write_bytes(content[:there])
    with pytest.raises(StepFailed) as caught:
        fetch(Store(content), FILE, tmp_path / "x")

    assert caught.value.code == "EtagMismatch"
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("status", [401, 429, 500, 503])
def test_a_server_that_cannot_now_is_asked_later(status: int, tmp_path: Path) -> None:
    def refuse(path: str, start: int) -> Part:
        raise HttpStatus(status)

    with pytest.raises(TryLater, match=str(status)):
        fetch(refuse, FILE, tmp_path / "x")


@pytest.mark.parametrize("name", ["x", "x.part"])
def test_what_a_power_loss_damaged_is_fetched_anew(name: str, tmp_path: Path) -> None:
    """Neither is synced: a file may be as long as it was, and have zeros for what did not reach the disk."""
    (tmp_path / name).write_bytes(bytes(len(CONTENT)))
    store = Store(CONTENT)

    fetch(store, FILE, tmp_path / "x")

    assert (tmp_path / "x").read_bytes() == CONTENT
    assert store.starts == [0]


def test_a_disk_that_is_full_is_told_and_given_back(tmp_path: Path) -> None:
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (len(CONTENT) // 2, limits[1]))
    try:
        with pytest.raises(StepFailed, match="the disk is full: storing applications/courier/bundles/x") as caught:
            fetch(Store(CONTENT), FILE, tmp_path / "x")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)

    assert caught.value.code == "EnvironmentSetupError"
    assert list(tmp_path.iterdir()) == []
