"""The packages of a job's world in the folders of its run."""

import os
from pathlib import Path

import pytest

from prefect_robomaker.tasks.simulations.environment.folders import WorldPackages
from prefect_robomaker.tasks.simulations.inputs.world_packages import put_world_into_copies, world_variables

WORLDS, MODELS = "aws_robomaker_worldforge_worlds", "aws_robomaker_worldforge_shared_models"


def packages(share: Path, mark: str) -> Path:
    for name, folder in ((WORLDS, "worlds/w"), (WORLDS, "launch"), (MODELS, "models/m")):
        (share / name / folder).mkdir(parents=True)
        (share / name / folder / "mark").write_text(mark)
        (share / name / "package.xml").write_text(f"<package><name>{name}</name></package>")
    return share


@pytest.fixture
def ours(tmp_path: Path) -> WorldPackages:
    packages(tmp_path / "ours" / "share", "ours")
    return WorldPackages(tmp_path / "ours", "w")


def test_copies_of_other_worlds_hold_the_jobs_world_wherever_a_workspace_has_them(
    ours: WorldPackages, tmp_path: Path
) -> None:
    workspace = tmp_path / "workspace"
    places = [packages(workspace / "src" / "deep", "other"), packages(workspace / "install" / "share", "other")]
    (places[0] / WORLDS / "mine.txt").write_text("kept")
    (places[0] / WORLDS / "worlds" / "another").mkdir()
    (workspace / "src" / "worlds").mkdir()
    (workspace / "src" / "worlds" / "mark").write_text("of the user")

    put_world_into_copies(workspace, ours)

    marks = {path.relative_to(workspace).as_posix(): path.read_text() for path in workspace.rglob("mark")}
    assert marks.pop("src/worlds/mark") == "of the user"
    assert set(marks.values()) == {"ours"}
    assert len(marks) == 6
    assert (places[0] / WORLDS / "mine.txt").read_text() == "kept"
    assert not (places[0] / WORLDS / "worlds" / "another").exists()


def test_links_of_a_workspace_lead_nothing_out_of_it(ours: WorldPackages, tmp_path: Path) -> None:
    outside, package = packages(tmp_path / "outside", "outside"), tmp_path / "workspace" / WORLDS
    package.mkdir(parents=True)
    (package / "package.xml").write_text(f"<name>{WORLDS}</name>")
    (package / "worlds").symlink_to(outside / WORLDS / "worlds")
    (tmp_path / "workspace" / "linked").symlink_to(outside)
    (tmp_path / "workspace" / "package.xml").symlink_to(outside / WORLDS / "package.xml")

    put_world_into_copies(tmp_path / "workspace", ours)

    assert (outside / WORLDS / "worlds" / "w" / "mark").read_text() == "outside"
    assert (package / "worlds" / "w" / "mark").read_text() == "ours"
    assert not (package / "worlds").is_symlink()


@pytest.mark.parametrize("link", ["x/opt/install", "x/opt/ros/melodic", "x"])
def test_links_of_a_workspace_that_says_it_is_a_colcon_bundle_lead_nothing_out_of_it(
    ours: WorldPackages, tmp_path: Path, link: str
) -> None:
    share = "opt/install" if link == "x" else "share" if link.endswith("melodic") else ""
    outside = packages(tmp_path / "outside" / share, "outside")
    home = tmp_path / "home"
    (home / link).parent.mkdir(parents=True)
    (home / ".colcon-overlays").write_text("x\n")
    (home / link).symlink_to(tmp_path / "outside")

    put_world_into_copies(home, ours)

    assert (outside / WORLDS / "worlds" / "w" / "mark").read_text() == "outside"


def test_the_world_is_before_what_variables_say_already(ours: WorldPackages) -> None:
    share = str(ours.prefix / "share")

    found = world_variables(ours, {"ROS_PACKAGE_PATH": f"/mine:{share}", "SDF_PATH": ""}, in_container=False)

    assert found["ROS_PACKAGE_PATH"].split(os.pathsep) == [share, "/mine"]
    assert found["SDF_PATH"].split(os.pathsep) == found["GAZEBO_MODEL_PATH"].split(os.pathsep)
    assert all(each.startswith(share) for each in found["SDF_PATH"].split(os.pathsep))
