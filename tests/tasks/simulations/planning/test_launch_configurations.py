"""What launch configurations start, in bundles and installed packages."""

from pathlib import Path
from typing import Any

import pytest

from prefect_robomaker.schemas.wire.errors import LaunchError
from prefect_robomaker.tasks.simulations.planning.launch_configurations import (
    Code,
    Factory,
    Program,
    check_pair,
    resolve_launch,
)

PYTHON = "/here/python"
CRASH = "RobotApplicationCrash"


@pytest.fixture
def bundle(tmp_path: Path) -> Path:
    """A bundle with a Python package, a ROS package, programs and data."""
    files = {
        "my_nav/__init__.py": "",
        "my_nav/drive.py": "",
        "my_nav/scripts/tour.py": "",
        "plain/start.py": "",
        "plain/go.sh": "#!/bin/bash\n",
        "plain/notes.txt": "no program",
        "ros_pkg/launch/sim.launch.py": "",
        "ros_pkg/launch/sim.launch": "",
        "bin/drive": "#!/bin/sh\n",
        "install/setup.bash": "",
    }
    for name, content in files.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(content)
    return tmp_path


def resolve(bundle: Path | None, installed: tuple[str, ...] = (), **launch: Any) -> Factory | Program:
    code = Code("robot", "mine", folder=bundle) if bundle else Code("robot", "mine", module="my_robot")
    return resolve_launch(code, launch, lambda name: f"/usr/bin/{name}" if name in installed else None, PYTHON)


@pytest.mark.parametrize(
    ("launch", "argv"),
    [
        ({"command": ["bin/drive", "--fast"]}, ("{bundle}/bin/drive", "--fast")),
        ({"command": ["./bin/drive"]}, ("{bundle}/bin/drive",)),
        ({"command": ["python", "-m", "x"]}, ("/usr/bin/python", "-m", "x")),
        ({"packageName": "my_nav", "launchFile": "drive.py"}, (PYTHON, "-m", "my_nav.drive")),
        ({"packageName": "my_nav", "launchFile": "tour.py"}, (PYTHON, "{bundle}/my_nav/scripts/tour.py")),
        ({"packageName": "plain", "launchFile": "start.py"}, (PYTHON, "{bundle}/plain/start.py")),
        ({"packageName": "plain", "launchFile": "go.sh"}, ("{bundle}/plain/go.sh",)),
        # A command wins over the rest.
        ({"command": ["python"], "packageName": "my_nav", "launchFile": "drive.py"}, ("/usr/bin/python",)),
    ],
)
def test_programs_of_a_bundle(bundle: Path, launch: dict[str, Any], argv: tuple[str, ...]) -> None:
    expected = Program(tuple(word.replace("{bundle}", str(bundle)) for word in argv))
    assert resolve(bundle, ("python",), **launch) == expected


def test_other_names_are_factories(bundle: Path) -> None:
    assert resolve(bundle, packageName="my_nav", launchFile="arena.make_agent") == Factory("my_nav.arena.make_agent")


@pytest.mark.parametrize(
    ("launch", "expected"),
    [
        ({}, Factory("my_robot.make_agent")),
        ({"packageName": "slow"}, Factory("my_robot.slow.make_agent")),
        ({"launchFile": "agent.make"}, Factory("my_robot.agent.make")),
        ({"packageName": "slow", "launchFile": "drive.py"}, Program((PYTHON, "-m", "my_robot.slow.drive"))),
        ({"launchFile": "drive.py"}, Program((PYTHON, "-m", "my_robot.drive"))),
    ],
)
def test_installed_packages(launch: dict[str, Any], expected: Factory | Program) -> None:
    assert resolve(None, **launch) == expected


@pytest.mark.parametrize("package", ["..usr.bin", "..", "bin..usr.bin"])
def test_no_package_leads_out_of_the_bundle(bundle: Path, package: str) -> None:
    started = resolve(bundle, packageName=package, launchFile="env")
    assert started == Factory(f"{package}.env")  # which cannot be imported, and says so


def test_launch_files_go_to_ros_in_the_environment_of_the_bundle(bundle: Path) -> None:
    launch = {"packageName": "ros_pkg", "launchFile": "sim.launch.py"}
    path = str(bundle / "ros_pkg/launch/sim.launch.py")

    program = resolve(bundle, ("ros2",), **launch)

    assert isinstance(program, Program)
    assert program.argv[:2] == ("/bin/bash", "-c")
    assert program.argv[4:] == ("1", str(bundle / "install/setup.bash"), "/usr/bin/ros2", "launch", path)


def test_ros_one_is_asked_first_for_files_that_either_could_read(bundle: Path) -> None:
    launch = {"packageName": "ros_pkg", "launchFile": "sim.launch"}
    path = str(bundle / "ros_pkg/launch/sim.launch")

    both = resolve(bundle, ("ros2", "roslaunch"), **launch)

    assert isinstance(both, Program)
    assert both.argv[-2:] == ("/usr/bin/roslaunch", path)
    assert both.ros == 1
    installed = resolve(None, ("roslaunch",), **launch)
    assert installed == Program(("/usr/bin/roslaunch", "ros_pkg", "sim.launch"), Path("/usr/bin/roslaunch"), 1)


def test_what_a_launch_file_says_goes_before_its_name(bundle: Path) -> None:
    (bundle / "ros_pkg/launch/sim.launch").write_text('<launch><node pkg="a" exec="b"/></launch>')
    (bundle / "ros_pkg/launch/sim_launch.py").write_text("def generate_launch_description(): ...\n")

    for file in ("sim.launch", "sim_launch.py"):
        program = resolve(bundle, ("ros2", "roslaunch"), packageName="ros_pkg", launchFile=file)
        assert isinstance(program, Program)
        assert program.argv[-3:] == ("/usr/bin/ros2", "launch", str(bundle / "ros_pkg/launch" / file))
        with pytest.raises(LaunchError, match="is started by `ros2 launch`, which this machine does not have"):
            resolve(bundle, ("roslaunch",), packageName="ros_pkg", launchFile=file)
        arena = Code("simulation", "arena", folder=bundle)
        with pytest.raises(LaunchError, match="; in place of Gazebo, give the built-in indoor-navigation"):
            resolve_launch(arena, {"packageName": "ros_pkg", "launchFile": file}, lambda _: None, PYTHON)


def test_a_launch_file_that_its_package_does_not_have_is_told_at_once(bundle: Path) -> None:
    package = bundle / "src/deep/robot_sources"
    (package / "launch/parts").mkdir(parents=True)
    (package / "package.xml").write_text('<?xml version="1.0"?>\n<package>\n  <name> my_robot </name>\n</package>')
    for name in ("work.launch", "parts/arm.launch"):
        (package / "launch" / name).write_text("<launch/>")

    with pytest.raises(LaunchError) as caught:
        resolve(bundle, ("roslaunch",), packageName="my_robot", launchFile="wrok.launch")

    assert caught.value.failure_code == "RobotApplicationCrash"
    assert str(caught.value) == (
        "robot application mine: the bundle's package my_robot has no launch file wrok.launch; "
        "it has arm.launch, work.launch"
    )
    # ROS finds a package's files wherever they are in it, and packages that are installed here.
    for name, file in (("my_robot", "arm.launch"), ("installed_here", "wrok.launch")):
        program = resolve(bundle, ("roslaunch",), packageName=name, launchFile=file)
        assert isinstance(program, Program)
        assert program.argv[-3:] == ("/usr/bin/roslaunch", name, file)


def test_the_second_application_waits_for_the_firsts_master(bundle: Path) -> None:
    code = Code("robot", "mine", folder=bundle)
    launch = {"packageName": "ros_pkg", "launchFile": "sim.launch"}

    program = resolve_launch(code, launch, lambda name: f"/usr/bin/{name}", PYTHON, has_master=True)

    assert isinstance(program, Program)
    assert program.argv[-3:-1] == ("/usr/bin/roslaunch", "--wait")


@pytest.mark.parametrize(
    ("launch", "code", "words"),
    [
        (
            {"command": ["bin/fly"]},
            "RobotApplicationCrash",
            "'bin/fly', which is neither in its bundle nor on the path",
        ),
        ({"command": ["../secret"]}, "RobotApplicationCrash", "neither in its bundle"),
        ({"packageName": "my_nav", "launchFile": "fly.py"}, "RobotApplicationCrash", "my_nav/fly.py or my_nav/launch/"),
        (
            {"packageName": "plain", "launchFile": "notes.txt"},
            "RobotApplicationCrash",
            "first line such as #!/bin/bash",
        ),
        (
            {"packageName": "ros_pkg", "launchFile": "sim.launch.py"},
            "InvalidInput",
            "`ros2 launch`, which this machine",
        ),
        ({"packageName": "ros_pkg", "launchFile": "sim.launch"}, "InvalidInput", "`roslaunch` or `ros2 launch`"),
    ],
)
def test_what_cannot_be_started_says_why(bundle: Path, launch: dict[str, Any], code: str, words: str) -> None:
    with pytest.raises(LaunchError) as caught:
        resolve(bundle, **launch)
    assert caught.value.failure_code == code
    assert words in str(caught.value)
    assert "mine" in str(caught.value)


def test_an_agent_needs_an_environment() -> None:
    program, factory = Program(("x",)), Factory("my_nav.make_agent")

    with pytest.raises(LaunchError, match=r"agent mine|application mine .* launchConfig\.command") as caught:
        check_pair(("arena", program), ("mine", factory))
    assert caught.value.failure_code == "InvalidInput"
    check_pair(("arena", program), ("mine", program))
    check_pair(("arena", factory), ("mine", program))
    check_pair(None, ("mine", factory))
    check_pair(("arena", program), None)
