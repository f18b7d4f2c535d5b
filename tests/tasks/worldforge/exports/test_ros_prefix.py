"""The packages of a world in the form in which ROS finds installed ones."""

import subprocess
from pathlib import Path

import pytest
from helpers.made_once import made_once

from prefect_robomaker.tasks.worldforge.exports.ros_prefix import PACKAGES, SETUP_VARIABLE, world_map, write_ros_prefix

NAME = "generation_82856b0yq33y_world_10"
ASKED = ("ROS_PACKAGE_PATH", "AMENT_PREFIX_PATH", "GAZEBO_MODEL_PATH")


@pytest.fixture(scope="module")
def prefix(bundles: dict[str, Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    return made_once(tmp_path_factory, "ros-prefix", lambda folder: write_ros_prefix(NAME, bundles[NAME], folder))


def sourced(prefix: Path, command: str, **variables: str) -> dict[str, str]:
    """The variables that a shell that allows no mistakes has after a command."""
    text = f"set -eu; {command}; env"
    done = subprocess.run(
        ["sh", "-c", text], env={"PATH": "/usr/bin:/bin", **variables}, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    return dict(line.split("=", 1) for line in done.stdout.splitlines() if "=" in line)


def test_ament_finds_the_packages(prefix: Path) -> None:
    """It looks for a file of the package's name in its index, and then in `share`."""
    for package in PACKAGES:
        assert (prefix / "share/ament_index/resource_index/packages" / package).is_file()
        assert (prefix / "share" / package / "package.xml").is_file()
    assert world_map(prefix, NAME).is_file()


@pytest.mark.parametrize("by", [SETUP_VARIABLE, "BUNDLE_CURRENT_PREFIX"])
def test_the_setup_puts_the_world_first_once(prefix: Path, by: str) -> None:
    share = f"{prefix}/share"
    before = {"ROS_PACKAGE_PATH": f"/mine:{share}:/ros:{share}", "AMENT_PREFIX_PATH": "/opt/ros/jazzy"}

    found = sourced(prefix, f". {prefix}/setup.sh; . {prefix}/setup.sh", **{by: str(prefix)}, **before)

    models = [
        f"{share}/{package}/{folder}" for package, folder in zip(reversed(PACKAGES), ("models", "worlds"), strict=True)
    ]
    assert [found[name] for name in ASKED] == [f"{share}:/mine:/ros", f"{prefix}:/opt/ros/jazzy", ":".join(models)]
    assert not [name for name in found if name.startswith("_worldforge")]


def test_a_setup_that_does_not_know_its_folder_changes_nothing(prefix: Path) -> None:
    found = sourced(prefix, f". {prefix}/setup.sh", ROS_PACKAGE_PATH="/mine")

    assert found["ROS_PACKAGE_PATH"] == "/mine"
