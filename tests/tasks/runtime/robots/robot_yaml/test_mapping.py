from pathlib import Path

import pytest
from helpers.robot_stands import CART_MAPPING
from ruamel.yaml import YAML

from prefect_robomaker.schemas.wire.errors import LaunchError
from prefect_robomaker.tasks.runtime.robots.robot_yaml.mapping import read_mapping

GOOD = """version: 1
model: cart.xml
base: chassis
footprint: {radius_m: 0.16}
spawn: {height_m: 0.05}
drive:
  kind: differential
  left: [left]
  right: [right]
  wheel_radius_m: 0.05
  track_width_m: 0.2
  max_linear_mps: 0.6
  max_angular_radps: 2
"""


def read(folder: Path, text: str):
    (folder / "robot.yaml").write_text(text)
    return read_mapping(folder / "robot.yaml")


def test_members_left_out_have_their_defaults(tmp_path: Path) -> None:
    mapping = read(tmp_path, GOOD)
    assert mapping.drive.kind == "differential"
    assert (mapping.drive.max_linear_mps2, mapping.drive.max_angular_radps2) == (1.2, 8.0)
    assert mapping.sensors.lidar is None
    assert mapping.joints is None


def test_every_member_says_what_it_is() -> None:
    from prefect_robomaker.tasks.runtime.robots.robot_yaml.shape import ROBOT_MODELS

    for model in ROBOT_MODELS.values():
        schema = model.model_json_schema()
        for shape in (schema, *schema["$defs"].values()):
            for name, member in shape["properties"].items():
                assert member.get("description"), (shape["title"], name)


@pytest.mark.parametrize(
    ("before", "after", "message"),
    [
        (
            "wheel_radius_m",
            "wheel_radius",
            "robot.yaml:10:3: drive.wheel_radius: is not known; did you mean 'wh",
        ),
        (
            "spawn: {height_m: 0.05}",
            "spawn: {height_m: 0.05}\nsensors: {lidar: {at: eye, max_range_m: 5}}",
            r"robot.yaml:6:28: sensors.lidar.max_range_m: is not known; did you mean 'range_max_m'\?",
        ),
        ("radius_m: 0.16", "radius_m: -1", "robot.yaml:4:23: footprint.radius_m: is -1; it has to be above 0"),
        ("radius_m: 0.16", "radius_m: wide", "footprint.radius_m: is 'wide'; it has to be a number"),
        ("kind: differential", "kind: diferential", "drive.kind: is 'diferential'; did you mean 'differential'"),
        ("  kind: differential\n", "", "drive.kind: is missing; there are differential, velocity, actuators"),
        ("base: chassis\n", "", "base: is missing; it is required: Body"),
        ("left: [left]", "left: []", "drive.left: is an empty list; its length has to be at least 1"),
        ("version: 1", "version: 2", "version: is 2; it has to be 1"),
        ("model: cart.xml", "model: cart.xml\nmodel: other.xml", "'model' is there twice"),
        (GOOD, "- 1", "robot.yaml:1:1: it has to be a mapping"),
        (GOOD, "a: [", "this is not YAML"),
    ],
)
def test_a_mistake_is_named_with_file_place_value_and_what_would_be_right(
    tmp_path: Path, before: str, after: str, message: str
) -> None:
    with pytest.raises(LaunchError, match=message) as error:
        read(tmp_path, GOOD.replace(before, after, 1))
    assert error.value.failure_code == "InvalidBundleRobotApplication"


def test_several_mistakes_are_told_at_once(tmp_path: Path) -> None:
    text = GOOD.replace("base:", "bace:").replace("track_width_m: 0.2", "track_width_m: no")
    with pytest.raises(LaunchError, match=r"bace: is not known; did you mean 'base'\?; .*track_width_m: is 'no'"):
        read(tmp_path, text)


def test_the_mapping_of_the_tests_is_a_good_one(tmp_path: Path) -> None:
    with (tmp_path / "robot.yaml").open("w") as stream:
        YAML(typ="safe", pure=True).dump(CART_MAPPING, stream)
    assert read_mapping(tmp_path / "robot.yaml").spawn.keyframe == "up"
