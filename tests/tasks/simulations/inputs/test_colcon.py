"""Bundles of colcon: unpacked to overlays that programs are started in, or refused by that name."""

import subprocess
from pathlib import Path

import pytest
from helpers.colcon_bundles import bundle_v1, bundle_v2

from prefect_robomaker.schemas.wire.errors import BundleError, LaunchError
from prefect_robomaker.tasks.bundles.colcon import overlays, package_folders
from prefect_robomaker.tasks.service.service import Service
from prefect_robomaker.tasks.simulations.inputs.bundles import application_bundle, unpack_colcon_bundle
from prefect_robomaker.tasks.simulations.planning.launch_configurations import Code, Program, resolve_launch
from prefect_robomaker.tasks.storage import unpack

SETUP = 'export SOURCED="$SOURCED:$BUNDLE_CURRENT_PREFIX" PATH="$BUNDLE_CURRENT_PREFIX/usr/bin:$PATH"\n'
ROSLAUNCH = "#!/bin/bash\necho launched $SOURCED with $*; system-tool\n"
DEPENDENCIES = {
    "setup.sh": SETUP,
    "opt/ros/melodic/bin/roslaunch": ROSLAUNCH,
    "usr/bin/system-tool": "-> ../lib/tool-1",
    "usr/lib/tool-1": "#!/bin/bash\necho the bundle has its tool\n",
    "usr/lib/xt_MARK.h": "upper", "usr/lib/xt_mark.h": "lower",
}  # fmt: skip
WORKSPACE = {"setup.sh": SETUP, "opt/built_workspace/my_robot/share/my_robot/launch/drive.launch": "<launch/>"}


def unpacked(archive: Path, folder: Path) -> Path:
    unpack(archive, folder)
    unpack_colcon_bundle(folder)
    return folder


def launched(folder: Path) -> str:
    launch = {"packageName": "my_robot", "launchFile": "drive.launch"}
    program = resolve_launch(Code("robot", "mine", folder=folder), launch, lambda _: None, "/python")
    assert isinstance(program, Program)
    assert program.ros == 1
    return subprocess.run(program.argv, capture_output=True, text=True, check=True).stdout


@pytest.fixture
def bundles(tmp_path: Path) -> dict[str, Path]:
    paths = {"1": tmp_path / "output.tar.gz", "2": tmp_path / "output.tar"}
    bundle_v1(paths["1"], {**DEPENDENCIES, **WORKSPACE, "opt/install/share/x": ""})
    bundle_v2(paths["2"], DEPENDENCIES, WORKSPACE)
    return paths


def test_version_1_is_launched_by_its_own_ros(bundles: dict[str, Path], tmp_path: Path) -> None:
    folder = unpacked(bundles["1"], tmp_path / "app")

    assert launched(folder).splitlines() == [
        f"launched :{folder}/bundle with my_robot drive.launch", "the bundle has its tool",
    ]  # fmt: skip
    assert [path.name for path in overlays(folder)] == ["bundle"]
    assert package_folders(folder)[0] == folder / "bundle/opt/built_workspace"


def test_version_2_is_launched_in_both_overlays_in_their_order(bundles: dict[str, Path], tmp_path: Path) -> None:
    folder = unpacked(bundles["2"], tmp_path / "app")

    assert launched(folder).splitlines() == [
        f"launched :{folder}/dependencies:{folder}/workspace with my_robot drive.launch", "the bundle has its tool",
    ]  # fmt: skip
    assert sorted(path.name for path in folder.iterdir()) == [".colcon-overlays", "dependencies", "workspace"]
    assert (folder / "dependencies/usr/lib/xt_MARK.h").read_text() == "upper"


def test_commands_run_in_the_overlays_too(bundles: dict[str, Path], tmp_path: Path) -> None:
    folder = unpacked(bundles["2"], tmp_path / "app")
    program = resolve_launch(
        Code("robot", "mine", folder=folder), {"command": ["usr/lib/tool-1"]}, lambda _: None, "/python"
    )
    assert isinstance(program, Program)
    assert subprocess.run(program.argv, capture_output=True, text=True).stdout == "the bundle has its tool\n"
    assert str(folder / "workspace/setup.sh") in program.argv


def test_a_ros_whose_interpreter_is_missing_is_refused_by_name(tmp_path: Path) -> None:
    tree = {**DEPENDENCIES, **WORKSPACE, "opt/ros/melodic/bin/roslaunch": "#!/usr/bin/env python2.7\n"}
    bundle_v1(tmp_path / "output.tar.gz", tree)
    with pytest.raises(LaunchError, match=r"colcon bundle's roslaunch of ROS melodic needs python2\.7, .*ros:melodic"):
        launched(unpacked(tmp_path / "output.tar.gz", tmp_path / "app"))


@pytest.mark.parametrize(
    ("tree", "version", "message"),
    [
        ({"setup.sh": ""}, "3", "a colcon bundle of version '3'; versions 1 and 2 can be launched"),
        ({"other": ""}, "1", "bundle.tar has no setup.sh"),
        ({"setup.sh": "", "../evil": ""}, "1", r"bundle.tar of the colcon bundle: member '../evil'"),
        ({"setup.sh": "", "a": "-> /etc", "a/b": ""}, "1", "both a file and a folder"),
    ],
)
def test_what_cannot_be_launched_is_refused_by_that_name(
    tree: dict[str, str], version: str, message: str, tmp_path: Path
) -> None:
    bundle_v1(tmp_path / "output.tar.gz", tree, version)
    with pytest.raises(BundleError, match=message):
        unpacked(tmp_path / "output.tar.gz", tmp_path / "app")


def test_a_damaged_overlay_is_refused(tmp_path: Path) -> None:
    bundle_v2(tmp_path / "output.tar", DEPENDENCIES, WORKSPACE, sha256="0" * 64)
    with pytest.raises(BundleError, match=r"workspace\.tar\.gz is not what overlays\.json says"):
        unpacked(tmp_path / "output.tar", tmp_path / "app")


def test_links_that_lead_out_of_an_overlay_are_left_out(tmp_path: Path) -> None:
    links = {
        "absolute": "-> /etc/passwd", "up": "-> ../../../x", "deep/er/top": "-> ../..", "loop": "-> loop",
        "by-another": "-> deep/er/top/..", "inside": "-> setup.sh",
    }  # fmt: skip
    bundle_v1(tmp_path / "output.tar.gz", {"setup.sh": "", **links})

    overlay = unpacked(tmp_path / "output.tar.gz", tmp_path / "app") / "bundle"

    assert sorted(path.name for path in overlay.rglob("*") if path.is_symlink()) == ["inside", "loop", "top"]


def test_an_application_of_a_colcon_bundle_is_cached_with_its_overlays(
    bundles: dict[str, Path], service: Service
) -> None:
    service.store.ensure_bucket("applications")
    etag = service.store.put_file("applications", "output.tar", bundles["2"]).etag
    source = {"s3Bucket": "applications", "s3Key": "output.tar", "etag": etag}

    folder = application_bundle(source, "Robot", service, is_pinned=False)

    assert [path.name for path in overlays(folder)] == ["dependencies", "workspace"]
