"""Bundles of `colcon bundle`, which RoboMaker's ROS applications came in: recognised, and unpacked to their overlays.

Version 1 is `output.tar.gz` with `version`, `metadata.tar` and `bundle.tar`; version 2 is `output.tar` with `version`,
`metadata.tar.gz`, whose `overlays.json` names the overlays in the order in which they are sourced, and the overlays,
usually `dependencies.tar.gz` and `workspace.tar.gz`. An overlay is a part of an Ubuntu system with a `setup.sh`.
"""

import hashlib
import re
import shutil
from pathlib import Path

from pydantic import Field, ValidationError

from ....schemas.wire.base import Model
from ....schemas.wire.errors import BundleError
from ...storage import ArchiveLimits, unpack
from ..environment.overlays import OVERLAYS_FILE

_SYSTEM = ArchiveLimits(entries=1_000_000, depth=64, is_system_tree=True)
_OVERLAY = re.compile(r"^([A-Za-z0-9_-]+)\.tar(\.gz)?$")
_ADVICE = "bundle the workspace again with colcon bundle, or put it into a container image"


class _Overlay(Model, extra="ignore"):
    name: str = Field(pattern=_OVERLAY.pattern, description="Its archive in the bundle.")
    sha256: str = Field(pattern=r"^[0-9a-fA-F]{64}$", description="SHA-256 of that archive, in hexadecimal.")


class _Overlays(Model, extra="ignore"):
    """`overlays.json`, as far as it is read: offsets and sizes are for readers that fetch parts of a bundle."""

    overlays: list[_Overlay] = Field(min_length=1, max_length=16, description="Overlays in the order of sourcing.")


def unpack_colcon_bundle(folder: Path) -> None:
    """Replaces the archives in an unpacked colcon bundle by what is in them; does nothing to other bundles.

    Args:
        folder: the unpacked outer archive.

    Raises:
        BundleError: it is a colcon bundle, but of another version, damaged or incomplete.
        StorageError: the disk is full, or the folder cannot be written.
    """
    if not (folder / "version").is_file() or not any(map(Path.is_file, folder.glob("metadata.tar*"))):
        return
    with (folder / "version").open("rb") as file:
        version = file.read(32).decode(errors="replace").strip()
    archives = {"1": lambda: ["bundle.tar"], "2": lambda: _listed(folder)}.get(version.partition(".")[0])
    if archives is None:
        raise BundleError(f"a colcon bundle of version {version!r}; versions 1 and 2 can be launched: {_ADVICE}")
    names = [_unpack_overlay(folder, archive) for archive in archives()]
    for other in folder.iterdir():
        if other.is_file():
            other.unlink()
    (folder / OVERLAYS_FILE).write_text("".join(f"{name}\n" for name in names))


def _listed(folder: Path) -> list[str]:
    """The overlays that a bundle of version 2 lists, each with the content that it lists."""
    metadata = folder / ".metadata"
    _unpack(folder, "metadata.tar.gz", metadata)
    try:
        listed = _Overlays.model_validate_json((metadata / "overlays.json").read_bytes()).overlays
    except FileNotFoundError:
        raise BundleError(f"a colcon bundle whose metadata.tar.gz has no overlays.json: {_ADVICE}") from None
    except ValidationError as error:
        problem = error.errors()[0]
        where = ".".join(map(str, problem["loc"]))
        raise BundleError(f"a colcon bundle whose overlays.json is wrong: {where}: {problem['msg']}") from error
    shutil.rmtree(metadata)
    for overlay in listed:
        path = folder / overlay.name
        if path.is_file() and _sha256(path) != overlay.sha256.lower():
            raise BundleError(
                f"a colcon bundle that is damaged: {overlay.name} is not what overlays.json says: {_ADVICE}"
            )
    return [overlay.name for overlay in listed]


def _unpack_overlay(folder: Path, archive: str) -> str:
    """Unpacks one overlay beside its archive, which is removed; returns the folder's name."""
    name = archive.partition(".")[0]
    _unpack(folder, archive, folder / name)
    (folder / archive).unlink()
    if not any((folder / name / setup).is_file() for setup in ("setup.sh", "setup.bash")):
        raise BundleError(f"a colcon bundle whose {archive} has no setup.sh: {_ADVICE}")
    return name


def _unpack(folder: Path, archive: str, target: Path) -> None:
    if not (folder / archive).is_file():
        raise BundleError(f"a colcon bundle without {archive}: {_ADVICE}")
    if target.exists():
        raise BundleError(f"a colcon bundle that has both {archive} and {target.name}: {_ADVICE}")
    try:
        unpack(folder / archive, target, limits=_SYSTEM)
    except BundleError as error:
        raise BundleError(f"{archive} of the colcon bundle: {error}") from error


def _sha256(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
