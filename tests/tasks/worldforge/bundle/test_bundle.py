"""World bundles: complete, atomic, addressed by their content."""

import re
from pathlib import Path

import mujoco
import pytest

from prefect_robomaker.schemas.worlds.world import World
from prefect_robomaker.tasks.worldforge.bundle.bundle import content_hash, read_world, write_bundle
from prefect_robomaker.tasks.worldforge.materials.textures import texture_size_m
from prefect_robomaker.tasks.worldforge.model.mjcf import surfaces

FILES = {
    "world_description.json", "world.json", "world.xml", "map.pgm", "map.yaml", "floorplan.svg", "textures", "meshes",
}  # fmt: skip


def test_a_bundle_holds_everything_and_reads_back(flat: World, tmp_path: Path) -> None:
    write_bundle(flat, tmp_path / "worlds" / "flat")
    folder = tmp_path / "worlds" / "flat"
    assert {path.name for path in folder.iterdir()} == FILES
    assert read_world(folder) == flat
    model = mujoco.MjModel.from_xml_path(str(folder / "world.xml"))
    assert model.ngeom > (flat.checks.geoms if flat.checks else 0)  # decorated, which the checked one is not
    assert sum(path.stat().st_size for path in folder.rglob("*") if path.is_file()) < 3_000_000
    assert folder.stat().st_mode & 0o777 == 0o755


def test_it_holds_the_pictures_of_its_surfaces_and_no_others(flat: World, tmp_path: Path) -> None:
    write_bundle(flat, tmp_path / "flat")
    files = {path.stem: path for path in (tmp_path / "flat" / "textures").iterdir()}
    assert set(files) == {name for name in surfaces(flat) if texture_size_m(name) is not None} | {"sky"}
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "flat" / "world.xml"))
    assert {model.tex(index).name for index in range(model.ntex)} == set(files)
    assert all(path.stat().st_size < 64_000 for path in files.values())
    named = set(re.findall(r'<mesh name="[^"]*" file="([^"]*)"', (tmp_path / "flat" / "world.xml").read_text()))
    assert named
    assert {path.relative_to(tmp_path / "flat").as_posix() for path in (tmp_path / "flat").glob("meshes/*")} == named


def test_another_picture_makes_another_hash(flat: World, tmp_path: Path) -> None:
    before = write_bundle(flat, tmp_path / "flat")
    next((tmp_path / "flat" / "textures").iterdir()).write_bytes(b"another")
    assert content_hash(tmp_path / "flat") != before


def test_equal_worlds_have_equal_hashes(flat: World, tmp_path: Path) -> None:
    first = write_bundle(flat, tmp_path / "first")
    assert first == content_hash(tmp_path / "first")
    second = write_bundle(flat, tmp_path / "second")
    assert first == second
    assert re.fullmatch("[0-9a-f]{64}", first)
    assert {path.name for path in (tmp_path / "second").iterdir()} == FILES
    other = write_bundle(flat.model_copy(update={"interior_seed": 99}), tmp_path / "other")
    assert other != first


def test_nothing_half_written_is_left(flat: World, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def write(file: Path, content: bytes) -> int:
        if file.name == "map.pgm":
            raise OSError("disk full")
        return file.write_text(content.decode("latin-1"))

    monkeypatch.setattr(Path, "write_bytes", write)
    with pytest.raises(OSError, match="disk full"):
        write_bundle(flat, tmp_path / "flat")
    assert list(tmp_path.iterdir()) == []


def test_a_bundle_is_never_overwritten(flat: World, tmp_path: Path) -> None:
    write_bundle(flat, tmp_path / "flat")
    before = (tmp_path / "flat" / "world.json").read_bytes()
    with pytest.raises(FileExistsError, match="exists already"):
        write_bundle(flat.model_copy(update={"interior_seed": 99}), tmp_path / "flat")
    assert (tmp_path / "flat" / "world.json").read_bytes() == before
    assert [path.name for path in tmp_path.iterdir()] == ["flat"]
