"""ROS packages generated from a job's world, which launch files and nodes find before other packages of these names."""

import hashlib
import os
import shutil
from collections.abc import Mapping
from functools import cache
from importlib import metadata
from pathlib import Path

from ....schemas.wire.errors import LaunchError
from ...bundles.colcon import package_folders
from ...bundles.launch_files import MANIFEST, name_in
from ...catalog import Resource
from ...service.service import Service
from ...service.store_retries import stopped_of
from ...worldforge.exports import ros_prefix
from ...worldforge.exports.ros_prefix import CONTENTS, SETUP_VARIABLE, first_on_paths, world_map, write_ros_prefix
from ..environment.folders import WORLD_PACKAGES, Sandbox, WorldPackages, remove
from .bundles import fill_once, world_bundle

WORLD_VARIABLE = "AWS_ROBOMAKER_WORLDFORGE_WORLD_PACKAGE_OVERRIDE"
"""Name of the variable with the folder of the packages; RoboMaker's launch files only check whether it is set."""
MAP_VARIABLE = "ROBOMAKER_MAP_YAML"
"""Name of the variable with the path of the world's map, for Nav2."""

_PREFIX = "packages"
_DISTRIBUTIONS = (
    *("kinetic", "melodic", "noetic"),
    *("dashing", "eloquent", "foxy", "galactic", "humble", "iron", "jazzy", "kilted", "lyrical", "rolling"),
)
"""Names of ROS distributions: RoboMaker's hooks look for `$ROS_DISTRO/setup.sh`, and the packages are the same for all.
"""
_DIGITS = 12


def place_world_packages(world: Resource, sandbox: Sandbox, service: Service) -> WorldPackages:
    """Generates ROS packages of a job's world in a run's folders, read-only, and returns their place.

    Args:
        world: The job's world.
        sandbox: Folders of the run.
        service: The service, with its catalog and object store.

    Raises:
        LaunchError: The packages cannot be written.
        StorageError: The world's bundle cannot be fetched.
    """
    from ...worldforge.exports.export import archive_name  # brings MuJoCo

    name = archive_name(world.id)
    bundle = world_bundle(world, service)
    made_by = hashlib.sha256(f"{name}\n{_code()}".encode()).hexdigest()[:_DIGITS]
    cached = service.folder("cache", "world-packages") / f"{bundle.name}-{made_by}"
    folder = sandbox.place(WORLD_PACKAGES)
    try:
        fill_once(cached, lambda part: write_ros_prefix(name, bundle, part), stopped_of(service.store))
        _copy(cached, folder / _PREFIX, writable=False)
        for distribution in _DISTRIBUTIONS:
            (folder / distribution).symlink_to(_PREFIX)
    except (OSError, ValueError) as error:
        raise LaunchError(f"the ROS packages of {world.arn} cannot be made: {error}", "InternalServiceError") from error
    return WorldPackages(folder / _PREFIX, name)


def world_variables(packages: WorldPackages, variables: Mapping[str, str], *, in_container: bool) -> dict[str, str]:
    """Makes the variables with which ROS programs find the packages of the job's world first.

    Args:
        packages: Folder of the packages.
        variables: Other environment variables of the programs.
        in_container: Whether the programs run in a container, where the job's folders are at the root.
    """
    prefix = f"{WORLD_PACKAGES}/{_PREFIX}" if in_container else str(packages.prefix)
    return {
        SETUP_VARIABLE: prefix,
        WORLD_VARIABLE: f"{prefix}/share",
        MAP_VARIABLE: str(world_map(Path(prefix), packages.name)),
        **{name: _joined(places, variables.get(name)) for name, places in first_on_paths(prefix).items()},
    }


def put_world_into_copies(folder: Path, packages: WorldPackages) -> None:
    """Replaces other worlds in a run's copy of a ROS workspace by the job's world.

    A program that sources the setup of its own workspace finds that workspace's packages first, whatever its variables
    were before.

    Args:
        folder: Copy of the workspace that belongs to the run.
        packages: Folder of the packages of the job's world.
    """
    for start in package_folders(folder):
        for parent, _, files in os.walk(start):
            manifest = Path(parent, MANIFEST)
            if MANIFEST not in files or manifest.is_symlink() or (name := name_in(manifest)) not in CONTENTS:
                continue
            for inside in CONTENTS[name]:
                place = manifest.with_name(inside)
                remove(place)
                _copy(packages.prefix / "share" / name / inside, place, writable=True)


def _joined(places: list[str], others: str | None) -> str:
    further = [each for each in (others or "").split(os.pathsep) if each and each not in places]
    return os.pathsep.join([*places, *further])


def _copy(source: Path, target: Path, *, writable: bool) -> None:
    """Copies a folder so that all users can read it, also in containers; its owner can write if `writable`.

    Raises FileExistsError if `target` exists.
    """
    shutil.copytree(source, target)
    for path in [*target.rglob("*"), target]:
        path.chmod((0o755 if path.is_dir() else 0o644) if writable else (0o555 if path.is_dir() else 0o444))


@cache
def _code() -> str:
    """Returns an identifier of the code version that generates the packages, as part of the cache key."""
    modules = sorted(Path(ros_prefix.__file__).parent.glob("*.py"))
    digest = hashlib.sha256(b"".join(module.read_bytes() for module in modules)).hexdigest()
    return f"{metadata.version('prefect-robomaker')} {digest}"
