"""Records of runs in their folders."""

import os
import shutil
from datetime import timedelta
from pathlib import Path

import pytest
from helpers.night_records import FIRST_NIGHT, make_job, make_night, store_night

from prefect_robomaker.schemas.reports.run_record import RerunOf, RunRecord
from prefect_robomaker.schemas.wire.errors import ConfigurationError
from prefect_robomaker.tasks.comparison.compared_runs import NightRun
from prefect_robomaker.tasks.inspection.run_records import (
    find_records,
    names_of_specifications,
    read_record,
    run_before,
    since_last,
    write_record,
)

RERUN_OF = RerunOf(run_id="nightly-1", selection="failed", jobs_total=2, earlier={"drive": ["sim-1: FAIL"]})


@pytest.fixture
def runs(tmp_path: Path) -> Path:
    """Four nights of one specification and two of others."""
    for night in range(4):
        folder = store_night(make_night("PF", night, runs=tmp_path))
        os.utime(folder / "run.json", (night, night))
    for name in ("nightly-long", "other"):
        store_night(make_night("P", name=name, runs=tmp_path))
    (tmp_path / "nightly-20260309T020000000").mkdir()
    return tmp_path


def days(runs: Path, name: str = "nightly", **options: object) -> list[int]:
    return [record.started_at.day for record in find_records(runs, name, **options).records]  # type: ignore[arg-type]


def test_the_latest_runs_of_one_specification(runs: Path) -> None:
    assert days(runs) == [1, 2, 3, 4]
    assert days(runs, most=2) == [3, 4]
    assert days(runs, before=make_night("P", 2).started_at) == [1, 2]
    assert days(runs, "nightly-long") == [1]
    assert days(runs, "nothing") == []
    assert days(runs / "nowhere") == []
    assert names_of_specifications(runs) == ["nightly", "nightly-long", "other"]


def test_runs_of_other_specifications_are_not_counted(runs: Path) -> None:
    os.utime(runs / "nightly-long-20260301T020000000" / "run.json", (-1, -1))
    assert find_records(runs, "nightly", most=4).left_out == 0
    assert find_records(runs, "nightly", most=3).left_out == 1


def test_a_record_that_is_written_again_is_no_later_run(runs: Path) -> None:
    write_record(make_night("PF", 0, runs=runs))
    assert days(runs, most=2) == [3, 4]


def test_reruns_of_some_jobs_are_no_nights(runs: Path) -> None:
    store_night(make_night("F", 9, runs=runs).model_copy(update={"rerun_of": RERUN_OF}))
    assert days(runs) == [1, 2, 3, 4]


def test_the_run_before_is_the_last_whole_one_that_told_something(runs: Path) -> None:
    def before(record: RunRecord) -> int | None:
        found = run_before(record)
        return found.started_at.day if found else None

    assert before(make_night("P", 4, runs=runs)) == 4
    assert before(make_night("P", 0, runs=runs)) is None
    store_night(make_night("P", 4, runs=runs).model_copy(update={"rerun_of": RERUN_OF}))
    store_night(make_night("P", 5, runs=runs).model_copy(update={"state": "canceled"}))
    store_night(make_night("P", 6, runs=runs).model_copy(update={"ended_at": FIRST_NIGHT + timedelta(days=9)}))
    (runs / "nightly-20260308T020000000").mkdir()
    (runs / "nightly-20260308T020000000" / "run.json").write_text("{")
    assert before(make_night("P", 8, runs=runs)) == 4


def test_records_survive_being_written(runs: Path) -> None:
    record = make_night("PFE", 7, runs=runs, metrics={"distance_m": 1.5})
    assert read_record(store_night(record) / "run.json") == record
    assert sorted(path.name for path in record.run_dir.iterdir()) == ["run.json"]


def test_what_is_no_record_is_told(runs: Path) -> None:
    path = runs / "other-20260301T020000000" / "run.json"
    path.write_text("[]")
    with pytest.raises(ConfigurationError, match="is not a run's record"):
        read_record(path)
    assert str(path) in find_records(runs, "other").unreadable[0]


def test_a_run_is_compared_with_those_that_began_before_it(runs: Path) -> None:
    second = since_last(NightRun.of(make_night("FF", 1, runs=runs)), runs)
    assert second.previous_run_id == "nightly-20260301T020000000"
    assert [each.cell.test for each in second.newly_failing] == ["world-1 scout"]
    assert since_last(NightRun.of(make_night("FF", 0, runs=runs)), runs).previous_run_id is None


def test_the_record_of_a_copied_home_has_the_paths_of_the_copy(tmp_path: Path) -> None:
    before, copy = tmp_path / "before", tmp_path / "a copy"
    outputs = (before / "objects" / "robomaker" / "sim-1" / "2026").as_uri()
    uris = {"P": outputs, "F": "s3://robomaker/sim-2/2026", "N": "file:///elsewhere/sim-3/2026"}
    jobs = [make_job(0, letter).model_copy(update={"output_uri": uri}) for letter, uri in uris.items()]
    folder = store_night(make_night(jobs, runs=before / "runs"))
    alone = Path(shutil.copytree(folder, tmp_path / "kept" / "alone"))
    assert [job.output_uri for job in read_record(alone / "run.json").jobs] == list(uris.values()), "it is no home"
    (before / "objects").mkdir()
    shutil.copytree(before, copy)

    record = read_record(copy / "runs" / folder.name / "run.json")

    assert record.run_dir == copy / "runs" / folder.name
    assert record.report_path == record.run_dir / "report.html"
    moved = (copy / "objects" / "robomaker" / "sim-1" / "2026").as_uri()
    assert [job.output_uri for job in record.jobs] == [moved, *list(uris.values())[1:]]
    assert read_record(folder / "run.json").run_dir == folder
