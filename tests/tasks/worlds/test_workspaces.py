"""Worlds in workspaces and bundles of simulation applications: found, named, and started as launch files say."""

from pathlib import Path

import pytest
from helpers.colcon_bundles import bundle_v2, tar_of

from prefect_robomaker.schemas.wire.errors import ConfigurationError
from prefect_robomaker.tasks.service.service import Service
from prefect_robomaker.tasks.worlds.workspaces import opened_workspace, read_workspace

WORLD = '<sdf version="1.6"><world name="w"/></sdf>'
LAUNCH = (
    '<launch><arg name="x_pos" default="{}"/><arg name="y_pos" default="1"/><arg name="w" value="{}.world"/></launch>'
)


def package(name: str, *worlds: str, top: str = "") -> dict[str, str]:
    """Files of a ROS package with worlds, models, and a launch file for each world."""
    files = {
        "package.xml": f'<package><name>{name}</name><export><gazebo_ros gazebo_model_path="${{prefix}}/things:/etc"/>'
        "</export></package>",
        "models/rock/model.sdf": '<sdf version="1.6"><model name="rock"/></sdf>',
        "things/box/model.sdf": '<sdf version="1.6"><model name="box"/></sdf>',
    }
    for number, world in enumerate(worlds):
        files |= {f"worlds/{world}.world": WORLD, f"launch/{world}.launch": LAUNCH.format(number, world)}
    return {f"{top}{name}/{path}": text for path, text in files.items()}


def written(folder: Path, files: dict[str, str]) -> Path:
    for name, text in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)
    return folder


def test_worlds_of_a_workspace_are_found_once_with_their_starts_and_models(tmp_path: Path) -> None:
    """Sources come before what was installed from them; build folders, hidden ones and models are no worlds."""
    top = written(
        tmp_path / "ws",
        package("house", "small", "large", top="src/")
        | package("house", "small", "large", top="install/house/share/")
        | package("copy", "lost", top="build/")
        | package("copy", "lost", top=".hidden/")
        | {"src/house/worlds/notes.world": "no world", "src/house/worlds/new.sdf": WORLD},
    )
    found = read_workspace(top)
    assert [(world.name, world.path.relative_to(top).as_posix()) for world in found.worlds] == [
        ("large", "src/house/worlds/large.world"),
        ("new", "src/house/worlds/new.sdf"),
        ("small", "src/house/worlds/small.world"),
    ]
    starts = [world.start and (world.start.x_m, world.start.y_m, world.start.launch_file) for world in found.worlds]
    assert starts == [(1.0, 1.0, "large.launch"), None, (0.0, 1.0, "small.launch")]
    paths = {path.relative_to(top).as_posix() for path in found.model_paths}
    assert {"src/house/models", "src/house/things", "src"} <= paths  # and never /etc, which is outside


def test_worlds_of_one_name_are_told_apart_by_their_packages(tmp_path: Path) -> None:
    found = read_workspace(written(tmp_path / "ws", package("one", "house") | package("two", "house")))
    assert [world.name for world in found.worlds] == ["one/house", "two/house"]
    assert found.world("two/house") == found.worlds[1]
    with pytest.raises(ConfigurationError, match=r"--world two/hose: ws has no such world; did you mean two/house\?"):
        found.world("two/hose")


@pytest.mark.parametrize("form", ["colcon", "tar", "folder"])
def test_the_only_world_of_a_bundle_needs_no_name(service: Service, tmp_path: Path, form: str) -> None:
    """Of a colcon bundle only packages are looked at: Gazebo's own worlds in its system do not count."""
    files = package("house", "small", top="opt/built_workspace/house/share/")
    path = tmp_path / {"colcon": "bundle.tar", "tar": "bundle.tar.gz", "folder": "bundle"}[form]
    if form == "colcon":
        system = {"setup.sh": "", "usr/share/gazebo-11/worlds/empty.world": WORLD}
        bundle_v2(path, system, files | {"setup.sh": ""})
    elif form == "tar":
        path.write_bytes(tar_of(files, "w:gz"))
    else:
        written(path, files)
    with opened_workspace(path, service) as found:
        world = found.world(None)
        assert world is not None
        assert (world.name, world.path.read_text()) == ("small", WORLD)
        assert found.world("small.world") == world
    assert list(service.folder("scratch").iterdir()) == []


def test_what_is_no_bundle_is_refused_in_words(service: Service, tmp_path: Path) -> None:
    (tmp_path / "bundle.tar.gz").write_text("nothing")
    with (
        pytest.raises(ConfigurationError, match=r"bundle\.tar\.gz: "),
        opened_workspace(tmp_path / "bundle.tar.gz", service),
    ):
        pass
    with (
        opened_workspace(tmp_path, service) as empty,
        pytest.raises(ConfigurationError, match="no file in it is a Gaz"),
    ):
        empty.world(None)
