"""The world that a job names, where the packages of ROS look for it: real roslaunch, and a bundle with another world.

Debian has the programs as python3-roslaunch, python3-rosmaster and rosout; where they are missing, these tests say so.
"""

import hashlib
import shutil
import zipfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import pytest
from helpers.colcon_bundles import bundle_v1
from helpers.required_programs import needs
from helpers.small_flat import ROLE

from prefect_robomaker.tasks.jobs import job_runs
from prefect_robomaker.tasks.jobs.job_runs import perform_job
from prefect_robomaker.tasks.operations.registry import call
from prefect_robomaker.tasks.runtime.supervision.launcher import Launcher
from prefect_robomaker.tasks.service.service import Service
from prefect_robomaker.tasks.simulations.inputs.bundles import world_bundle
from prefect_robomaker.tasks.storage import pack_tar_gz
from prefect_robomaker.tasks.worldforge.exports.export import archive_name, write_export_zip

pytestmark = [
    pytest.mark.deep,
    needs(
        "ros",
        shutil.which("roslaunch") and shutil.which("rosmaster") and Path("/usr/lib/rosout/rosout").exists(),
        "roslaunch, rosmaster or rosout is not installed (Debian's python3-roslaunch)",
    ),
]

WORLDS = "aws_robomaker_worldforge_worlds"
MANIFEST = """<package format="2"><name>my_robot</name><version>0.1.0</version><description>.</description>
<maintainer email="a@example.com">a</maintainer><license>MIT</license></package>"""
NODE = """#!/usr/bin/env python3
import hashlib, os, sys
from pathlib import Path
found = Path(sys.argv[1], "worlds")
print("WORLDS", *sorted(path.name for path in found.iterdir()))
[world] = found.glob("*/*.world")
print("READ", hashlib.sha256(world.read_bytes()).hexdigest())
map_file = Path(os.environ.get("ROBOMAKER_MAP_YAML", "/none"))
print("MAP", map_file.is_relative_to(found) and "image: map.pgm" in map_file.read_text())
setup = Path(os.environ.get("AWS_ROBOMAKER_WORLDFORGE_SETUP_OVERRIDE", "/none"), "setup.sh")
usual = Path(os.environ["ROBOMAKER_JOB_ROOT"], "opt/robomaker/worldforge/melodic/setup.sh")
told_so = "AWS_ROBOMAKER_WORLDFORGE_WORLD_PACKAGE_OVERRIDE" in os.environ
print("SETUP", told_so and setup.samefile(usual), flush=True)
"""
LAUNCH = f"""<launch><node pkg="my_robot" type="node.py" name="node" output="screen" required="true"
  args="$(find {WORLDS})"/></launch>"""
OWN_FIRST = 'export ROS_PACKAGE_PATH="{place}:$ROS_PACKAGE_PATH"\n'
"""The setup of a workspace: its own packages come before what is there already."""

Bundle = Callable[[Path, Path], None]


def as_it_is(bundle: Path, archive: Path) -> None:
    pack_tar_gz(bundle, archive)


def built(bundle: Path, archive: Path, setup: str = OWN_FIRST) -> None:
    """A workspace with a setup that puts its own packages first."""
    place = '$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)/src'
    (bundle / "install").mkdir()
    (bundle / "install" / "setup.bash").write_text(setup.format(place=place))
    pack_tar_gz(bundle, archive)


def built_alone(bundle: Path, archive: Path) -> None:
    """A workspace whose setup knows no packages besides its own."""
    built(bundle, archive, 'export ROS_PACKAGE_PATH="{place}"\n')


def of_colcon(bundle: Path, archive: Path) -> None:
    """A bundle of `colcon bundle`, whose packages are installed."""
    tree = {"setup.sh": OWN_FIRST.format(place="$BUNDLE_CURRENT_PREFIX/opt/built_workspace/share")}
    for path in bundle.rglob("*"):
        if path.is_file() and path.suffix not in (".png", ".pgm", ".glb"):
            tree[f"opt/built_workspace/share/{path.relative_to(bundle / 'src')}"] = path.read_text()
    bundle_v1(archive, tree)


LAUNCHED = {"packageName": "my_robot", "launchFile": "drive.launch"}
SOURCED = {"command": ["bash", "-c", ". install/setup.bash && roslaunch my_robot drive.launch"]}
"""A program that sources the workspace itself, so that variables come too early."""


@pytest.fixture
def worlds(service: Service, generate: Callable[..., dict[str, Any]], known_worlds: None) -> list[str]:
    """Two worlds: that of the job, and another one."""
    return generate(2)["finishedWorldsSummary"]["succeededWorlds"]


@pytest.fixture
def exported(service: Service, worlds: list[str], tmp_path: Path) -> list[Path]:
    """The unpacked archive of an export job, of each world."""
    folders = []
    for number, arn in enumerate(worlds):
        world = service.catalog.get(arn)
        folder = tmp_path / f"export-{number}"
        folder.mkdir()
        write_export_zip({archive_name(world.id): world_bundle(world, service)}, folder / "export.zip")
        with zipfile.ZipFile(folder / "export.zip") as archive:
            archive.extractall(folder)
        folders.append(folder / "aws_robomaker_worldforge_pkgs")
    return folders


@pytest.fixture
def drive(
    service: Service, worlds: list[str], tmp_path: Path
) -> Callable[[Mapping[str, Any], Path | None, Bundle], dict[str, str]]:
    """Performs a job in the first world; returns what its node printed, by the first word."""

    def run(launch: Mapping[str, Any], carried: Path | None, pack: Bundle) -> dict[str, str]:
        package = tmp_path / "bundle" / "src" / "my_robot"
        for name, text in {"package.xml": MANIFEST, "scripts/node.py": NODE, "launch/drive.launch": LAUNCH}.items():
            (package / name).parent.mkdir(parents=True, exist_ok=True)
            (package / name).write_text(text)
        (package / "scripts" / "node.py").chmod(0o755)
        if carried is not None:
            shutil.copytree(carried, tmp_path / "bundle" / "src", dirs_exist_ok=True)
        pack(tmp_path / "bundle", tmp_path / "bundle.tar")
        for bucket in ("applications", "results"):
            service.store.ensure_bucket(bucket)
        service.store.put_file("applications", "ros.tar.gz", tmp_path / "bundle.tar")
        made = {
            "name": "simulation",
            "sources": [{"s3Bucket": "applications", "s3Key": "ros.tar.gz"}],
            "robotSoftwareSuite": {"name": "ROS", "version": "Melodic"},
            "simulationSoftwareSuite": {"name": "Gazebo", "version": "9"},
        }
        call("CreateSimulationApplication", made, service)
        config = {"application": "simulation", "launchConfig": launch, "worldConfigs": [{"world": worlds[0]}]}
        request = {"maxJobDurationInSeconds": 120, "iamRole": ROLE, "outputLocation": {"s3Bucket": "results"}}
        arn = call("CreateSimulationJob", {**request, "simulationApplications": [config]}, service)["arn"]
        perform_job(arn, service)
        job = call("DescribeSimulationJob", {"job": arn}, service)
        assert job["status"] == "Completed", job
        place = service.catalog.get(arn).document["outputs"]
        log = service.store.get_bytes(place["bucket"], f"{place['prefix']}/logs/simulation.stdout.log").decode()
        return dict(line.split(" ", 1) for line in log.splitlines() if line.split(" ")[0].isupper() and " " in line)

    return run


def digest(package: Path) -> str:
    [world] = package.glob(f"{WORLDS}/worlds/*/*.world")
    return hashlib.sha256(world.read_bytes()).hexdigest()


@pytest.mark.parametrize(
    ("sandbox", "pack"),
    [("require", as_it_is), pytest.param("off", as_it_is, marks=pytest.mark.endurance), ("off", built_alone)],
)
def test_a_launch_file_finds_the_world_of_its_job(
    sandbox: str,
    pack: Bundle,
    service: Service,
    drive: Callable[..., dict[str, str]],
    worlds: list[str],
    exported: list[Path],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("ROBOMAKER_SANDBOX", sandbox)
    # One of this test's own: that of the process has the confinement with which an earlier test has started it.
    own = Launcher()
    monkeypatch.setattr(job_runs, "launcher", lambda: own)

    with own:
        told = drive(LAUNCHED, None, pack)

    assert told["WORLDS"] == archive_name(service.catalog.get(worlds[0]).id)
    assert told["READ"] == digest(exported[0]), "it is not what CreateWorldExportJob exports of this world"
    assert (told["MAP"], told["SETUP"]) == ("True", "True")


@pytest.mark.parametrize(
    ("launch", "pack"),
    [
        pytest.param(LAUNCHED, as_it_is, marks=pytest.mark.endurance),
        (LAUNCHED, built),
        (SOURCED, built),
        (LAUNCHED, of_colcon),
    ],
    ids=["packages", "workspace", "sourced by the command", "colcon bundle"],
)
def test_the_world_of_the_job_wins_over_one_that_the_bundle_carries(
    launch: Mapping[str, Any], pack: Bundle, drive: Callable[..., dict[str, str]], exported: list[Path]
) -> None:
    mine, other = map(digest, exported)
    assert mine != other

    told = drive(launch, exported[1], pack)

    assert told["READ"] == mine, "it drives in the world that the bundle carries"
