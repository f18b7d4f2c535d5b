import logging
import os
import tempfile
from pathlib import Path
from typing import Any

import pytest

from prefect_robomaker.tasks.runtime.process import rehearsal
from prefect_robomaker.tasks.runtime.supervision.launcher import Launcher


def always() -> bool:
    return True


def test_all_that_comes_before_the_first_step_is_rehearsed(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    with rehearsal.rehearsal_room() as room, caplog.at_level(logging.WARNING):
        assert room is not None
        assert len(list(rehearsal._parts(room, tmp_path))) == 5
    assert not room.exists()
    assert not caplog.records
    assert (tmp_path / "recording.mcap").stat().st_size > 1000


def test_it_ends_when_there_is_a_run_and_leaves_nothing() -> None:
    asked: list[float] = []

    def has_run(wait_s: float) -> bool:
        asked.append(wait_s)
        return len(asked) == 3

    with rehearsal.rehearsal_room() as room:
        assert room is not None
        before = sorted(room.iterdir())
        rehearsal.rehearse(room, has_run, always)
        assert sorted(room.iterdir()) == before
    assert asked == [0.0, 0.0, 0.0]


def test_what_fails_is_not_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rehearsal.rehearse(tmp_path, lambda _: False, always)  # there is no world
    assert list(tmp_path.iterdir()) == []
    assert capsys.readouterr() == ("", "")


def test_nothing_is_rehearsed_where_there_is_no_room(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tempfile, "tempdir", "/no/such/folder")
    with rehearsal.rehearsal_room() as room:
        assert room is None
        rehearsal.rehearse(room, lambda _: False, always)


@pytest.mark.deep
def test_a_launcher_starts_where_nothing_can_be_rehearsed(make_plan: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TMPDIR", "/proc")
    with Launcher() as launcher:
        assert launcher.run(make_plan("Judging"), lambda: None).status == "Completed"


def test_nothing_is_rehearsed_where_all_processors_have_work(tmp_path: Path) -> None:
    loadavg = tmp_path / "loadavg"
    for running, has_idle in ((1, True), (2, True), (3, False), (9, False)):
        loadavg.write_text(f"0.20 0.18 0.12 {running}/80 11206\n")
        assert rehearsal.has_idle_processor(loadavg, processors=2) is has_idle
    loadavg.unlink()
    assert not rehearsal.has_idle_processor(loadavg, processors=2)


def test_rooms_of_processes_that_were_killed_are_removed_and_those_that_live_keep_theirs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    left, new = (Path(tempfile.mkdtemp(prefix="robomaker-rehearsal-")) for _ in range(2))
    (left / "world.xml").write_text("<mujoco/>")
    with rehearsal.rehearsal_room() as lives:
        assert lives is not None
        for folder in (left, lives):
            os.utime(folder, (0, 0))
        with rehearsal.rehearsal_room():
            assert not left.exists()
            assert new.is_dir(), "it may not be locked yet"
            assert (lives / "world.xml").is_file()
