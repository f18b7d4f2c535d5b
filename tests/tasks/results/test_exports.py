"""Tables in files for other programs."""

from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from helpers.night_records import make_night
from pyarrow import csv

from prefect_robomaker.schemas.wire.errors import ConfigurationError
from prefect_robomaker.tasks.results import exports
from prefect_robomaker.tasks.results.exports import check_extension, export_table
from prefect_robomaker.tasks.results.table import ResultTable

TABLE = ResultTable.of(make_night("PFEC").jobs).to_arrow()


def test_each_form_has_all_rows(tmp_path: Path) -> None:
    for name in ("jobs.parquet", "jobs.CSV"):
        export_table(TABLE, tmp_path / name)

    assert pq.read_table(tmp_path / "jobs.parquet") == TABLE
    assert csv.read_csv(tmp_path / "jobs.CSV")["outcome"].to_pylist() == ["passed", "failed", "broken", "canceled"]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["jobs.CSV", "jobs.parquet"]


def test_a_table_that_was_read_back_has_plain_texts(tmp_path: Path) -> None:
    ResultTable.of(make_night("PF").jobs).write(tmp_path / "results.parquet")

    table = ResultTable.read(tmp_path / "results.parquet").to_arrow()
    assert table.schema.field("world").type == pa.string()
    assert table["outcome"].to_pylist() == ["passed", "failed"]


@pytest.mark.parametrize("name", ["jobs.xlsx", "jobs", "jobs.parquet.gz"])
def test_other_forms_are_refused_in_a_sentence(name: str) -> None:
    with pytest.raises(ConfigurationError, match=rf"^--to is {name}; a name that ends with .parquet or .csv would"):
        check_extension(Path(name), "--to")


def test_a_file_that_cannot_be_written_whole_leaves_the_earlier_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "jobs.csv"
    path.write_text("earlier")

    def breaks(table: pa.Table, part: Path) -> None:
        part.write_text("half")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(exports, "WRITERS", {".csv": breaks})
    with pytest.raises(OSError, match="No space"):
        export_table(TABLE, path)
    assert path.read_text() == "earlier"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("is_there", [True, False])
def test_a_symbolic_link_stays_and_its_file_is_written(is_there: bool, tmp_path: Path) -> None:
    file, link = tmp_path / "elsewhere" / "kept.csv", tmp_path / "link.csv"
    file.parent.mkdir()
    if is_there:
        file.write_text("earlier")
    link.symlink_to(file)
    export_table(TABLE, link)

    assert link.is_symlink()
    assert csv.read_csv(file).num_rows == TABLE.num_rows
    assert sorted(path.name for path in tmp_path.rglob("*")) == ["elsewhere", "kept.csv", "link.csv"]


def test_links_in_a_circle_are_refused(tmp_path: Path) -> None:
    for one, other in (("a.csv", "b.csv"), ("b.csv", "a.csv")):
        (tmp_path / one).symlink_to(tmp_path / other)
    with pytest.raises(OSError, match="Too many levels of symbolic links"):
        export_table(TABLE, tmp_path / "a.csv")
    assert (tmp_path / "a.csv").is_symlink()
