"""Starts of robots in launch files as people write them; nothing of them is executed."""

from pathlib import Path

import pytest

from prefect_robomaker.tasks.worlds.launch_starts import LaunchStart, find_start, is_read, read_launch_file

ROS_1 = """<launch>
<!-- <arg name="x_pos" default="9"/> -->
<arg default="3.5" name="x_pos"/> <arg name='y_pos' default='-1.0'/> <arg name="yaw" default="$(arg turn)"/>
<include file="$(find house)/launch/{world}"><arg name="x_pos" value="$(arg x_pos)"/></include>
</launch>"""

ROS_2 = '''"""Starts {world}."""
import os
raise SystemExit("launch files are not executed")
TURN = 1.57
# LaunchConfiguration('x_pos', default='9')
def generate_launch_description():
    x = launch.substitutions.LaunchConfiguration("x_pos", default="3.5")
    return LaunchDescription([
        DeclareLaunchArgument(name="y_pos", description="y, not 9", default_value="-1.0"),
        DeclareLaunchArgument("yaw", default_value=str(TURN)),
        DeclareLaunchArgument("z_pos", default_value=["0.1"]),
        os.path.join(share, "worlds", "{world}"),
    ])
'''


def start_of(folder: Path, world: str, **files: str) -> LaunchStart | None:
    """The start of a world in launch files; `__` in their names is a dot."""
    paths = [folder / name.replace("__", ".") for name in files]
    for path, text in zip(paths, files.values(), strict=True):
        path.write_text(text)
    assert all(map(is_read, paths))
    return find_start(world, [read_launch_file(path) for path in paths])


def test_arguments_of_ros_1_are_read_without_what_is_commented_out(tmp_path: Path) -> None:
    found = start_of(tmp_path, "house.world", go__launch=ROS_1.format(world="house.world"))
    assert found == LaunchStart(3.5, -1.0, None, 0.0, "go.launch")


def test_arguments_of_ros_2_are_read_wherever_they_stand(tmp_path: Path) -> None:
    found = start_of(tmp_path, "house.world", go__launch__py=ROS_2.format(world="house.world"))
    assert found == LaunchStart(3.5, -1.0, 0.1, 1.57, "go.launch.py")


def test_a_dictionary_for_an_included_file_is_read(tmp_path: Path) -> None:
    text = 'include("small.world", launch_arguments={"x_pose": "-2.0", "y_pose": -0.5, **more, x: 1}.items())'
    found = start_of(tmp_path, "small.world", go_launch__py=text)
    assert found == LaunchStart(-2.0, -0.5, None, 0.0, "go_launch.py")


def test_the_launch_file_counts_that_includes_the_one_with_the_world(tmp_path: Path) -> None:
    found = start_of(
        tmp_path,
        "house.world",
        a_robot__launch=ROS_1.format(world="b_house.launch"),
        b_house__launch='<launch><arg name="world" default="$(find h)/worlds/house.world"/></launch>',
    )
    assert found == LaunchStart(3.5, -1.0, None, 0.0, "a_robot.launch")


def test_the_start_of_another_world_is_not_taken(tmp_path: Path) -> None:
    """`big_house.world` and `house.world.bak` are other files."""
    for name in ("big_house.world", "house.world.bak"):
        assert start_of(tmp_path, "house.world", go__launch=ROS_1.format(world=name)) is None


@pytest.mark.parametrize(
    "text",
    [
        "def (",
        "\0",
        "(" * 50_000,
        "-" * 50_000 + "1",
        'LaunchConfiguration("x_pos", default="1e999"); "house.world"',
        'x = y; y = x; DeclareLaunchArgument("x_pos", default_value=x); "house.world"',
        "LaunchConfiguration(); LaunchConfiguration(*a, **b); {**c}; 'house.world'",
    ],
)
def test_odd_and_hostile_launch_files_say_no_start(tmp_path: Path, text: str) -> None:
    assert start_of(tmp_path, "house.world", go__launch__py=text, gone__launch="<launch/>") is None


def test_a_launch_file_that_is_gone_says_nothing(tmp_path: Path) -> None:
    assert read_launch_file(tmp_path / "gone.launch").arguments == {}
