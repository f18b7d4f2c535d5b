"""`robomaker results`: the table of a run in a file."""

from pathlib import Path

import pyarrow.parquet as pq
import pytest
from helpers.command_here import Command
from helpers.night_records import make_night, store_night
from pyarrow import csv

from prefect_robomaker.tasks.results.table import RESULTS_FILE, ResultTable


def stored(home: Path, letters: str, night: int = 0) -> str:
    record = make_night(letters, night, runs=home / "runs")
    ResultTable.of(record.jobs).write(store_night(record) / RESULTS_FILE)
    return record.run_id


def test_it_writes_the_latest_run_and_says_how_that_stands(robomaker: Command, home: Path, tmp_path: Path) -> None:
    stored(home, "PP")
    run_id = stored(home, "PFE", night=1)
    path = tmp_path / "jobs.parquet"
    path.write_text("earlier")
    ended = robomaker("results", "--to", path)

    assert (ended.code, ended.out) == (0, f"{path}\n")
    assert ended.err == f"{run_id}: broken: 1 of 3 jobs passed, 1 broke; 3 rows\n"
    assert pq.read_table(path)["outcome"].to_pylist() == ["passed", "failed", "broken"]


def test_without_a_file_it_prints_csv(robomaker: Command, home: Path, tmp_path: Path) -> None:
    run_id = stored(home, "PF")
    stored(home, "P", night=1)
    (tmp_path / "printed.csv").write_text(robomaker("results", run_id).out)
    robomaker("results", home / "runs" / run_id, "--to", tmp_path / "written.csv")

    for name in ("printed.csv", "written.csv"):
        assert csv.read_csv(tmp_path / name)["outcome"].to_pylist() == ["passed", "failed"]


def test_other_forms_and_unknown_runs_are_refused_in_a_sentence(robomaker: Command, home: Path, tmp_path: Path) -> None:
    ended = robomaker("results", "--to", tmp_path / "jobs.xlsx")
    assert (ended.code, ended.err) == (
        2,
        f"robomaker: --to is {tmp_path / 'jobs.xlsx'}; a name that ends with .parquet or .csv would be right\n",
    )
    run_id = stored(home, "P")
    ended = robomaker("results", "other", "--to", tmp_path / "jobs.csv")
    assert (ended.code, run_id in ended.err) == (2, True)
    assert list(tmp_path.glob("jobs*")) == []


@pytest.mark.parametrize("name", ["x.csv", "x.parquet"])
def test_where_nothing_can_be_written_a_sentence_names_the_file(robomaker: Command, home: Path, name: str) -> None:
    stored(home, "P")
    ended = robomaker("results", "--to", f"/proc/{name}")

    assert (ended.code, ended.out) == (2, "")
    assert ended.err.startswith(f"robomaker: --to is /proc/{name}, which cannot be written: no such file or directory;")
    assert ended.err.count("\n") == 1
