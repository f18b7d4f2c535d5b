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

ROS_2_YAML = """launch:
# {{arg: {{name: x_pos, default: 9}}}}
- arg: {{name: x_pos, default: "3.5"}}
- arg: {{name: y_pos, default: -1.0}}
- group:
  - let: {{name: yaw, value: "1.57"}}
  - include:
      file: $(find-pkg-share house)/launch/{world}
      arg:
      - {{name: x, value: "7"}}
"""


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


def test_arguments_in_yaml_are_read_without_comments_and_those_of_other_files(tmp_path: Path) -> None:
    for name in ("go__launch__yaml", "go_launch__yml"):
        found = start_of(tmp_path, "house.world", **{name: ROS_2_YAML.format(world="house.world")})
        assert found == LaunchStart(3.5, -1.0, None, 1.57, name.replace("__", "."))
    commented = "launch:\n# house.world\n- arg: {name: x_pos, default: 1}\n- arg: {name: y_pos, default: 1}\n"
    assert start_of(tmp_path, "house.world", go__launch__yaml=commented) is None


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


@pytest.mark.parametrize(
    "text",
    [
        "{",
        "\0",
        "[" * 20_000,
        "house.world",
        "launch: [arg: {name: x_pos, default: .inf}, arg: {name: y_pos, default: 1}, let: house.world]",
        "launch: !!python/object/apply:os.abort []",
        "a: &a {b: [*a, house.world], arg: [*a, 3, null]}",
        "\n".join(
            ["a0: &a0 {arg: {name: x, default: house.world}}"]
            + [f"a{n}: &a{n} [{', '.join(9 * [f'*a{n - 1}'])}]" for n in range(1, 40)]
        ),
    ],
)
def test_odd_and_hostile_launch_files_in_yaml_say_no_start(tmp_path: Path, text: str) -> None:
    assert start_of(tmp_path, "house.world", go__launch__yaml=text) is None


def test_a_launch_file_that_is_gone_says_nothing(tmp_path: Path) -> None:
    assert read_launch_file(tmp_path / "gone.launch").arguments == []


def test_both_usual_names_of_launch_files_in_xml_are_read(tmp_path: Path) -> None:
    for name in ("go.launch.xml", "go_launch.xml"):
        path = tmp_path / name
        path.write_text(ROS_1.format(world="house.world"))
        assert is_read(path)
        assert find_start("house.world", [read_launch_file(path)]) == LaunchStart(3.5, -1.0, None, 0.0, name)


CAMERA = '<include file="camera.launch"><arg name="x_pos" value="0.1"/><arg name="y_pos" value="0.2"/></include>'


@pytest.mark.parametrize(
    ("file", "text", "expected"),
    [
        # The place of a robot and that of something else are told apart by their names,
        ("a.launch", '<arg name="x_pos" default="3"/><arg name="y" default="4"/>', None),
        ("a.launch", '<arg name="x_pos" default="9"/><arg name="x" value="1"/><arg name="y" value="2"/>', (1, 2)),
        # by the file that they are for,
        ("a.launch", CAMERA + '<arg name="x_pos" default="3"/><arg name="y_pos" default="4"/>', (3, 4)),
        ("a.launch", '<arg name="x_pos" default="3"/>' + CAMERA, (0.1, 0.2)),
        # and by what a dictionary is for.
        ("a.launch.py", 'camera = {"x": 1.0, "y": 2.0}', None),
        ("a.launch.py", 'DeclareLaunchArgument("x", default_value="3"); camera = {"y": 2.0}', None),
        ("a.launch.py", 'more = {"x": 1.0, "y": 2.0}; include(launch_arguments=more.items())', (1, 2)),
        ("a.launch.py", 'f(launch_arguments={"x": 1}); f(launch_arguments={"x": 2, "y": 3})', (2, 3)),
    ],
)
def test_both_coordinates_are_of_one_thing(
    tmp_path: Path, file: str, text: str, expected: tuple[float, float] | None
) -> None:
    path = tmp_path / file
    path.write_text(f'"house.world"; {text}' if file.endswith(".py") else f"<launch>house.world {text}</launch>")
    found = find_start("house.world", [read_launch_file(path)])
    assert (found and (found.x_m, found.y_m)) == expected
