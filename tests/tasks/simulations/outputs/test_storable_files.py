"""What of a run's own outputs is stored, and what is left out."""

import os
import socket
from pathlib import Path

import pytest

from prefect_robomaker.schemas.wire.errors import StorageError
from prefect_robomaker.tasks.simulations.outputs.storable_files import Room, storable_files


@pytest.fixture
def room() -> Room:
    """Room for everything."""
    return Room(most_bytes=1 << 62, most_files=1_000_000)


def test_what_is_no_regular_file_is_left_out_by_name(
    room: Room, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)  # paths of sockets are short
    (tmp_path / "maps").mkdir()
    (tmp_path / "maps" / "flat.pgm").write_bytes(b"P5")
    (tmp_path / "result.json").write_text("{}")
    (tmp_path / "link").symlink_to("/etc/passwd")
    (tmp_path / "maps" / "folder").symlink_to("/")
    os.mkfifo(tmp_path / "pipe")
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind("socket")
        found = storable_files(tmp_path, "job/run", room)
    assert [file.name for file in found] == ["maps/flat.pgm", "result.json"]
    assert [note.partition(";")[0] for note in sorted(room.left_out.lines)] == [
        "'link' is not stored: it is a symbolic link",
        "'maps/folder' is not stored: it is a symbolic link",
        "'pipe' is not stored: it is neither a regular file nor a folder",
        "'socket' is not stored: it is neither a regular file nor a folder",
    ]


@pytest.mark.parametrize(
    ("name", "why"),
    [
        (b"manifest.json", "it has the name of the manifest"),
        (b"not\xffutf-8", "cannot be written as UTF-8"),
        (b"back\\slash", "NUL and backslash are not allowed"),
    ],
)
def test_names_that_no_store_takes_are_left_out(room: Room, tmp_path: Path, name: bytes, why: str) -> None:
    (tmp_path / os.fsdecode(name)).write_bytes(b"")
    (tmp_path / "kept").write_bytes(b"")
    found = storable_files(tmp_path, "job/run", room)
    assert [file.name for file in found] == ["kept"]
    assert [why in note for note in room.left_out.lines] == [True]
    "".join(room.left_out.lines).encode()  # what is not UTF-8 is written in a form that is


def test_keys_are_measured_with_their_prefix(room: Room, tmp_path: Path) -> None:
    deep = tmp_path / ("a" * 200) / ("b" * 200) / ("c" * 200)
    deep.mkdir(parents=True)
    (deep / "file").write_bytes(b"")
    assert len(storable_files(tmp_path, "job/run", room)) == 1
    found = storable_files(tmp_path, "/".join(["p" * 200] * 3), room)
    assert found == []
    assert ["at most 1024" in note for note in room.left_out.lines] == [True]


def test_what_may_not_be_read_is_left_out(room: Room, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "private").write_bytes(b"")
    monkeypatch.setattr(os, "access", lambda _path, _mode: False)  # root may read everything
    assert storable_files(tmp_path, "", room) == []
    assert room.left_out.lines == ["'private' is not stored: it may not be read"]


def test_no_folder_is_an_error(room: Room, tmp_path: Path) -> None:
    with pytest.raises(StorageError, match="nothing"):
        storable_files(tmp_path / "nothing", "job/run", room)
