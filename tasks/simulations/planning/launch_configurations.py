"""Launch configurations: determines the factory function or the program that they start.

The order is that of `docs/simulation-jobs.md`: `command`; then `packageName` with `launchFile`, which is a ROS launch
file, a Python script, another executable file, or the dotted path of a factory; then the factory function that every
package has.
"""

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ....schemas.runs.plan import ApplicationRole
from ....schemas.wire.errors import LaunchError
from ...bundles.colcon import missing_interpreter, overlays, own_program, setups_of, sourced
from ...bundles.launch_files import LAUNCHERS, WORKSPACE_SETUPS, Ros, is_launch_file, lacks_launch_file, readers_of
from ..containers.engines import Which

DEFAULT_FACTORIES: Mapping[ApplicationRole, str] = {"robot": "make_agent", "simulation": "make_environment"}
# Where launch files and scripts are in a package, in sources and as ROS installs them.
_INNER_FOLDERS = ("", "launch", "scripts")


@dataclass(frozen=True)
class Code:
    """Code of an application on this machine: its role, and folder or package."""

    role: ApplicationRole
    name: str
    """Name of the application, for messages."""
    folder: Path | None = None
    """Folder of the unpacked archive; `None`: the code is an installed package."""
    module: str | None = None
    """Name of the installed package; `None`: the code is an archive."""
    world_packages: Path | None = None
    """ROS prefix of the packages of the job's world, whose setup is sourced after all others."""

    @property
    def crash_code(self) -> str:
        """Failure code for an application that does not start."""
        return f"{self.role.capitalize()}ApplicationCrash"


@dataclass(frozen=True)
class Factory:
    """An application that is a factory function (dotted path), called in the simulation's process."""

    attribute: str
    """Dotted path of the function: `my_nav.arena.make_environment`."""


@dataclass(frozen=True)
class Program:
    """An application that runs as a separate process."""

    argv: tuple[str, ...]
    launcher: Path | None = None
    """Path of `roslaunch` or `ros2`, if the program is started by it."""
    ros: Ros | None = None
    """Version of the ROS that launches the program; None: no ROS does."""


def resolve_launch(
    code: Code, launch: Mapping[str, Any], which: Which, python: str, *, has_master: bool = False
) -> Factory | Program:
    """Determines what a launch configuration starts: a factory function or a program.

    Args:
        code: Code of the application.
        launch: Launch configuration of the application.
        which: Function that finds programs which are not in the archive.
        python: Python interpreter for scripts.
        has_master: Whether another application of the job provides the ROS 1 master.

    Raises:
        LaunchError: The function or program does not exist, or cannot be started on this machine.
    """
    if command := launch.get("command"):
        return Program(_with_overlays(code, (_find_program(code, command[0], which), *command[1:])))
    package, file = launch.get("packageName"), launch.get("launchFile")
    path = _find_file(code.folder, package or "", file) if file and code.folder is not None else None
    if file and is_launch_file(file, path):
        return _ros_launch(code, package or "", file, path, which, has_master)
    if file and file.endswith(".py"):
        return _script(code, package or "", file, path, python)
    if path is not None:
        return Program((str(_runnable(code, path)),))
    parts = [code.module, package, file or DEFAULT_FACTORIES[code.role]]
    return Factory(".".join(part for part in parts if part))


def check_pair(simulation: tuple[str, Factory | Program] | None, robot: tuple[str, Factory | Program] | None) -> None:
    """Raises an error if the simulation application does not make the environment that the robot needs.

    Args:
        simulation: Name and launch of the simulation application; `None`: the built-in one.
        robot: Name and launch of the robot application; `None`: the built-in one, where an environment is made.

    Raises:
        LaunchError: The simulation application makes no environment for a robot application that needs one.
    """
    if simulation is None or robot is None:
        return
    if isinstance(simulation[1], Program) and isinstance(robot[1], Factory):
        raise LaunchError(
            f"robot application {robot[0]} is the factory {robot[1].attribute}, which steps an environment, but "
            f"simulation application {simulation[0]} is a program and makes none; give the robot application a "
            "launchConfig.command too, or the simulation application a packageName and launchFile such as my_nav and "
            "arena.make_environment"
        )


def _find_program(code: Code, name: str, which: Which) -> str:
    """Returns the path of the program that a command begins with: from the bundle, else from this machine's path.

    Raises `LaunchError` if neither has it, or the bundle's file cannot be executed.
    """
    if code.folder is not None and not name.startswith("/"):
        # As setups would put it on the path: what a later overlay has comes first.
        for overlay in [*reversed(overlays(code.folder)), code.folder]:
            if _is_file_of(code.folder, path := overlay / name):
                return str(_runnable(code, path))
        if "/" not in name and (own := own_program(code.folder, name)) is not None:
            return str(_of_this_machine(code, own, which))
    is_relative = "/" in name and not name.startswith("/")  # to the bundle, not to wherever this process is
    if not is_relative and (found := which(name)) is not None:
        return found
    where = (
        "neither in its bundle nor on the path of this machine" if code.folder else "not on the path of this machine"
    )
    raise LaunchError(
        f"{code.role} application {code.name}: launchConfig.command begins with {name!r}, which is {where}; "
        "give a file of the bundle such as bin/drive, or an installed program",
        code.crash_code,
    )


def _ros_launch(code: Code, package: str, file: str, path: Path | None, which: Which, has_master: bool) -> Program:
    if path is None and code.folder is not None and (lack := lacks_launch_file(code.folder, package, file)):
        raise LaunchError(f"{code.role} application {code.name}: {lack}", code.crash_code)
    readers = readers_of(file, path)
    what = [str(path)] if path else [part for part in (package, file) if part]
    for ros in readers:
        own = own_program(code.folder, LAUNCHERS[ros])
        if program := str(_of_this_machine(code, own, which)) if own else which(LAUNCHERS[ros]):
            options = ["launch"] if ros == 2 else ["--wait"] if has_master else []
            return Program(in_ros(code, Path(program), (program, *options, *what)), Path(program), ros)
    needed = " or ".join("`ros2 launch`" if ros == 2 else "`roslaunch`" for ros in readers)
    raise LaunchError(
        f"{code.role} application {code.name}: {file} is started by {needed}, which this machine does not have; "
        "install ROS here, put the application into a container image, or start it with launchConfig.command"
        + ("; in place of Gazebo, give the built-in indoor-navigation" if code.role == "simulation" else "")
    )


def with_launch_file(argv: Sequence[str], file: Path) -> tuple[str, ...]:
    """Returns a `roslaunch` command line with another launch file added.

    Args:
        argv: Command line, which ends with its launch file.
        file: Launch file to add. It is read first if `roslaunch` allows that: a launch file that is named by its
            package has to come first.
    """
    if Path(argv[-1]).is_absolute():
        return (*argv[:-1], str(file), argv[-1])
    return (*argv, str(file))


def _of_this_machine(code: Code, program: Path, which: Which) -> Path:
    """Returns the path of a program of an application's archive, after checking that this machine has its interpreter.

    Raises:
        LaunchError: The interpreter of the program is missing on this machine.
    """
    if (interpreter := missing_interpreter(code.folder, program, which)) is None:
        return program
    distribution = program.parent.parent.name
    raise LaunchError(
        f"{code.role} application {code.name}: the colcon bundle's {program.name} of ROS {distribution} needs "
        f"{interpreter}, which this machine does not have; build a container image from ros:{distribution}, or run the "
        "job on a machine with the Ubuntu that the bundle was made on"
    )


def in_ros(code: Code, launcher: Path, argv: tuple[str, ...]) -> tuple[str, ...]:
    """Returns a command line that runs another in the environment of a ROS installation and the bundle's workspace.

    Args:
        code: Code of the application, whose archive may have a ROS workspace.
        launcher: `roslaunch` or `ros2` of the installation.
        argv: Program and its arguments.
    """
    if overlays(code.folder):
        return _with_overlays(code, argv)  # they source that of their own ROS
    setups = [launcher.parent.parent / "setup.bash"]
    if code.folder is not None:
        setups += [code.folder / setup for setup in WORKSPACE_SETUPS]
    return _sourced(code, setups, argv)


def _with_overlays(code: Code, argv: tuple[str, ...]) -> tuple[str, ...]:
    return _sourced(code, setups_of(code.folder), argv)


def _sourced(code: Code, setups: list[Path], argv: tuple[str, ...]) -> tuple[str, ...]:
    """Returns a command line that runs another after sourcing those setup scripts that exist.

    The scripts put their own packages before those of the job's world, so the world's setup is sourced after them.
    """
    there = [setup for setup in setups if setup.is_file()]
    if there and code.world_packages is not None:
        there.append(code.world_packages / "setup.bash")
    return sourced(there, argv)


def _script(code: Code, package: str, file: str, path: Path | None, python: str) -> Program:
    """Plans the start of a Python script: as a module if it is in a package, else as a file.

    Raises `LaunchError` if the bundle does not have the script. Without a folder of the application's code, the module
    is started without looking for a file.
    """
    stem = file.removesuffix(".py")
    if code.folder is None:
        return Program((python, "-m", ".".join(part for part in (code.module, package, stem) if part)))
    if path is None:
        places = " or ".join(_places(package, file))
        raise LaunchError(
            f"{code.role} application {code.name}: the bundle has no {places}; launchConfig.launchFile is {file!r}, a "
            "script of the package",
            code.crash_code,
        )
    module = ".".join(part for part in (package, stem) if part)
    is_module = path == code.folder.joinpath(*module.split(".")).with_suffix(".py") and (
        not package or (path.parent / "__init__.py").is_file()
    )
    return Program((python, "-m", module) if is_module else (python, str(path)))


def _places(package: str, file: str) -> list[str]:
    folder = "/".join(package.split(".")) if package else ""
    return ["/".join(part for part in (folder, inner, file) if part) for inner in _INNER_FOLDERS]


def _find_file(folder: Path, package: str, file: str) -> Path | None:
    """Finds a file of a package in an archive; `None` if there is none."""
    return next((path for place in _places(package, file) if _is_file_of(folder, path := folder / place)), None)


def _is_file_of(folder: Path, path: Path) -> bool:
    """Returns whether a file exists and is inside the archive: names such as `..usr.bin` would lead out of it."""
    return path.is_file() and path.resolve().is_relative_to(folder.resolve())


def _runnable(code: Code, path: Path) -> Path:
    """Returns the path of a file after checking that it can be started: it is executable, or begins with `#!`.

    Archives may lose executable bits. Raises `LaunchError` if the file has neither.
    """
    if not os.access(path, os.X_OK):
        with path.open("rb") as content:
            if content.read(2) != b"#!":
                raise LaunchError(
                    f"{code.role} application {code.name}: {path.name} can neither be executed nor does it say by "
                    "what, with a first line such as #!/bin/bash; pack it with its executable bit set",
                    code.crash_code,
                )
    return path
