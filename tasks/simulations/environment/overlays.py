"""Overlays of an unpacked colcon bundle: where its ROS is, what sets it up, where its packages are."""

import re
from collections.abc import Callable
from pathlib import Path

OVERLAYS_FILE = ".colcon-overlays"
"""File in the folder of a bundle: names of its overlays, a line each, in the order of sourcing."""

_NAME = re.compile(r"^[A-Za-z0-9_-]+$")
_MOST_BYTES = 4096
_PACKAGES = ("opt/built_workspace", "opt/install", "opt/ros/*/share")


def overlays(bundle: Path | None) -> list[Path]:
    """The overlays of a bundle in the order of sourcing; none: it is no colcon bundle."""
    file = bundle / OVERLAYS_FILE if bundle is not None else None
    if bundle is None or file is None or not file.is_file():
        return []
    with file.open("rb") as content:
        names = content.read(_MOST_BYTES).decode(errors="replace").split("\n")
    return [bundle / name for name in names if _NAME.match(name) and (bundle / name).is_dir()]


def setups_of(bundle: Path | None) -> list[Path]:
    """The scripts that bash sources before a program of a colcon bundle, in their order."""
    scripts = [(overlay / "setup.bash", overlay / "setup.sh") for overlay in overlays(bundle)]
    return [bash if bash.is_file() else plain for bash, plain in scripts]


def package_folders(bundle: Path) -> list[Path]:
    """Returns the folders of a bundle's packages: of a colcon bundle its workspace first, not the whole system."""
    found = [path for overlay in reversed(overlays(bundle)) for each in _PACKAGES for path in overlay.glob(each)]
    return found or [bundle]


def own_program(bundle: Path | None, name: str) -> Path | None:
    """A program of the ROS that a colcon bundle brings, if it brings one."""
    places = [overlay.glob(f"opt/ros/*/bin/{name}") for overlay in overlays(bundle)]
    return next((path for place in places for path in place if path.is_file()), None)


def missing_interpreter(bundle: Path | None, program: Path, which: Callable[[str], str | None]) -> str | None:
    """The interpreter that a script of a bundle names and that neither it nor this machine has; else `None`."""
    with program.open("rb") as file:
        first = file.readline(_MOST_BYTES).decode(errors="replace")
    words = first.removeprefix("#!").split() if first.startswith("#!") else []
    if not words:
        return None
    name = words[1] if len(words) > 1 and Path(words[0]).name == "env" else words[0]
    inside = [overlay / place / Path(name).name for overlay in overlays(bundle) for place in ("usr/bin", "bin")]
    there = Path(name).is_file() if name.startswith("/") else which(name) or any(path.is_file() for path in inside)
    return None if there else name
