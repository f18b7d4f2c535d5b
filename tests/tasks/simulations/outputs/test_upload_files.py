"""Files that globs mean: found without following links, taken when no process writes to them any more."""

import os
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from prefect_robomaker.schemas.wire.globs import Glob
from prefect_robomaker.tasks.simulations.outputs.upload_files import is_written_to, link_or_copy, take, visit_matches


@contextmanager
def opened(folder: Path) -> Iterator[int]:
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    yield descriptor
    os.close(descriptor)


def found(root: Path, glob: str) -> list[str]:
    paths: list[str] = []
    visit_matches(root, Glob(glob), lambda folder, name, below: paths.append(below))
    return paths


@pytest.fixture
def root(tmp_path: Path) -> Path:
    """A job's folders, with a secret beside them."""
    root = tmp_path / "root"
    for name in ("home/robomaker/maps/a.pgm", "home/robomaker/maps/deep/b.pgm", "var/log/nav.log"):
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_text(name)
    (tmp_path / "secret").mkdir()
    (tmp_path / "secret/key.pgm").touch()
    return root


@pytest.mark.parametrize(
    ("glob", "paths"),
    [
        ("/home/robomaker/maps/*", ["a.pgm"]),
        ("/home/robomaker/maps/**", ["a.pgm", "deep/b.pgm"]),
        ("/home/robomaker/**.pgm", ["maps/a.pgm", "maps/deep/b.pgm"]),
        ("/home/robomaker/m*/*.pgm", ["maps/a.pgm"]),
        ("/home/robomaker/maps/a.pgm", ["a.pgm"]),
        ("/var/log/*.{log,txt}", ["nav.log"]),
        ("/home/robomaker/none/**", []),
        ("/home/robomaker/maps/a.pgm/**", []),
    ],
)
def test_paths_are_those_below_the_fixed_folder(root: Path, glob: str, paths: list[str]) -> None:
    assert found(root, glob) == paths


@given(
    names=st.lists(st.sampled_from(["a", "b", "a/c", "a/d/e", "f/g"]), unique=True),
    glob=st.sampled_from(["**", "*", "?/*", "{a,f}/**", "a/?/e"]),
)
def test_what_is_visited_is_what_matches(tmp_path_factory: pytest.TempPathFactory, names: list[str], glob: str) -> None:
    root = tmp_path_factory.mktemp("root")
    for name in names:
        path = root / "var/log" / (f"{name}.x")
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch()

    everything = Glob(f"/var/log/{glob}")
    expected = {f"{name}.x" for name in names if everything.matches(f"/var/log/{name}.x")}

    assert set(found(root, everything.text)) == expected


def test_links_are_not_followed_wherever_they_are(root: Path, tmp_path: Path) -> None:
    home = root / "home/robomaker"
    (home / "file.pgm").symlink_to(tmp_path / "secret/key.pgm")
    (home / "folder").symlink_to(tmp_path / "secret")
    (root / "var/log").rename(root / "var/old")
    (root / "var/log").symlink_to(tmp_path / "secret")

    assert found(root, "/home/robomaker/**") == ["maps/a.pgm", "maps/deep/b.pgm"]
    assert found(root, "/home/robomaker/folder/*") == []
    assert found(root, "/var/log/*") == []


def test_what_is_no_file_is_skipped(root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    home = root / "home/robomaker"
    monkeypatch.chdir(home)  # paths of sockets have at most 107 characters
    os.mkfifo(home / "pipe")
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind("socket")

    assert found(root, "/home/robomaker/*") == []


def test_folders_without_end_are_looked_into_a_hundred_deep(root: Path) -> None:
    deep = root / "home/robomaker"
    for _ in range(150):
        deep = deep / "d"
    deep.mkdir(parents=True)
    (deep / "x").touch()
    (root / "home/robomaker/d/y").touch()

    assert found(root, "/home/robomaker/d/**") == ["y"]


def test_a_link_in_the_place_of_a_file_is_not_taken(root: Path, tmp_path: Path) -> None:
    (root / "var/log/swapped").symlink_to(tmp_path / "secret/key.pgm")
    with opened(root / "var/log") as folder:
        for act in (link_or_copy, take):
            with pytest.raises(OSError, match="symbolic"):
                act(folder, "swapped", tmp_path / "target")
    assert not (tmp_path / "target").exists()


def test_a_file_that_is_open_for_writing_is_left_until_it_is_closed(root: Path, tmp_path: Path) -> None:
    log = root / "var/log/nav.log"
    with opened(root / "var/log") as folder:
        with log.open("a") as writer:
            assert not take(folder, "nav.log", tmp_path / "taken")
            writer.write(" and more")
        with log.open("rb"):  # readers do not matter
            assert take(folder, "nav.log", tmp_path / "taken")

    assert not log.exists()
    assert (tmp_path / "taken").read_text() == "var/log/nav.log and more"


def test_looking_whether_a_file_is_written_to_leaves_no_trace(root: Path) -> None:
    log = root / "var/log/nav.log"
    with log.open("rb") as reader:
        assert not is_written_to(reader.fileno())
        with log.open("a") as writer:  # would wait if a lease were still held
            assert is_written_to(reader.fileno())
            writer.write("x")


def test_linking_keeps_the_file_and_replaces_what_was_there(root: Path, tmp_path: Path) -> None:
    (tmp_path / "target").write_text("old")
    with opened(root / "var/log") as folder:
        link_or_copy(folder, "nav.log", tmp_path / "target")

    assert (tmp_path / "target").read_text() == "var/log/nav.log"
    assert (root / "var/log/nav.log").exists()
