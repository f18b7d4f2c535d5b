"""gc: what it says, asks, and refuses."""

import os
import re
import sqlite3
import subprocess
import sys
import tempfile
from contextlib import closing
from datetime import UTC, datetime, timedelta
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from helpers.processes import started

from prefect_robomaker.deployments.cli.doctor_checks import check_left_behind
from prefect_robomaker.schemas.reports.retention import GcReport
from prefect_robomaker.schemas.reports.run_record import RunRecord
from prefect_robomaker.schemas.settings import Settings


@pytest.fixture
def old_run(home: Path) -> Path:
    """A run without jobs, of long ago."""
    folder, ended = home / "runs" / "night-1", datetime.now(UTC) - timedelta(days=40)
    folder.mkdir(parents=True)
    record = RunRecord(
        run_id="night-1", name="night", spec_path="night.yaml", state="succeeded", exit_code=0, started_at=ended,
        ended_at=ended, steps=[], run_dir=folder,
    )  # fmt: skip
    (folder / "run.json").write_text(record.model_dump_json())
    (folder / "report.html").write_text("a report")
    return folder


def test_a_dry_run_shows_and_removes_nothing(robomaker: Any, old_run: Path) -> None:
    told = robomaker("gc", "--older-than", "30d", "--dry-run")

    assert told.code == 0, told.err
    assert "night-1" in told.out
    assert "Would free" in told.out
    assert "1 run." in told.out
    assert old_run.exists()


def test_yes_removes_without_asking(robomaker: Any, old_run: Path) -> None:
    told = robomaker("gc", "--older-than", "4w2d", "--yes", "-o", "json")

    assert told.code == 0, told.err
    report = GcReport.model_validate_json(told.out)
    assert not report.dry_run
    assert [(item.id, item.action) for item in report.items] == [("night-1", "remove")]
    assert not old_run.exists()
    assert robomaker("gc", "--older-than", "30d", "--yes").out.splitlines()[-1] == "Nothing to remove."


def test_it_says_how_large_the_database_of_prefect_is_and_what_it_gives_back(robomaker: Any, home: Path) -> None:
    path = home / "prefect" / "prefect.db"
    path.parent.mkdir(parents=True)
    with closing(sqlite3.connect(path)) as database, database:
        database.execute("CREATE TABLE log (text)")
        database.executemany("INSERT INTO log VALUES (?)", [("x" * 4000,) for _ in range(500)])
        database.execute("DELETE FROM log")
    size = path.stat().st_size

    looked = robomaker("gc", "--older-than", "30d", "--dry-run")
    assert "the database of the local Prefect server has 2.1 MB, of which 2.0 MB are given back\n" in looked.out
    assert "Would free 2.0 MB in 0 objects: free space of Prefect's database.\n" in looked.out
    assert path.stat().st_size == size
    told = robomaker("gc", "--older-than", "30d", "--yes")

    assert re.search(
        r"the database of the local Prefect server has [\d.]+ (kB|bytes), 2.0 MB less than before", told.out
    )
    assert path.stat().st_size < 100_000


def test_what_stays_is_told_with_its_reason(robomaker: Any, old_run: Path) -> None:
    told = robomaker("gc", "--keep-runs", "1", "--dry-run")

    assert "kept 1: one of the newest 1 of night" in told.out
    assert told.out.splitlines()[-1] == "Nothing to remove."


def test_nobody_to_ask_is_an_error(robomaker: Any, old_run: Path) -> None:
    told = robomaker("gc", "--older-than", "30d")

    assert (told.code, told.out) == (2, "")
    assert "there is no terminal to ask on; --yes removes, --dry-run only shows" in told.err
    assert old_run.exists()


@pytest.mark.parametrize(("answer", "stays"), [("n", True), ("", True), ("y", False), ("YES", False)])
def test_it_asks_on_a_terminal(
    robomaker: Any, old_run: Path, monkeypatch: pytest.MonkeyPatch, answer: str, stays: bool
) -> None:
    class Terminal:
        def isatty(self) -> bool:
            return True

        def readline(self) -> str:
            return f"{answer}\n"

    monkeypatch.setattr("sys.stdin", Terminal())
    told = robomaker("gc", "--older-than", "30d")

    assert told.code == 0
    assert "Remove them? [y/N]" in told.err
    assert old_run.exists() == stays
    assert ("Freed" in told.out) != stays


@pytest.mark.parametrize(
    ("words", "error"),
    [
        ([], "--older-than 30d or --keep-runs 20"),
        (["--older-than", "30"], "--older-than is '30'; a time such as 30d, 12h or 1d12h would be right"),
        (["--older-than", "999999999w"], "--older-than is '999999999w'"),
        (["--older-than", ""], "--older-than is ''"),
        (["--keep-runs", "-1"], "--keep-runs is -1; it has to be a whole number from 0"),
        (["--keep-runs", "3", "--orphaned-worlds"], "--orphaned-worlds goes by age"),
        (["--keep-runs", "3", "--imported-worlds"], "--imported-worlds goes by age"),
        (["--keep-runs", "3", "--orphaned-recordings"], "--orphaned-recordings goes by age"),
    ],
)
def test_bad_usage_is_told(robomaker: Any, words: list[str], error: str) -> None:
    told = robomaker("gc", *words, "--dry-run")

    assert told.code == 2
    assert error in told.err


def test_what_cannot_be_removed_is_told_and_ends_with_3(
    robomaker: Any, old_run: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*arguments: object) -> None:
        raise OSError(30, "Read-only file system")

    monkeypatch.setattr("prefect_robomaker.tasks.retention.collection.remove_unit", refuse)
    told = robomaker("gc", "--older-than", "30d", "--yes")

    assert told.code == 3
    assert "! night-1: [Errno 30] Read-only file system" in told.out
    assert "Freed, but for what is told above," in told.out


@pytest.fixture
def left_room(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder in which a job worker rehearsed that was killed."""
    temporary = tmp_path / "temporary"
    temporary.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(temporary))
    program = (
        "import time\n"
        "from prefect_robomaker.tasks.runtime.process.rehearsal import rehearsal_room\n"
        "with rehearsal_room() as room:\n"
        "    print(room, flush=True)\n"
        "    time.sleep(600)\n"
    )
    command = [sys.executable, "-c", program]
    with started(command, {"TMPDIR": str(temporary)}, stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        room = Path(process.stdout.readline().strip())
        process.kill()
    assert (room / "world.xml").is_file()
    os.utime(room, (0, 0))
    return room


def test_folders_of_rehearsals_of_killed_job_workers_are_named_and_removed(
    robomaker: Any, home: Path, left_room: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = check_left_behind(Settings.from_environment({"ROBOMAKER_HOME": str(home)}))
    assert found.health == "warning"
    assert f"{left_room}: the job worker that rehearsed there was killed" in found.found

    line = "1 folder(s) in which job workers that were killed had rehearsed"
    dry = robomaker("gc", "--older-than", "30d", "--dry-run")
    assert f"to be removed: {line}" in dry.out
    assert left_room.exists()
    # It asks, though nothing else is to be removed.
    monkeypatch.setattr("sys.stdin", SimpleNamespace(isatty=lambda: True, readline=lambda: "y\n"))
    told = robomaker("gc", "--older-than", "30d")
    assert f"to be removed: {line}" in told.out
    assert told.out.count(f" removed: {line}") + told.out.count(f"\nremoved: {line}") >= 1
    assert not left_room.exists()
    assert "had rehearsed" not in robomaker("gc", "--older-than", "30d", "--yes").out
