"""Archives of `colcon bundle`: unpacking their overlays, and the environment in which their programs run."""

from __future__ import annotations

import hashlib
import json
import re
import shutil
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from .archive_members import ArchiveError

OVERLAYS_FILE = ".colcon-overlays"
"""Name of the file in an unpacked bundle with the names of its overlays, one a line, in the order of sourcing."""

_NAME = re.compile(r"^[A-Za-z0-9_-]+$")
_MOST_BYTES = 4096
_PACKAGES = ("opt/built_workspace", "opt/install", "opt/ros/*/share")


def overlays(bundle: Path | None) -> list[Path]:
    """Returns the overlays of a colcon bundle in the order of sourcing; empty for other bundles."""
    file = bundle / OVERLAYS_FILE if bundle is not None else None
    if bundle is None or file is None or not file.is_file():
        return []
    with file.open("rb") as content:
        names = content.read(_MOST_BYTES).decode(errors="replace").split("\n")
    return [bundle / name for name in names if _NAME.match(name) and (bundle / name).is_dir()]


def setups_of(bundle: Path | None) -> list[Path]:
    """Returns the setup scripts that bash must source before a program of a colcon bundle, in order."""
    scripts = [(overlay / "setup.bash", overlay / "setup.sh") for overlay in overlays(bundle)]
    return [bash if bash.is_file() else plain for bash, plain in scripts]


def package_folders(bundle: Path) -> list[Path]:
    """Returns the folders of a bundle's ROS packages; of a colcon bundle, its workspace first, not the whole system.

    Links that lead out of the bundle are left out: in files copied out of an image, they lead to files of this machine.
    """
    top = bundle.resolve()
    found = [path for overlay in reversed(overlays(bundle)) for each in _PACKAGES for path in overlay.glob(each)]
    return [path for path in found if path.resolve().is_relative_to(top)] or [bundle]


def own_program(bundle: Path | None, name: str) -> Path | None:
    """Returns a program (such as `ros2`) of the ROS installation inside a colcon bundle; `None` if it has none."""
    places = [overlay.glob(f"opt/ros/*/bin/{name}") for overlay in overlays(bundle)]
    return next((path for place in places for path in place if path.is_file()), None)


def missing_interpreter(bundle: Path | None, program: Path, which: Callable[[str], str | None]) -> str | None:
    """Returns the interpreter that a script of a bundle names and that is missing in bundle and machine.

    Returns `None` for all others.
    """
    with program.open("rb") as file:
        first = file.readline(_MOST_BYTES).decode(errors="replace")
    words = first.removeprefix("#!").split() if first.startswith("#!") else []
    if not words:
        return None
    name = words[1] if len(words) > 1 and Path(words[0]).name == "env" else words[0]
    inside = [overlay / place / Path(name).name for overlay in overlays(bundle) for place in ("usr/bin", "bin")]
    there = Path(name).is_file() if name.startswith("/") else which(name) or any(path.is_file() for path in inside)
    return None if there else name


# Setups of colcon bundles find their folder by the variable.
_SOURCE_AND_RUN = (
    'n=$1; shift; while [ "$n" -gt 0 ]; do BUNDLE_CURRENT_PREFIX=${1%/*} source "$1"; shift; n=$((n - 1)); done; '
    'exec "$@"'
)


def sourced(setups: Sequence[Path], argv: Sequence[str]) -> tuple[str, ...]:
    """Returns a command that sources setup scripts in bash and then runs a program; missing scripts are left out.

    Args:
        setups: The scripts, in the order of sourcing.
        argv: The program and its arguments.
    """
    there = [str(setup) for setup in setups if setup.is_file()]
    if not there:
        return tuple(argv)
    return ("/bin/bash", "-c", _SOURCE_AND_RUN, "launch", str(len(there)), *there, *argv)


_OVERLAY = re.compile(r"([A-Za-z0-9_-]+)\.tar(\.gz)?")
_SHA256 = re.compile(r"[0-9a-fA-F]{64}")
_MAX_OVERLAYS = 16
_ADVICE = "bundle the workspace again with colcon bundle, or put it into a container image"
_CHUNK_BYTES = 1 << 20

Unpack = Callable[[Path, Path], None]
"""Function that unpacks an archive of a system's files into a new folder; raises `ArchiveError`."""


def unpack_overlays(folder: Path, unpack: Unpack) -> None:
    """Replaces the archives in an unpacked colcon bundle by their content; does nothing to other bundles.

    Args:
        folder: The unpacked outer archive.
        unpack: Unpacks an archive.

    Raises:
        ArchiveError: The colcon bundle is of another version, damaged or incomplete.
        OSError: The disk is full, or the folder cannot be written.
    """
    if not (folder / "version").is_file() or not any(map(Path.is_file, folder.glob("metadata.tar*"))):
        return
    with (folder / "version").open("rb") as file:
        version = file.read(32).decode(errors="replace").strip()
    if version.partition(".")[0] == "1":
        archives = ["bundle.tar"]
    elif version.partition(".")[0] == "2":
        archives = _listed(folder, unpack)
    else:
        raise ArchiveError(f"a colcon bundle of version {version!r}; versions 1 and 2 can be launched: {_ADVICE}")
    names = [_unpack_overlay(folder, archive, unpack) for archive in archives]
    for other in folder.iterdir():
        if other.is_file():
            other.unlink()
    (folder / OVERLAYS_FILE).write_text("".join(f"{name}\n" for name in names))


def _listed(folder: Path, unpack: Unpack) -> list[str]:
    """Returns the names of the overlays that a colcon bundle of version 2 lists, after checking each archive's SHA-256.

    Raises ArchiveError if the list is missing or wrong, or an archive is damaged. A listed archive that is not there
    is not checked.
    """
    metadata = folder / ".metadata"
    _unpack_part(folder, "metadata.tar.gz", metadata, unpack)
    try:
        listed = _overlays_in((metadata / "overlays.json").read_bytes())
    except FileNotFoundError:
        raise ArchiveError(f"a colcon bundle whose metadata.tar.gz has no overlays.json: {_ADVICE}") from None
    except (ValueError, RecursionError) as error:
        raise ArchiveError(f"a colcon bundle whose overlays.json is wrong: {error}") from error
    shutil.rmtree(metadata)
    for name, sha256 in listed.items():
        path = folder / name
        if path.is_file() and _digest(path) != sha256.lower():
            raise ArchiveError(f"a colcon bundle that is damaged: {name} is not what overlays.json says: {_ADVICE}")
    return list(listed)


def _overlays_in(text: bytes) -> dict[str, str]:
    """Parses a bundle's list of overlays: SHA-256 by name, in the order of sourcing.

    Offsets and sizes in it are for readers that download parts of a bundle, and are ignored.

    Raises:
        ValueError: The text is not a valid list of overlays.
    """
    content: Any = json.loads(text.decode())
    entries = content.get("overlays") if isinstance(content, dict) else None
    if not isinstance(entries, list) or not 1 <= len(entries) <= _MAX_OVERLAYS:
        raise ValueError(f"overlays: 1 to {_MAX_OVERLAYS} of them have to be listed")
    found: dict[str, str] = {}
    for index, entry in enumerate(entries):
        name, sha256 = (entry.get(key) if isinstance(entry, dict) else None for key in ("name", "sha256"))
        if not isinstance(name, str) or not _OVERLAY.fullmatch(name) or name in found:
            raise ValueError(f"overlays.{index}.name: it has to be that of an archive, each its own")
        if not isinstance(sha256, str) or not _SHA256.fullmatch(sha256):
            raise ValueError(f"overlays.{index}.sha256: it has to have 64 hexadecimal digits")
        found[name] = sha256
    return found


def _unpack_overlay(folder: Path, archive: str, unpack: Unpack) -> str:
    """Unpacks one overlay of a colcon bundle beside its archive, deletes the archive, and returns the folder's name.

    Raises ArchiveError if the overlay has no setup script.
    """
    name = archive.partition(".")[0]
    _unpack_part(folder, archive, folder / name, unpack)
    (folder / archive).unlink()
    if not any((folder / name / setup).is_file() for setup in ("setup.sh", "setup.bash")):
        raise ArchiveError(f"a colcon bundle whose {archive} has no setup.sh: {_ADVICE}")
    return name


def _unpack_part(folder: Path, archive: str, target: Path, unpack: Unpack) -> None:
    if not (folder / archive).is_file():
        raise ArchiveError(f"a colcon bundle without {archive}: {_ADVICE}")
    if target.exists():
        raise ArchiveError(f"a colcon bundle that has both {archive} and {target.name}: {_ADVICE}")
    try:
        unpack(folder / archive, target)
    except ArchiveError as error:
        raise ArchiveError(f"{archive} of the colcon bundle: {error}") from error


def _digest(path: Path) -> str:
    digest = hashlib.sha256()
    with path.open("rb") as file:
        while chunk := file.read(_CHUNK_BYTES):
            digest.update(chunk)
    return digest.hexdigest()
