"""Digests of folders see everything that a program could read there."""

from pathlib import Path

from prefect_robomaker.tasks.runtime.states.imported_code import digest_of_folder


def test_files_behind_linked_folders_count(tmp_path: Path) -> None:
    package, meshes = tmp_path / "package", tmp_path / "meshes"
    package.mkdir()
    meshes.mkdir()
    (package / "models").symlink_to(meshes)
    (meshes / "robot.xml").write_text("<mujoco/>")
    before = digest_of_folder(package)
    (meshes / "robot.xml").write_text("<mujoco model='new'/>")
    assert digest_of_folder(package) != before


def test_a_link_to_a_folder_that_it_lies_in_ends(tmp_path: Path) -> None:
    (tmp_path / "inner").mkdir()
    (tmp_path / "inner" / "again").symlink_to(tmp_path)
    (tmp_path / "a.py").write_text("a = 1")
    before = digest_of_folder(tmp_path)
    (tmp_path / "inner" / "b.py").write_text("b = 1")
    assert digest_of_folder(tmp_path) != before


def test_byte_code_does_not_count_and_names_do(tmp_path: Path) -> None:
    (tmp_path / "a.py").write_text("a = 1")
    before = digest_of_folder(tmp_path)
    (tmp_path / "__pycache__").mkdir()
    (tmp_path / "__pycache__" / "a.pyc").write_bytes(b"1")
    assert digest_of_folder(tmp_path) == before
    (tmp_path / "a.py").rename(tmp_path / "b.py")
    assert digest_of_folder(tmp_path) != before
