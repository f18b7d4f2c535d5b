"""Which program a launch configuration names."""

from pathlib import Path

import pytest

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
