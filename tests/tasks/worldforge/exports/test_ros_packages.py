"""The packages of an export: read, built and launched with ROS's own tools, where they are installed.

Debian has them as catkin, ament-cmake, rospack-tools and python3-roslaunch; what needs a missing one is
skipped and says so.
"""

import ast
import shutil
import subprocess
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest
from catkin_pkg.package import parse_package
from helpers.required_programs import needs

SHARED, WORLDS = PACKAGES = ("aws_robomaker_worldforge_shared_models", "aws_robomaker_worldforge_worlds")
FOLDERS = {SHARED: "models", WORLDS: "worlds"}
VARIABLES = ("GAZEBO_MODEL_PATH", "GZ_SIM_RESOURCE_PATH", "IGN_GAZEBO_RESOURCE_PATH", "SDF_PATH")
# ROS's tools are the system's; they must not find this project's Python.
SYSTEM = {"PATH": "/usr/bin:/bin", "HOME": "/nonexistent", "LANG": "C.UTF-8"}


def run(*command: str, cwd: Path, **environment: str) -> str:
    done = subprocess.run(command, cwd=cwd, env={**SYSTEM, **environment}, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-4000:]
    return done.stdout


@pytest.fixture
def workspace(exported: Path, tmp_path: Path) -> Path:
    shutil.copytree(exported, tmp_path / "src" / exported.name)
    return tmp_path


# catkin_pkg uses an old name of pyparsing's.
@pytest.mark.filterwarnings("ignore:'\\w+' .*deprecated:DeprecationWarning")
@pytest.mark.parametrize("ros_version", ["1", "2"])
@pytest.mark.parametrize("package", PACKAGES)
def test_package_xml_is_what_catkin_and_colcon_read(exported: Path, package: str, ros_version: str) -> None:
    warnings: list[str] = []
    read = parse_package(str(exported / package), warnings=warnings)
    read.evaluate_conditions({"ROS_VERSION": ros_version})
    assert warnings == []
    assert (read.name, read.package_format) == (package, 3)
    build = {"1": "catkin", "2": "ament_cmake"}[ros_version]
    assert read.get_build_type() == build
    assert [tool.name for tool in read.buildtool_depends if tool.evaluated_condition] == [build]
    (gazebo,) = [export for export in read.exports if export.tagname == "gazebo_ros"]
    folder = gazebo.attributes["gazebo_model_path"].replace("${prefix}", str(exported / package))
    assert Path(folder).is_dir()
    needed = {each.name for each in read.exec_depends if each.evaluated_condition}
    # Without this dependency, rospack does not ask a package for its gazebo_model_path.
    assert ("gazebo_ros" in needed) == (ros_version == "1")
    assert (package == WORLDS) == (SHARED in needed)


def test_every_model_is_a_folder_that_gazebo_finds(exported: Path) -> None:
    folders = list((exported / SHARED / "models").iterdir())
    folders += list((exported / WORLDS / "worlds").iterdir())
    for folder in folders:
        config = ET.parse(folder / "model.config").getroot()
        sdf = config.find("sdf")
        assert sdf is not None
        model = ET.parse(folder / str(sdf.text)).getroot().find("model")
        assert model is not None
        assert config.findtext("name") == model.get("name") == folder.name
    known = {folder.name: folder for folder in folders}
    for file in [*exported.rglob("*.world"), *exported.rglob("*.sdf")]:
        for uri in ET.parse(file).getroot().iter("uri"):
            name, _, inside = str(uri.text).removeprefix("model://").partition("/")
            assert (known[name] / inside).exists(), f"{uri.text} in {file}"


def test_the_ros_2_launch_file_is_python_and_names_the_first_world(exported: Path) -> None:
    source = (exported / WORLDS / "launch" / "launch_world.py").read_text()
    tree = ast.parse(source)
    assert "generate_launch_description" in {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}
    first = sorted(path.name for path in (exported / WORLDS / "worlds").iterdir())[0]
    assert f'FIRST_WORLD = "{first}"' in source


def test_the_ros_1_launch_file_passes_only_what_gazebo_takes(exported: Path) -> None:
    launch = ET.parse(exported / WORLDS / "launch" / "launch_world.launch").getroot()
    include = launch.find("include")
    assert include is not None
    assert include.get("file") == "$(find gazebo_ros)/launch/empty_world.launch"
    passed = {arg.get("name") for arg in include}
    assert passed == {"world_name", "gui", "paused", "use_sim_time", "debug", "verbose"}


@pytest.mark.deep
@needs("ros", shutil.which("catkin_make"), "catkin is not installed (Debian's catkin)")
def test_catkin_builds_installs_and_finds_the_packages(workspace: Path) -> None:
    run("catkin_make", "install", cwd=workspace, ROS_VERSION="1")
    for setup, place in (
        ("devel/setup.sh", "src/aws_robomaker_worldforge_pkgs/{package}/{folder}"),
        ("install/setup.sh", "install/share/{package}/{folder}"),
    ):
        # Twice, as a shell's start-up file and its user might.
        output = run("sh", "-c", f". {setup}; . {setup}; env", cwd=workspace)
        found = dict(line.split("=", 1) for line in output.splitlines() if "=" in line)
        folders = {str(workspace / place.format(package=package, folder=FOLDERS[package])) for package in PACKAGES}
        for variable in VARIABLES:
            assert sorted(found[variable].split(":")) == sorted(folders)
        assert all(Path(folder).is_dir() for folder in folders)


@needs("ros", Path("/usr/share/ament_cmake/cmake").is_dir(), "ament-cmake is not installed (Debian's ament-cmake)")
@pytest.mark.parametrize("package", [pytest.param(SHARED, marks=pytest.mark.deep), WORLDS])
def test_ament_installs_a_package_and_its_environment(workspace: Path, package: str) -> None:
    top = workspace / "src" / "aws_robomaker_worldforge_pkgs"
    build = workspace / "build" / package
    prefix = workspace / "install" / package
    run(
        "cmake", "-S", str(top / package), "-B", str(build), f"-DCMAKE_INSTALL_PREFIX={prefix}",
        cwd=workspace, ROS_VERSION="2",
    )  # fmt: skip
    run("cmake", "--install", str(build), cwd=workspace)
    share = prefix / "share" / package
    assert (prefix / "share" / "ament_index" / "resource_index" / "packages" / package).is_file()
    assert {path.name for path in (top / package / FOLDERS[package]).iterdir()} == {
        path.name for path in (share / FOLDERS[package]).iterdir()
    }
    output = run("sh", "-c", f". {share}/local_setup.sh; env", cwd=workspace, AMENT_CURRENT_PREFIX=str(prefix))
    for variable in VARIABLES:
        assert f"{variable}={share / FOLDERS[package]}\n" in output
    assert package == SHARED or (share / "launch" / "launch_world.py").is_file()


@pytest.mark.deep
@needs(
    "ros",
    shutil.which("roslaunch") and shutil.which("rospack"),
    "roslaunch or rospack is not installed (Debian's python3-roslaunch, rospack-tools)",
)
def test_roslaunch_starts_the_world_that_was_asked_for(workspace: Path) -> None:
    """Gazebo itself is not there: its launch file is replaced by one that tells what it was given."""
    gazebo = workspace / "src" / "gazebo_ros"
    (gazebo / "launch").mkdir(parents=True)
    (gazebo / "package.xml").write_text(
        "<package><name>gazebo_ros</name><version>1.0.0</version><description>d</description>"
        '<maintainer email="a@example.com">a</maintainer><license>none</license></package>'
    )
    arguments = "".join(f'<arg name="{name}"/>' for name in ("paused", "use_sim_time", "debug", "verbose"))
    (gazebo / "launch" / "empty_world.launch").write_text(
        f'<launch>{arguments}<arg name="gui"/><arg name="world_name"/>'
        '<param name="gui" value="$(arg gui)"/><param name="world" value="$(arg world_name)"/></launch>'
    )
    paths = {
        "ROS_PACKAGE_PATH": str(workspace / "src"), "ROS_MASTER_URI": "http://127.0.0.1:11311",
        "ROS_HOME": str(workspace / "ros"), "ROS_ROOT": "/usr/share/ros", "HOME": str(workspace),
    }  # fmt: skip
    names = sorted(path.name for path in (workspace / "src").rglob("worlds/generation_*") if path.is_dir())

    def launched(*arguments: str, **environment: str) -> str:
        return run(
            "roslaunch", "--dump-params", WORLDS, "launch_world.launch", *arguments, cwd=workspace, **paths,
            **environment,
        )  # fmt: skip

    for name, output in (
        (names[0], launched("gui:=true")),
        (names[1], launched("gui:=true", WORLD_ID=names[1])),
        (names[2], launched("gui:=true", f"world_id:={names[2]}", WORLD_ID=names[1])),
    ):
        assert "/gui: true" in output
        (world,) = [line.split(": ", 1)[1] for line in output.splitlines() if line.startswith("/world:")]
        assert world.endswith(f"/worlds/{name}/{name}.world")
        assert Path(world).is_file()
    listed = run("rospack", "plugins", "--attrib=gazebo_model_path", "gazebo_ros", cwd=workspace, **paths)
    assert {line.split()[0]: Path(line.split()[1]).is_dir() for line in listed.splitlines()} == dict.fromkeys(
        PACKAGES, True
    )
