"""Outputs that are stored when a run left too much: what says how it went comes first, and the rest is named."""

from pathlib import Path

from prefect_robomaker.tasks.simulations.outputs.storable_files import LeftOut, Room, storable_files


def test_of_too_many_files_those_are_stored_that_say_how_the_run_went(tmp_path: Path) -> None:
    for name in ("result.json", "logs/stdout.log", "a/b/c", *(f"{number:04}" for number in range(3000))):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_bytes(b"12")
    room = Room(most_bytes=10**9, most_files=4)
    found = storable_files(tmp_path, "run", room)
    assert [file.name for file in found] == ["0000", "0001", "logs/stdout.log", "result.json"]
    about = room.left_out.about()["leftOut"]
    assert (about["files"], about["sizeBytes"], about["beyondLimits"]) == (2999, 2 * 2999, 2999)
    assert about["named"][0] == {
        "path": "0002",
        "sizeBytes": 2,
        "why": "is beyond the 4 files that are stored of a run (ROBOMAKER_MAX_OUTPUT_FILES)",
    }


def test_a_sparse_file_counts_as_it_would_be_stored(tmp_path: Path) -> None:
    with (tmp_path / "huge").open("wb") as file:
        file.truncate(1 << 38)
    (tmp_path / "small").write_bytes(b"12")
    room = Room(most_bytes=128 * 10**9, most_files=10)
    found = storable_files(tmp_path, "run", room)
    assert [file.name for file in found] == ["small"], "what fits after it is stored"
    assert room.left_out.lines == [
        "'huge' is not stored: it is beyond the 128 GB that are stored of a run (ROBOMAKER_MAX_OUTPUT_GB)"
    ]
    [note] = room.notes()
    assert note.startswith("1 output is not stored")


def test_no_more_names_are_kept_than_readers_can_bear() -> None:
    left = LeftOut()
    for number in range(5000):
        left.note(f"file {number}", "is a symbolic link")
    about = left.about()["leftOut"]
    assert (about["files"], len(about["named"]), about["beyondLimits"]) == (5000, 1000, 0)
