import os
import time
from pathlib import Path

import pytest

from prefect_robomaker.tasks.bundles.launch_files import is_launch_file, node_variables, own_master, readers_of

OF_ROS_1 = """<launch><!-- <node pkg="a" exec="b"/> -->
<node
  pkg="my_robot" type="node.py" name="node"/></launch>"""
OF_ROS_2 = """<launch><node pkg="my_robot" exec="node"><param name="type" value="x"/></node></launch>"""

BOMB = f"""<!DOCTYPE launch [<!ENTITY a "{"a" * 1000}"><!ENTITY b "{"&a;" * 1000}"><!ENTITY c "{"&b;" * 1000}">
<!ENTITY d "{"&c;" * 1000}">]>"""
LONG_ARGUMENTS = "<launch>" + '<arg name="x" default="y"/>' * 20_000


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
        ("sim.launch", "", (1, 2)),
        # `>` is no end of a tag in an attribute.
        ("sim.launch.xml", '<launch><node if="$(eval 1 > 0)" name="n" pkg="p" type="t.py"/></launch>', (1,)),
        ("sim.launch", '<launch><node if="$(eval 1 > 0)" name="n" pkg="p" exec="t"/></launch>', (2,)),
        # What is only written about says nothing.
        ("sim.launch.xml", '<launch><param name="x" value="&lt;node type=&quot;t&quot;/>"/></launch>', (2, 1)),
        ("sim.launch.xml", "<launch><![CDATA[<node exec='x'/><test/>]]></launch>", (2, 1)),
        ("sim.launch.xml", "<launch><rosparam>map: $(find my_robot)/map.yaml</rosparam></launch>", (1,)),
        ("sim.launch.xml", "<launch><group>$(find my_robot)</group></launch>", (1,)),
        # What comes before an error decides, as far as it can.
        ("sim.launch.xml", '<launch><node pkg="p" type="t"/><node', (1,)),
        ("sim.launch.xml", '<launch><node pkg="p" type="t"/><node if="1 < 2" exec="x"/></launch>', (1,)),
        ("sim.launch.xml", '<?xml version="1.0" encoding="no-such"?><launch/>', (2, 1)),
        ("sim.launch.xml", '<?xml version="1.0" encoding="base64"?><launch/>', (2, 1)),
        ("sim.launch.xml", '<!DOCTYPE launch><launch><node pkg="p" type="t"/></launch>', (1,)),
        ("sim.launch.xml", f"{BOMB}<launch>&d;<test/></launch>", (2, 1)),
        ("sim.launch.xml", f"{LONG_ARGUMENTS}<test/></launch>", (1,)),
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


HALF_A_MEGABYTE = 500_000


@pytest.mark.parametrize(
    "text",
    [
        "<launch>" + "<node " * (HALF_A_MEGABYTE // 6),
        "<launch>" + "<node>" * (HALF_A_MEGABYTE // 6),
        "<launch><node " + "".join(f"a{n}='' " for n in range(HALF_A_MEGABYTE // 11)),
        "<launch><node a='" + "$(eval " * (HALF_A_MEGABYTE // 7),
        "<launch>" + "<!--" * (HALF_A_MEGABYTE // 4),
        "<launch>" + "<node a='$('/>" * (HALF_A_MEGABYTE // 14),
        "<launch>" + "$(find" * (HALF_A_MEGABYTE // 6),
        "\0" * HALF_A_MEGABYTE,
    ],
    ids=["tags", "elements", "attributes", "value", "comments", "nodes", "text", "nothing"],
)
def test_no_file_keeps_the_worker_busy(tmp_path: Path, text: str) -> None:
    (tmp_path / "a.launch").write_text(text)
    (tmp_path / "a.py").write_text(text)
    began = time.thread_time()
    assert readers_of("a.launch", tmp_path / "a.launch") == (1, 2)
    assert not is_launch_file("a.py", tmp_path / "a.py")
    assert time.thread_time() - began < 30.0, "what reads on from each of its beginnings takes hours"


def test_of_huge_files_only_the_beginning_is_read(tmp_path: Path) -> None:
    with (tmp_path / "a.launch").open("w") as file:
        file.write('<launch><node pkg="p" exec="e"/>')
        file.truncate(1 << 40)  # which takes no space
    os.link(tmp_path / "a.launch", tmp_path / "a.py")
    assert readers_of("a.launch", tmp_path / "a.launch") == (2,)
    assert not is_launch_file("a.py", tmp_path / "a.py")


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

    found = node_variables([Path("/bundle")], launcher, python, {}, environ)

    assert found == {
        "PATH": "/opt/ros/noetic/bin:/usr/local/bin:/usr/bin:/venv/bin",
        "ROS_PACKAGE_PATH": "/bundle:/opt/more",
    }


def test_a_launch_configurations_own_variables_go_before_those_of_this_process() -> None:
    variables = {"PATH": "/mine", "ROS_PACKAGE_PATH": "/packages"}

    found = node_variables(
        [Path("/b")], Path("/usr/bin/roslaunch"), "/venv/bin/python", variables, {"PATH": "/usr/bin"}
    )

    assert found == {"PATH": "/usr/bin:/mine:/venv/bin", "ROS_PACKAGE_PATH": "/b:/packages"}
    assert "ROS_PACKAGE_PATH" not in node_variables([], Path("/usr/bin/ros2"), "/venv/bin/python", {}, {})


def test_masters_have_ports_of_their_own_on_this_machine_only() -> None:
    one, other = own_master(), own_master()
    assert one["ROS_MASTER_URI"] != other["ROS_MASTER_URI"]
    assert one["ROS_HOSTNAME"] == "localhost"
