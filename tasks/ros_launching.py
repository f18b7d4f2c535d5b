"""Launch files of ROS: which ROS one is for, and what its nodes find around them.

`roslaunch` reads those of ROS 1, `ros2 launch` those of ROS 2. Their XML differs, their names often do not.
"""

import os
import re
import socket
from collections.abc import Mapping
from pathlib import Path
from typing import Literal

Ros = Literal[1, 2]

MASTER_VARIABLE, HOST_VARIABLE = "ROS_MASTER_URI", "ROS_HOSTNAME"
_XML = (".launch", ".launch.xml")
_ONLY_ROS_2 = (".launch.py", ".launch.yaml", ".launch.yml")
_COMMENT = re.compile(r"<!--.*?-->", re.DOTALL)
_OF_ROS_1 = re.compile(r"<node\b[^>]*\stype\s*=|\$\((?:find|arg|optenv|anon)\s|<(?:rosparam|machine|test)\b")
_OF_ROS_2 = re.compile(
    r"<node\b[^>]*\sexec\s*=|\$\((?:find-pkg-share|find-pkg-prefix|var|exec-in-pkg)\s|<(?:let|executable|node_container)\b"
)
_DESCRIBES_A_LAUNCH = re.compile(r"^def generate_launch_description\b", re.MULTILINE)


def is_launch_file(file: str, path: Path | None) -> bool:
    """Whether ROS launches a file, by its name, or by what a Python file defines.

    Args:
      file: its name.
      path: where it is; `None`: not in a bundle.
    """
    if file.endswith(_XML + _ONLY_ROS_2):
        return True
    if path is None or not file.endswith(".py"):
        return False
    return _DESCRIBES_A_LAUNCH.search(path.read_text(errors="replace")) is not None


def readers_of(file: str, path: Path | None) -> tuple[Ros, ...]:
    """The kinds of ROS that may read a launch file, the likelier one first.

    Args:
      file: its name.
      path: where it is; `None`: not in a bundle, so that only the name says something.
    """
    if not file.endswith(_XML):
        return (2,)
    if path is not None:
        text = _COMMENT.sub("", path.read_text(errors="replace"))
        of_1, of_2 = _OF_ROS_1.search(text) is not None, _OF_ROS_2.search(text) is not None
        if of_1 != of_2:
            return (1,) if of_1 else (2,)
    return (2, 1) if file.endswith(".launch.xml") else (1, 2)


def node_variables(
    bundle: Path | None, launcher: Path, python: str, variables: Mapping[str, str], environ: Mapping[str, str]
) -> dict[str, str]:
    """What nodes find besides what every program of the job does.

    Args:
      bundle: the application's unpacked bundle, whose packages are found by name.
      launcher: `roslaunch` or `ros2`.
      python: the interpreter that runs jobs.
      variables: the launch configuration's own.
      environ: variables of this process.
    """
    # Nodes begin with `#!/usr/bin/env python3` and mean ROS's Python, not the one that jobs are performed with.
    own = str(Path(python).parent)
    searched = (variables.get("PATH") or environ.get("PATH") or os.defpath).split(os.pathsep)
    path = [str(launcher.parent), *(each for each in searched if each != own), own]
    found = {"PATH": os.pathsep.join(dict.fromkeys(path))}
    if bundle is not None:
        packages = variables.get("ROS_PACKAGE_PATH") or environ.get("ROS_PACKAGE_PATH")
        found["ROS_PACKAGE_PATH"] = os.pathsep.join([str(bundle), *([packages] if packages else [])])
    return found


def own_master() -> dict[str, str]:
    """What lets the programs of one job, and of no other, find each other: a ROS master at a port of its own.

    It listens on this machine only, like nodes in Python; those in C++ take their data from anywhere.
    """
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    return {MASTER_VARIABLE: f"http://localhost:{port}", HOST_VARIABLE: "localhost"}
