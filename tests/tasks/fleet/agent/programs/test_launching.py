"""Which program a launch configuration names."""

import subprocess
from pathlib import Path

import pytest
from helpers.colcon_bundles import bundle_v2

from prefect_robomaker.tasks.fleet.agent.child.unpacking import unpack
from prefect_robomaker.tasks.fleet.agent.deployment import Launch, Version
from prefect_robomaker.tasks.fleet.agent.errors import StepFailed
from prefect_robomaker.tasks.fleet.agent.programs.launching import environment, launch_command, script_command
from prefect_robomaker.tasks.fleet.agent.settings import Home

PROGRAM = "#!/bin/sh\n"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name, content, mode in [
        ("drive", PROGRAM, 0o755),
        ("courier/launch/yard.launch.py", "", 0o644),
        ("courier/go", PROGRAM, 0o755),
        ("plain.sh", "exit 0", 0o755),
        ("robot.py", "pass", 0o644),
    ]:
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(content)
        path.chmod(mode)
    return tmp_path


def command(folder: Path, file: str, *installed: str) -> list[str]:
    """The command, with the bundle's folder as `.`, where some programs are installed."""
    found = {name: f"/usr/bin/{name}" for name in installed}
    words = launch_command(folder, Launch("courier", file), found.get)
    return [word.replace(str(folder), ".") for word in words]


def test_programs_of_the_bundle_with_arguments(folder: Path) -> None:
    assert command(folder, "drive") == ["./drive"]
    assert command(folder, "go --map 'the yard'") == ["./courier/go", "--map", "the yard"]
    assert command(folder, "plain.sh") == ["/bin/sh", "./plain.sh"]
    assert command(folder, "robot.py")[1:] == ["./robot.py"]


def test_files_of_ros(folder: Path) -> None:
    assert command(folder, "yard.launch.py", "ros2") == ["/usr/bin/ros2", "launch", "./courier/launch/yard.launch.py"]
    assert command(folder, "other.launch", "roslaunch") == ["/usr/bin/roslaunch", "courier", "other.launch"]


def test_installed_programs(folder: Path) -> None:
    assert command(folder, "rover --fast", "rover") == ["/usr/bin/rover", "--fast"]


@pytest.mark.parametrize("file", ["gone", "../drive", "/etc/passwd", "'"])
def test_what_is_not_there_is_told(folder: Path, file: str) -> None:
    inner = folder / "courier"
    with pytest.raises(StepFailed, match="launchFile") as caught:
        command(inner, file)
    assert caught.value.code == "EnvironmentSetupError"


def test_scripts_do_not_lead_out_of_the_bundle(folder: Path) -> None:
    (folder / "courier/link").symlink_to("/bin/true")
    assert script_command(folder, "plain.sh", "PreLaunchFileFailure") == ["/bin/sh", str(folder / "plain.sh")]
    for file in ("../drive", "link", "launch"):
        with pytest.raises(StepFailed, match="no file"):
            script_command(folder / "courier", file, "PreLaunchFileFailure")


def test_tags_come_only_under_their_prefix(folder: Path) -> None:
    launch = Launch("courier", "drive", environment={"MAP": "yard", "HOME": "/elsewhere"})
    version = Version("courier", "1", "0" * 64, launch, "job", {"PATH": "/evil", "a=b": "x", "Color": "red"})
    base = {"PATH": "/usr/bin", "NOTIFY_SOCKET": "/run/x"}

    found = environment(Home(folder), version, folder / "data", base)
    assert (found["PATH"], found["MAP"], found["HOME"]) == ("/usr/bin", "yard", "/elsewhere")
    assert found["AWS_ROBOMAKER_ROBOT_TAG_KEY_PATH"] == "/evil"
    assert "NOTIFY_SOCKET" not in found
    assert not [name for name in found if "=" in name]


SETUP = 'export SOURCED="$SOURCED:$BUNDLE_CURRENT_PREFIX"\n'
ROS = {
    "setup.sh": SETUP,
    "opt/ros/noetic/bin/roslaunch": "#!/bin/bash\necho launched $SOURCED with $*\n",
    "opt/ros/noetic/bin/ros2": "#!/usr/bin/env python2.7\n",
}
WORKSPACE = {
    "setup.sh": SETUP,
    "before.sh": "echo before $SOURCED\n",
    "opt/built_workspace/share/courier/package.xml": "<package><name>courier</name></package>",
    "opt/built_workspace/share/courier/launch/drive.launch": "<launch/>",
}


@pytest.fixture
def colcon(tmp_path: Path) -> Path:
    """Folder of an unpacked bundle of colcon, of version 2."""
    bundle_v2(tmp_path / "output.tar", ROS, WORKSPACE)
    unpack(tmp_path / "output.tar", tmp_path / "1")
    return tmp_path / "1"


def test_a_bundle_of_colcon_is_launched_by_its_own_ros_in_its_overlays(colcon: Path) -> None:
    sourced = f":{colcon}/dependencies:{colcon}/workspace"
    words = launch_command(colcon, Launch("courier", "drive.launch fast:=1"), {}.get)
    said = subprocess.run(words, capture_output=True, text=True, check=True).stdout
    assert said == f"launched {sourced} with courier drive.launch fast:=1\n"
    before = script_command(colcon, "before.sh", "PreLaunchFileFailure")
    assert subprocess.run(before, capture_output=True, text=True, check=True).stdout == f"before {sourced}\n"
    version = Version("courier", "1", "0" * 64, Launch("courier", "drive.launch"), "job")
    packages = environment(Home(colcon.parent), version, colcon, {})["ROS_PACKAGE_PATH"]
    assert packages.endswith(version.folder)


@pytest.mark.parametrize(
    ("file", "said"),
    [
        ("gone.launch", "the bundle's package courier has no launch file gone.launch; it has drive.launch"),
        ("start.launch.py", "has no launch file start.launch.py"),
    ],
)
def test_a_launch_file_that_the_bundle_lacks_is_told_before_it_is_launched(colcon: Path, file: str, said: str) -> None:
    with pytest.raises(StepFailed, match=said) as caught:
        launch_command(colcon, Launch("courier", file), {}.get)
    assert caught.value.code == "EnvironmentSetupError"


def test_a_ros_that_cannot_run_here_is_told(colcon: Path, folder: Path) -> None:
    with pytest.raises(StepFailed, match=r"ros2 of the colcon bundle needs python2\.7, which this robot does not have"):
        launch_command(colcon, Launch("elsewhere", "start.launch.py"), {}.get)
    with pytest.raises(StepFailed, match="is started by `ros2 launch`, which this robot does not have"):
        launch_command(folder, Launch("courier", "yard.launch.py"), {}.get)


def test_a_launch_file_goes_to_the_ros_that_it_is_for(folder: Path) -> None:
    (folder / "courier/launch/old.launch").write_text('<launch><node pkg="x" type="y" name="z"/></launch>')
    (folder / "courier/launch/new.py").write_text("def generate_launch_description():\n    pass\n")
    assert command(folder, "old.launch", "ros2", "roslaunch")[0] == "/usr/bin/roslaunch"
    assert command(folder, "new.py", "ros2", "roslaunch")[:2] == ["/usr/bin/ros2", "launch"]
