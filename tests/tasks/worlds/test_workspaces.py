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
    assert starts == [
        (1.0, 1.0, "house/launch/large.launch"),
        None,
        (0.0, 1.0, "house/launch/small.launch"),
    ]
    paths = {path.relative_to(top).as_posix() for path in found.model_paths}
    assert {"src/house/models", "src/house/things", "src"} <= paths  # and never /etc, which is outside


def test_worlds_of_one_name_are_told_apart_by_their_packages(tmp_path: Path) -> None:
    found = read_workspace(written(tmp_path / "ws", package("one", "house") | package("two", "house")))
    assert [world.name for world in found.worlds] == ["one/house", "two/house"]
    assert found.world("two/house") == found.worlds[1]
    with pytest.raises(ConfigurationError, match=r"--world two/hose: ws has no such world; did you mean two/house\?"):
        found.world("two/hose")


def manifest(name: str) -> dict[str, str]:
    return {f"{name}/package.xml": f"<package><name>{name}</name></package>"}


PYTHON_LAUNCH = """
where = os.path.join(get_package_share_directory("shop"), "worlds", "main.world")
DeclareLaunchArgument("x_pose", default_value="7"), DeclareLaunchArgument("y_pose", default_value="1")
"""


@pytest.mark.parametrize(
    ("files", "expected"),
    [
        ({"hospital/launch/go.launch": LAUNCH.format(5, "main")}, {"hospital": 5.0}),
        ({"robot/launch/go.launch": LAUNCH.format(5, "$(find shop)/worlds/main")}, {"shop": 5.0}),
        ({"hospital/launch/go.launch": LAUNCH.format(5, "$(find-pkg-share shop)/worlds/main")}, {"shop": 5.0}),
        ({"hospital/launch/go.launch.py": PYTHON_LAUNCH}, {"shop": 7.0}),
        ({"robot/launch/go.launch": LAUNCH.format(5, "main")}, {"hospital": 5.0, "shop": 5.0}),
        (
            {
                "hospital/launch/w.launch": '<launch><arg name="w" value="main.world"/></launch>',
                "shop/launch/w.launch": '<launch><arg name="w" value="main.world"/></launch>',
                "robot/launch/go.launch": LAUNCH.format(6, "x") + '<include file="$(find shop)/launch/w.launch"/>',
            },
            {"shop": 6.0},
        ),
    ],
)
def test_worlds_of_one_file_name_have_the_starts_of_their_own_packages(
    tmp_path: Path, files: dict[str, str], expected: dict[str, float]
) -> None:
    worlds = {f"{name}/worlds/main.world": WORLD for name in ("hospital", "shop")}
    manifests = manifest("hospital") | manifest("shop") | manifest("robot")
    found = read_workspace(written(tmp_path / "ws", worlds | manifests | files))
    assert {each.name.partition("/")[0]: each.start.x_m for each in found.worlds if each.start} == expected


def test_a_launch_file_of_the_own_package_goes_before_others(tmp_path: Path) -> None:
    files = {"a/launch/go.launch": LAUNCH.format(5, "main"), "shop/launch/go.launch": LAUNCH.format(6, "main")}
    top = written(tmp_path / "ws", manifest("a") | manifest("shop") | {"shop/worlds/main.world": WORLD} | files)
    start = read_workspace(top).worlds[0].start
    assert start is not None
    assert (start.x_m, start.launch_file) == (6.0, "shop/launch/go.launch")


def test_each_world_has_a_name_of_its_own_and_an_ambiguous_one_lists_them(tmp_path: Path) -> None:
    inside = ("worlds/office.world", "worlds/office.sdf", "worlds/big/office.world", "worlds/hall.world")
    files = {f"hospital/{each}": WORLD for each in inside} | {"shop/worlds/office.world": WORLD}
    found = read_workspace(written(tmp_path / "ws", manifest("hospital") | manifest("shop") | files))
    names = [each.name for each in found.worlds]
    assert names == ["hall", *(f"hospital/{each}" for each in sorted(inside[:3])), "shop/office"]
    assert [found.world(name) for name in names] == list(found.worlds)
    assert found.world("office.sdf") == found.world("hospital/office.sdf") == found.worlds[2]
    listed = r"hospital/worlds/big/office\.world, hospital/worlds/office\.sdf, hospital/worlds/office\.world"
    with pytest.raises(ConfigurationError, match=f"--world hospital/office: ws has 3 such worlds; name one: {listed}$"):
        found.world("hospital/office")
    with pytest.raises(ConfigurationError, match=f"--world office: ws has 4 such worlds; name one: {listed}, shop/"):
        found.world("office")


def test_the_folder_that_one_is_in_has_its_name_in_errors(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "ws").mkdir()
    monkeypatch.chdir(tmp_path / "ws")
    with pytest.raises(ConfigurationError, match=r"^ws: no file in it is a Gazebo world"):
        read_workspace(Path()).world(None)


@pytest.mark.parametrize("form", ["colcon", "tar", "folder"])
def test_the_only_world_of_a_bundle_needs_no_name(service: Service, tmp_path: Path, form: str) -> None:
    """Only packages of a colcon bundle are looked at: Gazebo's own worlds in its system do not count."""
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
