"""rerun: what is refused before anything runs; `test_rerun_and_reuse.py` has what runs."""

from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest

from prefect_robomaker.deployments.cli.commands.runs.rerun import again
from prefect_robomaker.deployments.cli.grammar import build_parser
from prefect_robomaker.schemas.reports.challenge import Challenge
from prefect_robomaker.schemas.reports.run_record import RunRecord


@pytest.fixture
def run_id(home: Path) -> str:
    """A run that made no jobs."""
    folder = home / "runs" / "night-1"
    folder.mkdir(parents=True)
    moment = datetime(2026, 3, 2, tzinfo=UTC)
    record = RunRecord(
        run_id="night-1", name="night", spec_path="night.yaml", state="broken", exit_code=3, started_at=moment,
        ended_at=moment, steps=[], run_dir=folder,
    )  # fmt: skip
    (folder / "run.json").write_text(record.model_dump_json())
    return record.run_id


def test_a_run_without_jobs_is_run_anew(robomaker: Any, run_id: str, home: Path) -> None:
    for run in (run_id, "latest", home / "runs" / run_id):
        ended = robomaker("rerun", run, "--failed")
        assert ended.code == 2
        told = "the run night-1 made no simulation jobs; `robomaker run night.yaml` runs all of it again"
        assert told in ended.err


def test_a_challenge_is_run_anew(robomaker: Any, run_id: str, home: Path) -> None:
    path = home / "runs" / run_id / "run.json"
    record = RunRecord.model_validate_json(path.read_bytes())
    path.write_text(record.model_copy(update={"challenge": Challenge(sabotages=[]), "probe": True}).model_dump_json())
    ended = robomaker("rerun", run_id, "--failed")
    assert ended.code == 2
    assert ended.err.endswith(
        "the run night-1 is a challenge, whose sabotaged jobs say nothing one by one; "
        "`robomaker challenge night.yaml` runs it again\n"
    )


def test_the_command_that_runs_it_again_has_all_options() -> None:
    given = build_parser().parse_args(["rerun", "latest", "--failed", "--world", "flat 3", "--timeout-s", "900"])
    assert again(given, "night-1") == [
        "robomaker", "rerun", "night-1", "--failed", "--world", "flat 3", "--timeout-s", "900"
    ]  # fmt: skip


def test_there_has_to_be_such_a_run(robomaker: Any, run_id: str) -> None:
    ended = robomaker("rerun", "night-2")
    assert ended.code == 2
    assert "there is no run 'night-2'" in ended.err
    assert "the latest are night-1" in ended.err


def test_the_report_needs_a_folder_that_exists(robomaker: Any, run_id: str) -> None:
    ended = robomaker("rerun", run_id, "--report", "/nowhere/report.html")
    assert ended.code == 2
    assert "--report is /nowhere/report.html" in ended.err
