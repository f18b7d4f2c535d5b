"""The archive of an export job."""

import hashlib
import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import mujoco
import numpy as np
import pytest
from helpers.written_maps import read_grid
from PIL import Image

from prefect_robomaker.tasks.worldforge.bundle.bundle import read_world, with_plain_names
from prefect_robomaker.tasks.worldforge.exports.export import write_export_zip
from prefect_robomaker.tasks.worldforge.geometry.occupancy import ROBOT_HIGH_M, ROBOT_LOW_M
from prefect_robomaker.tasks.worlds.archive_places import export_key

TOP = "aws_robomaker_worldforge_pkgs"
PACKAGES = ("aws_robomaker_worldforge_shared_models", "aws_robomaker_worldforge_worlds")
WORLDS = "aws_robomaker_worldforge_worlds/worlds"


def test_every_file_of_every_bundle_is_where_clients_look(bundles: dict[str, Path], exported: Path) -> None:
    assert sorted(path.name for path in exported.iterdir()) == ["README.md", *PACKAGES, "index.json"]
    for name, bundle in bundles.items():
        assert (exported / WORLDS / name / f"{name}.world").is_file()
        with Image.open(exported / WORLDS / name / "preview.png") as preview:  # no bundle has one any more
            assert min(preview.size) > 300
        for path in (path for path in bundle.rglob("*") if path.is_file()):
            copy = exported / WORLDS / name / path.relative_to(bundle)
            anew = path.name in ("world.xml", "map.pgm", "map.yaml")
            assert copy.is_file() if anew else copy.read_bytes() == path.read_bytes()


def test_the_index_describes_exactly_what_is_inside(bundles: dict[str, Path], exported: Path) -> None:
    index = json.loads((exported / "index.json").read_text())
    assert [world["id"] for world in index["worlds"]] == sorted(bundles)
    files = [file for part in (*index["worlds"], *index["models"], index) for file in part["files"]]
    for file in files:
        content = (exported / file["path"]).read_bytes()
        assert file["size_bytes"] == len(content)
        assert file["sha256"] == hashlib.sha256(content).hexdigest()
    found = {str(path.relative_to(exported)) for path in exported.rglob("*") if path.is_file()}
    assert found == {file["path"] for file in files} | {"index.json"}
    models = {model["name"] for model in index["models"]}
    assert models == {name for world in index["worlds"] for name in world["models"]}


def test_the_readme_code_loads_the_exported_world(
    exported: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Runs the README's own Python after unzipping, as a reader would."""
    shutil.copytree(exported, tmp_path / TOP)
    monkeypatch.chdir(tmp_path / TOP)
    Path("robot.xml").write_text("<mujoco><worldbody><body name='base'><geom size='.1'/></body></worldbody></mujoco>")
    python = Path("README.md").read_text().partition("In Python:")[2].partition("mujoco-warp does")[0]
    code = "\n".join(re.findall(r"^    (.*)$", python, re.MULTILINE))
    names: dict = {}
    exec(code, names)
    assert names["model"].body("robot/base").id > 0


def test_every_exported_mjcf_runs(bundles: dict[str, Path], exported: Path) -> None:
    for name in bundles:
        model = mujoco.MjModel.from_xml_path(str(exported / WORLDS / name / "world.xml"))
        data = mujoco.MjData(model)
        mujoco.mj_step(model, data, 100)
        assert np.isfinite(data.qpos).all()


def test_names_in_the_exported_mjcf_are_plain_and_lead_to_those_of_the_bundle(
    bundles: dict[str, Path], exported: Path
) -> None:
    for name, bundle in bundles.items():
        folder = exported / WORLDS / name
        named = json.loads((folder / "names.json").read_text())
        here, there = (mujoco.MjModel.from_xml_path(str(each / "world.xml")) for each in (folder, bundle))
        names, originals = (model.names.decode().split("\0") for model in (here, there))
        assert all(re.fullmatch(r"[A-Za-z0-9_]*", each) for each in names)
        assert [named.get(each, each) for each in names[1:]] == originals[1:]
        assert len(set(named.values())) == len(named) > 100
        assert np.array_equal(here.geom_pos, there.geom_pos)
        assert np.array_equal(here.geom_matid, there.geom_matid)
        assert np.array_equal(here.jnt_range, there.jnt_range)


def test_two_names_never_become_one() -> None:
    mjcf = '<m><body name="a_b"/><body name="a.b"/><body name="a-b"/><x body1="a-b" body2="a_b" file="a.b"/></m>'
    made = with_plain_names(mjcf)
    assert made.names == {"a_b_2": "a.b", "a_b_3": "a-b"}
    assert made.mjcf.endswith('<body name="a_b_3"/><x body1="a_b_3" body2="a_b" file="a.b"/></m>')


def test_maps_agree_with_rays_through_the_exported_geometry(bundles: dict[str, Path], exported: Path) -> None:
    """Whatever a robot would bump into is on the map, and the place it looks from is free."""
    colliding = np.array([1, 1, 0, 1, 0, 0], np.uint8)  # other groups are for the eye only
    for name in bundles:
        folder = exported / WORLDS / name
        grid = read_grid(folder)
        model = mujoco.MjModel.from_xml_path(str(folder / "world.xml"))
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        hits, missing = 0, []
        for room in read_world(folder).floorplan.rooms:
            for height in np.linspace(ROBOT_LOW_M + 0.02, ROBOT_HIGH_M - 0.02, 3):
                # Not along diagonals of cells: a ray that only grazes a wall's corner ends in the free cell behind it.
                for angle in np.linspace(-np.pi, np.pi, 60, endpoint=False) + 0.01:
                    start = np.array([*room.goal, height])
                    ray = np.array([np.cos(angle), np.sin(angle), 0.0])
                    distance = mujoco.mj_ray(model, data, start, ray, colliding, 1, -1, np.zeros(1, np.int32))
                    assert distance > 0
                    # A millimetre into what was hit: exactly on a face, the cell before it would do as well.
                    end = start + (distance + 0.001) * ray
                    hits += 1
                    if not grid.occupied[grid.cell((float(end[0]), float(end[1])))]:
                        missing.append((room.name, end.round(3)))
            assert grid.free[grid.cell(room.goal)]
        assert hits > 300
        assert missing == []


@pytest.mark.deep
def test_equal_worlds_make_equal_bytes(bundles: dict[str, Path], export_zip: Path, tmp_path: Path) -> None:
    copies = {name: tmp_path / f"copy{number}" for number, name in enumerate(bundles)}
    for name, copy in copies.items():
        shutil.copytree(bundles[name], copy)
        for path in copy.rglob("*"):
            os.utime(path, (1, 1))
            if path.is_file():
                path.chmod(0o755)
    # Another process: nothing may hang on the order of sets or on what was written before.
    program = (
        "import json, sys; from pathlib import Path; from prefect_robomaker.tasks.worldforge.exports import export;"
        "export.write_export_zip({k: Path(v) for k, v in json.loads(sys.argv[1]).items()}, Path(sys.argv[2]))"
    )
    order = json.dumps({name: str(copies[name]) for name in reversed(bundles)})
    subprocess.run([sys.executable, "-c", program, order, str(tmp_path / "again.zip")], check=True)
    assert (tmp_path / "again.zip").read_bytes() == export_zip.read_bytes()


@pytest.fixture
def bundle(bundles: dict[str, Path], tmp_path: Path) -> Path:
    """A bundle that a test may spoil."""
    shutil.copytree(next(iter(bundles.values())), tmp_path / "bundle")
    return tmp_path / "bundle"


def test_a_link_in_a_bundle_is_refused_and_nothing_is_left(bundle: Path, tmp_path: Path) -> None:
    (bundle / "more").mkdir()
    (bundle / "more" / "link").symlink_to("/etc/passwd")
    with pytest.raises(ValueError, match=r"more/link is neither"):
        write_export_zip({"world": bundle}, tmp_path / "export.zip")
    assert [path.name for path in tmp_path.iterdir()] == ["bundle"]


@pytest.mark.parametrize("file", ["world.json", "world.xml"])
def test_a_bundle_without_its_world_is_refused(bundle: Path, tmp_path: Path, file: str) -> None:
    (bundle / file).unlink()
    with pytest.raises(FileNotFoundError, match=file):
        write_export_zip({"world": bundle}, tmp_path / "export.zip")
    assert [path.name for path in tmp_path.iterdir()] == ["bundle"]


@pytest.mark.parametrize(
    ("body", "words"),
    [
        ("<body name='a'><freejoint/><geom size='.1'/><body name='b'><geom size='.1'/></body></body>", "'b'.*with one"),
        (
            "<body name='a'><joint/><joint axis='1 0 0'/><geom size='.1'/></body>",
            "'a'.*one free, hinge, slide or ball joint",
        ),
    ],
)
def test_what_exports_cannot_hold_is_named(bundle: Path, tmp_path: Path, body: str, words: str) -> None:
    (bundle / "world.xml").write_text(f"<mujoco><worldbody>{body}</worldbody></mujoco>")
    with pytest.raises(ValueError, match=words):
        write_export_zip({"world": bundle}, tmp_path / "export.zip")


@pytest.mark.parametrize("name", ["../up", "", "a/b", "a b"])
def test_names_that_are_no_folder_names_are_refused(bundles: dict[str, Path], tmp_path: Path, name: str):
    with pytest.raises(ValueError, match="world"):
        write_export_zip({name: next(iter(bundles.values()))}, tmp_path / "export.zip")


def test_an_export_of_nothing_is_refused(tmp_path: Path):
    with pytest.raises(ValueError, match="bundles is empty"):
        write_export_zip({}, tmp_path / "export.zip")


def test_a_missing_bundle_is_an_error(tmp_path: Path):
    with pytest.raises(FileNotFoundError):
        write_export_zip({"world": tmp_path / "missing"}, tmp_path / "export.zip")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("prefix", "export_id", "key"),
    [
        ("", "export-82856b0yq33y", "aws-robomaker-worldforge-export-82856b0yq33y.zip"),
        ("worlds", "export-82856b0yq33y", "worlds/aws-robomaker-worldforge-export-82856b0yq33y.zip"),
        ("a/b/", "82856b0yq33y", "a/b/aws-robomaker-worldforge-export-82856b0yq33y.zip"),
        (
            "arn:aws:robomaker:us-east-1:1:world-generation-job/generation-x",
            "export-y",
            "arn:aws:robomaker:us-east-1:1:world-generation-job/generation-x/aws-robomaker-worldforge-export-y.zip",
        ),
    ],
)
def test_the_key_is_the_one_clients_compute(prefix: str, export_id: str, key: str):
    assert export_key(prefix, export_id) == key


@pytest.mark.parametrize("export_id", ["", "export-", "export-a/b", "export-é"])
def test_what_is_no_export_id_is_refused(export_id: str):
    with pytest.raises(ValueError, match="export id"):
        export_key("", export_id)
