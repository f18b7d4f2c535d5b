from pathlib import Path

import pytest

from prefect_robomaker.tasks.ros_launching import is_launch_file, node_variables, own_master, readers_of

OF_ROS_1 = """<launch><!-- <node pkg="a" exec="b"/> -->
<node
  pkg="my_robot" type="node.py" name="node"/></launch>"""
OF_ROS_2 = """<launch><node pkg="my_robot" exec="node"><param name="type" value="x"/></node></launch>"""


@pytest.mark.parametrize(
    ("name", "text", "readers"),
    [
        ("sim.launch", OF_ROS_1, (1,)),
        ("sim.launch", OF_ROS_2, (2,)),
        ("sim.launch.xml", OF_ROS_1, (1,)),
        ("sim.launch.xml", OF_ROS_2, (2,)),
        ("sim.launch", '<launch><include file="$(find my_robot)/launch/a.launch"/></launch>', (1,)),
        ("sim.launch", '<launch><include file="$(find-pkg-share my_robot)/launch/a.launch"/></launch>', (2,)),
        ("sim.launch", '<launch><param name="x" value="$(arg x)"/></launch>', (1,)),
        ("sim.launch", '<launch><let name="x" value="1"/></launch>', (2,)),
        ("sim.launch", "<launch/>", (1, 2)),
        ("sim.launch.xml", "<launch/>", (2, 1)),
        ("sim.launch", "no XML at all", (1, 2)),
        ("sim.launch.py", "", (2,)),
        ("sim.launch.yaml", "", (2,)),
    ],
)
def test_what_a_file_says_decides_which_ros_reads_it(
    tmp_path: Path, name: str, text: str, readers: tuple[int, ...]
) -> None:
    (tmp_path / name).write_text(text)
    assert readers_of(name, tmp_path / name) == readers
    assert is_launch_file(name, tmp_path / name)


@pytest.mark.parametrize(("name", "readers"), [("a.launch", (1, 2)), ("a.launch.xml", (2, 1)), ("a.launch.py", (2,))])
def test_names_are_all_there_is_to_say_of_installed_packages(name: str, readers: tuple[int, ...]) -> None:
    assert readers_of(name, None) == readers


def test_a_script_that_describes_a_launch_is_no_script(tmp_path: Path) -> None:
    path = tmp_path / "sim_launch.py"
    path.write_text("from launch import LaunchDescription\n\n\ndef generate_launch_description():\n    return None\n")
    assert is_launch_file(path.name, path)
    path.write_text("print('generate_launch_description is what I do not define')\n")
    assert not is_launch_file(path.name, path)
    assert not is_launch_file(path.name, None)


def test_nodes_find_the_python_of_ros_before_that_of_jobs() -> None:
    environ = {"PATH": "/venv/bin:/usr/local/bin:/usr/bin", "ROS_PACKAGE_PATH": "/opt/more", "SECRET": "x"}
    launcher, python = Path("/opt/ros/noetic/bin/roslaunch"), "/venv/bin/python"

    found = node_variables(Path("/bundle"), launcher, python, {}, environ)

    assert found == {
        "PATH": "/opt/ros/noetic/bin:/usr/local/bin:/usr/bin:/venv/bin",
        "ROS_PACKAGE_PATH": "/bundle:/opt/more",
    }


def test_a_launch_configurations_own_variables_go_before_those_of_this_process() -> None:
    variables = {"PATH": "/mine", "ROS_PACKAGE_PATH": "/packages"}

    found = node_variables(Path("/b"), Path("/usr/bin/roslaunch"), "/venv/bin/python", variables, {"PATH": "/usr/bin"})

    assert found == {"PATH": "/usr/bin:/mine:/venv/bin", "ROS_PACKAGE_PATH": "/b:/packages"}
    assert "ROS_PACKAGE_PATH" not in node_variables(None, Path("/usr/bin/ros2"), "/venv/bin/python", {}, {})


def test_masters_have_ports_of_their_own_on_this_machine_only() -> None:
    one, other = own_master(), own_master()
    assert one["ROS_MASTER_URI"] != other["ROS_MASTER_URI"]
    assert one["ROS_HOSTNAME"] == "localhost"
