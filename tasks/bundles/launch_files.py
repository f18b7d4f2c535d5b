"""Launch files of ROS 1 and ROS 2: recognising them, and environment variables of the launched nodes."""

from __future__ import annotations

import os
import re
import socket
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Literal, NamedTuple, NoReturn
from xml.parsers import expat

Ros = Literal[1, 2]
_KINDS: tuple[Ros, ...] = (1, 2)

LAUNCHERS: Mapping[Ros, str] = {1: "roslaunch", 2: "ros2"}
WORKSPACE_SETUPS = ("setup.bash", "install/setup.bash", "local_setup.bash")
"""Setup scripts of a ROS workspace in an application's archive, in the order in which they are tried."""

_XML = (".launch", ".launch.xml")
_ONLY_ROS_2 = (".launch.py", ".launch.yaml", ".launch.yml")


class _Marks(NamedTuple):
    """Features by which launch files of ROS 1 or ROS 2 are recognised."""

    tags: frozenset[str]
    program: str
    """XML attribute of a launch file's node that names the node's program."""
    substitutions: re.Pattern[str]


_MARKS: Mapping[Ros, _Marks] = {
    1: _Marks(frozenset({"rosparam", "machine", "test"}), "type", re.compile(r"\$\((?:find|arg|optenv|anon)\s")),
    2: _Marks(
        frozenset({"let", "executable", "node_container"}),
        "exec",
        re.compile(r"\$\((?:find-pkg-share|find-pkg-prefix|var|exec-in-pkg)\s"),
    ),
}
_DESCRIBES_A_LAUNCH = re.compile(r"^def generate_launch_description\b", re.MULTILINE)
MANIFEST = "package.xml"
"""Name of the file that marks a folder as a ROS package, and names the package."""

_PACKAGE_NAME = re.compile(r"<name>\s*([^<\s]+)\s*</name>")
_MOST_NAMED = 8
_MOST_BYTES = 1 << 20
"""Limit of the bytes read of a launch file; those that people write have a few thousand."""


def is_launch_file(file: str, path: Path | None) -> bool:
    """Whether a file is a ROS launch file, by its name, or by the functions that a Python file defines.

    Args:
        file: Name of the file.
        path: Path of the file; `None`: it is not in a bundle.
    """
    if file.endswith(_XML + _ONLY_ROS_2):
        return True
    if path is None or not file.endswith(".py"):
        return False
    return _DESCRIBES_A_LAUNCH.search(_beginning(path).decode(errors="replace")) is not None


def readers_of(file: str, path: Path | None) -> tuple[Ros, ...]:
    """Returns the ROS generations (ROS 1, ROS 2) that may read a launch file, the likelier one first.

    Args:
        file: Name of the file.
        path: Path of the file; `None`: it is not in a bundle, so that only the name is used.
    """
    if not file.endswith(_XML):
        return (2,)
    if path is not None:
        found = _kinds_in(_beginning(path))
        if len(found) == 1:
            return tuple(found)
    return (2, 1) if file.endswith(".launch.xml") else (1, 2)


def lacks_launch_file(bundle: Path, package: str, file: str) -> str | None:
    """Returns an error text if a ROS package of a bundle lacks a launch file; `None` if not, or without such a package.

    ROS looks for a package's files in all folders of it, and for packages that the bundle does not have elsewhere.

    Args:
        bundle: The unpacked bundle.
        package: The package's name, as its `package.xml` says.
        file: The launch file's name.
    """
    folders = [path.parent for path in bundle.rglob(MANIFEST) if path.is_file() and name_in(path) == package]
    found = {path.name: path for folder in folders for path in sorted(folder.rglob("*"))}
    if not folders or Path(file).name in found:
        return None
    others = sorted(name for name, path in found.items() if path.is_file() and is_launch_file(name, path))
    listed = f"has {', '.join(others[:_MOST_NAMED])}" if others else "has none"
    return f"the bundle's package {package} has no launch file {file}; it {listed}"


def name_in(manifest: Path) -> str | None:
    """Returns the package name in a `package.xml` (REP 127, REP 140); `None` if there is none."""
    name = _PACKAGE_NAME.search(_beginning(manifest).decode(errors="replace"))
    return name[1] if name else None


def _beginning(path: Path) -> bytes:
    with path.open("rb") as file:
        return file.read(_MOST_BYTES)


def _kinds_in(content: bytes) -> set[Ros]:
    """Returns the ROS generations whose elements an XML launch file contains, as far as it can be read.

    A parser is used, as regular expressions for what belongs to a tag take a time that is quadratic in its length, or
    are wrong about `>` in attributes. Entities are not expanded: a file that declares some is read up to there.
    """
    found: set[Ros] = set()
    parser = expat.ParserCreate()

    def start(tag: str, attributes: dict[str, str]) -> None:
        found.update(ros for ros in _KINDS if _is_marked(tag, attributes, _MARKS[ros]))

    def text_between(text: str) -> None:
        found.update(ros for ros in _KINDS if _MARKS[ros].substitutions.search(text))

    def refuse(*_: object) -> NoReturn:
        raise ValueError("entities are declared")

    parser.buffer_text = True
    parser.StartElementHandler, parser.CharacterDataHandler, parser.EntityDeclHandler = start, text_between, refuse
    with suppress(expat.ExpatError, LookupError, ValueError):  # such as an unknown encoding
        parser.Parse(content, False)
    return found


def _is_marked(tag: str, attributes: Mapping[str, str], marks: _Marks) -> bool:
    return (
        tag in marks.tags
        or (tag == "node" and marks.program in attributes)
        or any(marks.substitutions.search(value) for value in attributes.values())
    )


def node_variables(
    packages: Sequence[Path], launcher: Path, python: str, variables: Mapping[str, str], environ: Mapping[str, str]
) -> dict[str, str]:
    """Returns the environment variables of ROS nodes, in addition to those of all programs of the job.

    Args:
        packages: Folders of the application's bundle, whose packages are found by name.
        launcher: `roslaunch` or `ros2`.
        python: The interpreter that runs jobs.
        variables: The launch configuration's own.
        environ: Variables of this process.
    """
    # Nodes begin with `#!/usr/bin/env python3` and mean ROS's Python, not the one that jobs are performed with.
    own = str(Path(python).parent)
    searched = (variables.get("PATH") or environ.get("PATH") or os.defpath).split(os.pathsep)
    path = [str(launcher.parent), *(each for each in searched if each != own), own]
    found = {"PATH": os.pathsep.join(dict.fromkeys(path))}
    if packages:
        others = variables.get("ROS_PACKAGE_PATH") or environ.get("ROS_PACKAGE_PATH")
        found["ROS_PACKAGE_PATH"] = os.pathsep.join([*map(str, packages), *([others] if others else [])])
    return found


def own_master() -> dict[str, str]:
    """Returns variables that give a job a ROS master at a port of its own, which isolates it from other jobs.

    The master listens on this machine only, like nodes in Python; nodes in C++ accept data from anywhere.
    """
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    return {"ROS_MASTER_URI": f"http://localhost:{port}", "ROS_HOSTNAME": "localhost"}
