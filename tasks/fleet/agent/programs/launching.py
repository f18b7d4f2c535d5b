"""Start command of an application's launch configuration, and the environment variables of its programs."""

from __future__ import annotations

import os
import shlex
import shutil
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Callable

from ..deployment import Launch, Version
from ..errors import StepFailed
from ..settings import Home
from .leftovers import HOME_VARIABLE, VERSION_VARIABLE

TAG_PREFIX = "AWS_ROBOMAKER_ROBOT_TAG_KEY_"

_NOT_PASSED_ON = ("NOTIFY_SOCKET", "WATCHDOG_USEC", "WATCHDOG_PID", "CREDENTIALS_DIRECTORY", "INVOCATION_ID")
_ROS_FILES = (".launch", ".launch.py", ".launch.xml", ".launch.yaml")

Which = Callable[[str], "str | None"]


def launch_command(folder: Path, launch: Launch, which: Which = shutil.which) -> list[str]:
    """The command that starts an application.

    The launch file is looked for in the bundle (in the package's folder, in its `launch`, at the top); `ros2 launch` or
    `roslaunch` start files of ROS; what is not in the bundle may be an installed program. Words behind the file are its
    arguments.

    Args:
        folder: of the version.
        launch: package and file.
        which: finds installed programs.

    Raises:
        StepFailed: there is nothing of that name.
    """
    try:
        file, *arguments = shlex.split(launch.file)
    except ValueError as error:
        raise StepFailed("EnvironmentSetupError", f"launchFile: {launch.file!r} is not right: {error}") from None
    places = [f"{launch.package}/{file}", f"{launch.package}/launch/{file}", file, f"launch/{file}"]
    path = next((found for found in (_inside(folder, place) for place in places) if found is not None), None)
    ros = which("ros2") or which("roslaunch")
    if file.endswith(_ROS_FILES) and ros is not None:
        what = [str(path)] if path is not None else [launch.package, file]
        return [ros, *(["launch"] if ros.endswith("ros2") else []), *what, *arguments]
    if path is not None:
        return [*interpreted(path), *arguments]
    installed = which(file) if "/" not in file else None
    if installed is None:
        raise StepFailed(
            "EnvironmentSetupError",
            f"launchFile: the bundle has none of {', '.join(places)}, and no program has the name",
        )
    return [installed, *arguments]


def script_command(folder: Path, file: str, code: str) -> list[str]:
    """The command of a preLaunchFile or postLaunchFile.

    Args:
        folder: of the version.
        file: its path in the bundle.
        code: failure code of its absence.

    Raises:
        StepFailed: the bundle has no such file.
    """
    path = _inside(folder, file)
    if path is None:
        raise StepFailed(code, f"the bundle has no file {file}")
    return interpreted(path)


def environment(home: Home, version: Version, data: Path, base: Mapping[str, str] = os.environ) -> dict[str, str]:
    """The variables of an application and its scripts.

    Args:
        home: the agent's.
        version: whose launch configuration and tags are exported.
        data: where the application keeps what outlives its versions; programs take it for their home.
        base: the agent's own.
    """
    passed = {name: value for name, value in base.items() if name not in _NOT_PASSED_ON}
    tags = {f"{TAG_PREFIX}{name}": value for name, value in version.tags.items() if _is_variable(name, value)}
    marks = {HOME_VARIABLE: str(home.folder), VERSION_VARIABLE: version.folder}
    return {**passed, "HOME": str(data), **version.launch.environment, **tags, **marks}


def _is_variable(name: str, value: str) -> bool:
    return "=" not in name and "\0" not in name + value


def _inside(folder: Path, name: str) -> Path | None:
    """A file in a folder; names that would lead out of it name nothing."""
    path = folder / name.lstrip("/")
    is_there = path.is_file() and folder.resolve() in path.resolve().parents
    return path if is_there else None


def interpreted(path: Path) -> list[str]:
    """The command for a file: a program as it is, also a script that does not say what it is written for."""
    with path.open("rb") as file:
        beginning = file.read(4)
    if (beginning == b"\x7fELF" or beginning.startswith(b"#!")) and os.access(path, os.X_OK):
        return [str(path)]
    if path.suffix == ".py":
        return [shutil.which("python3") or sys.executable, str(path)]
    return ["/bin/sh", str(path)]
