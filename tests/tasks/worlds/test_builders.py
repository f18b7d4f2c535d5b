"""World builders: what happens when their processes die, hang, or are stopped."""

import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from prefect_robomaker.schemas.wire.errors import WorldGenerationError
from prefect_robomaker.tasks.worldforge.bundle.bundle import content_hash, read_world
from prefect_robomaker.tasks.worlds.builders import WorldBuilders

BODY = '{"Buildings": [{"Floors": [{"Interior": {"Furniture": {"FurnitureArrangements": []}}}]}]}'


def children_of(pid: int) -> list[int]:
    return [int(child) for child in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]


@pytest.fixture
def hurt() -> Iterator[Callable[[int], threading.Thread]]:
    """Sends a signal to the first builder that starts, as soon as it is there."""
    before = set(children_of(os.getpid()))
    threads: list[threading.Thread] = []

    def send(number: int) -> threading.Thread:
        def run() -> None:
            end = time.monotonic() + 20
            while time.monotonic() < end:
                if fresh := set(children_of(os.getpid())) - before:
                    os.kill(min(fresh), number)
                    return
                time.sleep(0.01)

        thread = threading.Thread(target=run)
        threads.append(thread)
        thread.start()
        return thread

    yield send
    for thread in threads:
        thread.join()


@pytest.fixture(autouse=True)
def only_where_processes_can_be_seen() -> None:
    if not Path(f"/proc/{os.getpid()}/task/{os.getpid()}/children").exists():
        pytest.skip("needs Linux's /proc to find the builders")


def test_a_world_whose_builder_dies_is_built_by_another(
    tmp_path: Path, hurt: Callable[[int], threading.Thread]
) -> None:
    with WorldBuilders(1, tmp_path / "log") as builders:
        hurt(signal.SIGKILL).join()
        content = builders.build(BODY, 1, 2, tmp_path / "first")
        assert content == content_hash(tmp_path / "first")
        assert read_world(tmp_path / "first").floorplan_seed == 1
        assert builders.build(BODY, 1, 2, tmp_path / "second") == content


def test_a_builder_that_answers_nothing_is_ended_and_replaced(
    tmp_path: Path, hurt: Callable[[int], threading.Thread]
) -> None:
    with WorldBuilders(1, tmp_path / "log", most_s=15.0) as builders:
        hurt(signal.SIGSTOP).join()
        builders.most_s = 0.5
        with pytest.raises(WorldGenerationError, match=r"not built within 0\.5 s"):
            builders.build(BODY, 1, 2, tmp_path / "never")
        builders.most_s = 60.0
        assert builders.build(BODY, 1, 2, tmp_path / "world") == content_hash(tmp_path / "world")


def test_stopped_builders_fail_at_once_and_start_no_more(tmp_path: Path) -> None:
    with WorldBuilders(1, tmp_path / "log") as builders:
        threading.Timer(0.3, builders.stop).start()
        with pytest.raises(WorldGenerationError, match="ended with code -9"):
            builders.build(BODY, 1, 2, tmp_path / "never")
        with pytest.raises(WorldGenerationError, match="no more worlds"):
            builders.build(BODY, 1, 2, tmp_path / "never")


def test_a_folder_that_cannot_be_written_fails_its_world_only(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    with WorldBuilders(1, tmp_path / "log") as builders:
        with pytest.raises(WorldGenerationError, match="could not be written"):
            builders.build(BODY, 1, 2, tmp_path / "file" / "bundle")
        assert builders.build(BODY, 1, 2, tmp_path / "world") == content_hash(tmp_path / "world")
