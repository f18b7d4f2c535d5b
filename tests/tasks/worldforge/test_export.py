"""The archive of an export job."""

import hashlib
import json
import os
import re
import zipfile
from pathlib import Path

import pytest

from prefect_robomaker.tasks.worldforge.export import export_key, write_export_zip

TOP = "aws_robomaker_worldforge_pkgs"
WORLDS = f"{TOP}/aws_robomaker_worldforge_worlds/worlds"
MODEL = "<mujoco><worldbody><geom type='plane' size='1 1 1'/></worldbody></mujoco>"
IDS = ("generation_82856b0yq33y_world_3", "generation_82856b0yq33y_world_10")


@pytest.fixture
def bundles(tmp_path: Path) -> dict[str, Path]:
    made = {}
    for number, name in enumerate(IDS):
        folder = tmp_path / f"bundle{number}"
        (folder / "textures").mkdir(parents=True)
        (folder / "world.xml").write_text(MODEL)
        (folder / "world.json").write_text(json.dumps({"number": number}))
        (folder / "textures" / "oak.png").write_bytes(os.urandom(10))
        made[name] = folder
    return made


def test_every_file_of_every_bundle_is_where_clients_look(bundles: dict[str, Path], tmp_path: Path):
    write_export_zip(bundles, tmp_path / "export.zip")
    with zipfile.ZipFile(tmp_path / "export.zip") as archive:
        assert archive.testzip() is None
        assert {name.split("/")[0] for name in archive.namelist()} == {TOP}
        for name, folder in bundles.items():
            for file in ("world.xml", "world.json", "textures/oak.png"):
                assert archive.read(f"{WORLDS}/{name}/{file}") == (folder / file).read_bytes()


def test_the_index_describes_exactly_what_is_inside(bundles: dict[str, Path], tmp_path: Path):
    write_export_zip(bundles, tmp_path / "export.zip")
    with zipfile.ZipFile(tmp_path / "export.zip") as archive:
        index = json.loads(archive.read(f"{TOP}/index.json"))
        assert [world["id"] for world in index["worlds"]] == sorted(IDS)
        files = [file for world in index["worlds"] for file in world["files"]]
        for file in files:
            content = archive.read(f"{TOP}/{file['path']}")
            assert file["size_bytes"] == len(content)
            assert file["sha256"] == hashlib.sha256(content).hexdigest()
        named = {f"{TOP}/{file['path']}" for file in files} | {f"{TOP}/README.md", f"{TOP}/index.json"}
        assert set(archive.namelist()) == named


def test_the_readme_code_loads_the_exported_world(
    bundles: dict[str, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """Runs the README's own Python after unzipping, as a reader would."""
    write_export_zip(bundles, tmp_path / "export.zip")
    with zipfile.ZipFile(tmp_path / "export.zip") as archive:
        archive.extractall(tmp_path / "out")
    monkeypatch.chdir(tmp_path / "out" / TOP)
    Path("robot.xml").write_text("<mujoco><worldbody><body name='base'><geom size='.1'/></body></worldbody></mujoco>")
    blocks = re.findall(r"((?:^    .*\n)+)", Path("README.md").read_text(), re.MULTILINE)
    code = "\n".join(
        re.sub("^    ", "", block, flags=re.MULTILINE) for block in blocks if not re.match(r"\s+(python|ros2)", block)
    )
    names: dict = {}
    exec(code, names)
    assert names["model"].body("robot/base").id == 1


def test_equal_worlds_make_equal_bytes(bundles: dict[str, Path], tmp_path: Path):
    write_export_zip(bundles, tmp_path / "one.zip")
    for folder in bundles.values():
        for path in folder.rglob("*"):
            os.utime(path, (1, 1))
            if path.is_file():
                path.chmod(0o755)
    write_export_zip(dict(reversed(bundles.items())), tmp_path / "two.zip")
    assert (tmp_path / "one.zip").read_bytes() == (tmp_path / "two.zip").read_bytes()


def test_a_link_in_a_bundle_is_refused_and_nothing_is_left(bundles: dict[str, Path], tmp_path: Path):
    (bundles[IDS[0]] / "textures" / "link").symlink_to("/etc/passwd")
    with pytest.raises(ValueError, match=r"textures/link is neither"):
        write_export_zip(bundles, tmp_path / "export.zip")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["bundle0", "bundle1"]


@pytest.mark.parametrize("name", ["../up", "", "a/b", "a b"])
def test_names_that_are_no_folder_names_are_refused(bundles: dict[str, Path], tmp_path: Path, name: str):
    with pytest.raises(ValueError, match="world"):
        write_export_zip({name: bundles[IDS[0]]}, tmp_path / "export.zip")


def test_an_export_of_nothing_is_refused(tmp_path: Path):
    with pytest.raises(ValueError, match="bundles is empty"):
        write_export_zip({}, tmp_path / "export.zip")


def test_a_missing_bundle_is_an_error(tmp_path: Path):
    with pytest.raises(FileNotFoundError):
        write_export_zip({IDS[0]: tmp_path / "missing"}, tmp_path / "export.zip")
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
