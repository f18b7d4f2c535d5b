"""The memory that containers of a job share."""

import os
from pathlib import Path

import pytest

from prefect_robomaker.tasks.simulations.environment.folders import make_shared_memory, remove_shared_memory


@pytest.fixture
def memory(tmp_path: Path) -> Path:
    (tmp_path / "memory").mkdir()
    return tmp_path / "memory"


@pytest.fixture
def run(tmp_path: Path) -> Path:
    (tmp_path / "run").mkdir()
    return tmp_path / "run"


def test_all_containers_of_a_run_have_one_and_other_runs_another(memory: Path, run: Path) -> None:
    shared = make_shared_memory(run, memory)

    assert make_shared_memory(run, memory) == shared
    assert make_shared_memory(run.parent, memory) != shared
    assert shared.is_relative_to(memory)
    assert shared.stat().st_mode & 0o7777 == 0o1777
    assert shared.parent.stat().st_mode & 0o777 == 0o700, "other users of this machine stay out"


def test_it_is_removed_with_what_was_left_in_it(memory: Path, run: Path) -> None:
    (make_shared_memory(run, memory) / "left").write_text("left")

    remove_shared_memory(run, memory)
    remove_shared_memory(run, memory)

    assert list(memory.iterdir()) == list(run.iterdir()) == []


def test_a_machine_without_memory_for_files_uses_the_disk(run: Path, tmp_path: Path) -> None:
    assert make_shared_memory(run, tmp_path / "none").is_relative_to(run)


def test_what_somebody_else_put_there_before_is_not_used(memory: Path, run: Path, tmp_path: Path) -> None:
    private = make_shared_memory(run, memory).parent
    remove_shared_memory(run, memory)
    (tmp_path / "theirs").mkdir()
    private.symlink_to(tmp_path / "theirs")

    assert make_shared_memory(run, memory).is_relative_to(run)
    assert list((tmp_path / "theirs").iterdir()) == []
    if os.getuid() == 0:
        private.unlink()
        private.mkdir()
        os.chown(private, 4321, 4321)
        assert make_shared_memory(run, memory).is_relative_to(run)
