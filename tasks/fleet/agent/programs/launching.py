"""Start of an application's programs: command, environment variables, sandbox; and the end of programs left over."""

from __future__ import annotations

import os
import pwd
import shlex
import shutil
import signal
import subprocess
import sys
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Callable

from ..bundles.colcon import missing_interpreter, overlays, own_program, package_folders, setups_of, sourced
from ..bundles.launch_files import LAUNCHERS, WORKSPACE_SETUPS, is_launch_file, lacks_launch_file, readers_of
from ..deployment import Launch, Version
from ..errors import AgentError, StepFailed
from ..settings import Home, Options

KINDS = ("bwrap", "setpriv", "none")
_PROBE_TIMEOUT_S = 20.0


@dataclass(frozen=True)
class Sandbox:
    """User and sandbox in which programs are started on the robot."""

    kind: str
    home: Home
    rights: Mapping[str, Any] = field(default_factory=dict)
    """Arguments of `subprocess.Popen` that set the programs' user."""

    user_id: int | None = None

    def wrap(self, command: Sequence[str], data: Path) -> list[str]:
        """Returns the command line that runs a program in the sandbox.

        Args:
            command: The program and its arguments.
            data: The folder that it may write to.
        """
        if self.kind == "setpriv":
            return ["setpriv", "--no-new-privs", "--", *command]
        if self.kind == "bwrap":
            return [*self._bubble(data), "--", *command]
        return list(command)

    def _bubble(self, data: Path) -> list[str]:
        words = ["bwrap", "--ro-bind", "/", "/", "--dev-bind", "/dev", "/dev", "--bind", "/tmp", "/tmp"]  # noqa: S108
        home = str(self.home.folder)
        words += ["--ro-bind", home, home, "--bind", str(data), str(data), "--die-with-parent"]
        for secret in (self.home.connection_file, self.home.folder / "journal.json"):
            if secret.exists():
                words += ["--ro-bind", "/dev/null", str(secret)]
        return words

    def data_folder(self, application: str) -> Path:
        """Returns the folder of an application's data that outlives its versions.

        Raises:
            OSError: The folder cannot be created.
        """
        folder = self.home.folder / "data" / application
        folder.mkdir(parents=True, exist_ok=True)
        if self.user_id is not None:
            os.chown(folder, self.user_id, -1)
        return folder


def find_sandbox(home: Home, options: Options) -> Sandbox:
    """Returns the sandbox that the options ask for, after testing it.

    Raises:
        AgentError: The user or sandbox does not exist, or the sandbox does not work on this machine.
    """
    rights, user_id = _rights(options.user)
    if options.sandbox != "auto" and options.sandbox not in KINDS:
        raise AgentError(f"--sandbox: {options.sandbox!r} is not right; auto, {', '.join(KINDS)} are")
    for kind in KINDS if options.sandbox == "auto" else (options.sandbox,):
        sandbox = Sandbox(kind, home, rights, user_id)
        if _works(sandbox):
            return sandbox
    raise AgentError(f"--sandbox {options.sandbox}: it does not work here; auto takes what does")


def _rights(user: str | None) -> tuple[dict[str, Any], int | None]:
    if user is None:
        return {}, None
    try:
        entry = pwd.getpwnam(user)
    except KeyError:
        raise AgentError(f"--user: there is no user {user!r} on this robot") from None
    if os.geteuid() == entry.pw_uid:
        return {}, None
    if os.geteuid() != 0:
        raise AgentError(f"--user {user}: only root can start programs as another user")
    groups = os.getgrouplist(user, entry.pw_gid)
    return {"user": entry.pw_uid, "group": entry.pw_gid, "extra_groups": groups}, entry.pw_uid


def _works(sandbox: Sandbox) -> bool:
    if sandbox.kind == "none":
        return True
    if shutil.which(sandbox.kind) is None:
        return False
    try:
        words = sandbox.wrap(["true"], sandbox.home.logs)
        quiet = {"stdin": subprocess.DEVNULL, "stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        return subprocess.run(words, check=False, timeout=_PROBE_TIMEOUT_S, **quiet, **sandbox.rights).returncode == 0
    except (OSError, subprocess.SubprocessError):
        return False


HOME_VARIABLE = "ROBOMAKER_AGENT_HOME"
"""Environment variable with the agent's home folder, set in every program that an agent starts."""

VERSION_VARIABLE = "ROBOMAKER_AGENT_VERSION"
"""Environment variable with the folder of the application version, set in the application's programs."""


def kill_leftovers(home: Path, version: str | None = None) -> int:
    """Kills processes left behind by an earlier agent of this home.

    Args:
        home: The agent's.
        version: Folder of the version whose processes are killed; `None`: of any version.

    Returns:
        Number of killed processes.
    """
    marks = [f"{HOME_VARIABLE}={home}".encode()]
    if version is not None:
        marks.append(f"{VERSION_VARIABLE}={version}".encode())
    killed = 0
    for entry in os.scandir("/proc"):
        if not entry.name.isdigit() or int(entry.name) == os.getpid():
            continue
        with suppress(OSError):  # it has ended, or is not ours
            variables = Path(entry.path, "environ").read_bytes().split(b"\0")
            if all(mark in variables for mark in marks):
                os.kill(int(entry.name), signal.SIGKILL)
                killed += 1
    return killed


TAG_PREFIX = "AWS_ROBOMAKER_ROBOT_TAG_KEY_"

_NOT_PASSED_ON = ("NOTIFY_SOCKET", "WATCHDOG_USEC", "WATCHDOG_PID", "CREDENTIALS_DIRECTORY", "INVOCATION_ID")

Which = Callable[[str], "str | None"]


def launch_command(folder: Path, launch: Launch, which: Which = shutil.which) -> list[str]:
    """Returns the command line that starts an application on the robot.

    The launch file is searched in the application's archive (in the package's folder, in its `launch`, at the top), and
    in the overlays of an archive of `colcon bundle`. Files of ROS are started with `ros2 launch` or `roslaunch`, in the
    environment of the archive and of that ROS. A name that is not in the archive may be an installed program. Words
    behind the file are its arguments.

    Args:
        folder: Folder of the version.
        launch: Package and file.
        which: Finds installed programs.

    Raises:
        StepFailed: There is nothing of that name, or it cannot be started on this robot.
    """
    try:
        file, *arguments = shlex.split(launch.file)
    except ValueError as error:
        raise StepFailed("EnvironmentSetupError", f"launchFile: {launch.file!r} is not right: {error}") from None
    places = [f"{launch.package}/{file}", f"{launch.package}/launch/{file}", file, f"launch/{file}"]
    path = next((found for found in (_inside(folder, place) for place in places) if found is not None), None)
    if is_launch_file(file, path):
        return [*_ros_launch(folder, launch.package, file, path, which), *arguments]
    if path is not None:
        return in_overlays(folder, [*interpreted(path), *arguments])
    installed = which(file) if "/" not in file else None
    if installed is None:
        raise StepFailed(
            "EnvironmentSetupError",
            f"launchFile: the bundle has none of {', '.join(places)}, and no program has the name",
        )
    return in_overlays(folder, [installed, *arguments])


def _ros_launch(folder: Path, package: str, file: str, path: Path | None, which: Which) -> list[str]:
    """Returns the command line that starts a launch file with the archive's own ROS, or else the robot's ROS.

    Raises StepFailed if the launch file, the ROS program or its interpreter is missing.
    """
    lack = lacks_launch_file(folder, package, file) if path is None else None
    if lack is not None:
        raise StepFailed("EnvironmentSetupError", f"launchFile: {lack}")
    readers = readers_of(file, path)
    what = [str(path)] if path is not None else [package, file]
    for ros in readers:
        own = own_program(folder, LAUNCHERS[ros])
        program = str(own) if own is not None else which(LAUNCHERS[ros])
        if program is None:
            continue
        missing = missing_interpreter(folder, own, which) if own is not None else None
        if missing is not None:
            raise StepFailed(
                "EnvironmentSetupError",
                f"launchFile: the {LAUNCHERS[ros]} of the colcon bundle needs {missing}, which this robot does not "
                "have; it was made for another release of Ubuntu",
            )
        command = [program, *(["launch"] if ros == 2 else []), *what]
        if overlays(folder):
            return in_overlays(folder, command)
        setups = [Path(program).parent.parent / "setup.bash", *(folder / setup for setup in WORKSPACE_SETUPS)]
        return list(sourced(setups, command))
    needed = " or ".join("`ros2 launch`" if ros == 2 else "`roslaunch`" for ros in readers)
    raise StepFailed(
        "EnvironmentSetupError", f"launchFile: {file} is started by {needed}, which this robot does not have"
    )


def in_overlays(folder: Path, command: Sequence[str]) -> list[str]:
    """Returns a command in the environment of the overlays of a `colcon bundle`; unchanged for other archives."""
    return list(sourced(setups_of(folder), command))


def script_command(folder: Path, file: str, code: str) -> list[str]:
    """Returns the command line of a pre- or post-launch script.

    Args:
        folder: Folder of the version.
        file: Path of the script in the bundle.
        code: Failure code of its absence.

    Raises:
        StepFailed: The bundle has no such file.
    """
    path = _inside(folder, file)
    if path is None:
        raise StepFailed(code, f"the bundle has no file {file}")
    return in_overlays(folder, interpreted(path))


def environment(home: Home, version: Version, data: Path, base: Mapping[str, str] = os.environ) -> dict[str, str]:
    """Returns the environment variables of an application and its scripts.

    Args:
        home: The agent's.
        version: Application version whose launch configuration and tags are exported.
        data: Folder of the application's data that outlives its versions; programs have it as `HOME`.
        base: The agent's own.
    """
    passed = {name: value for name, value in base.items() if name not in _NOT_PASSED_ON}
    tags = {f"{TAG_PREFIX}{name}": value for name, value in version.tags.items() if _is_variable(name, value)}
    marks = {HOME_VARIABLE: str(home.folder), VERSION_VARIABLE: version.folder}
    folder = home.folder / version.folder
    # As in a simulation job, packages of ROS 1 are found without a build.
    given = version.launch.environment.get("ROS_PACKAGE_PATH") or base.get("ROS_PACKAGE_PATH")
    packages = os.pathsep.join([*map(str, package_folders(folder)), *([given] if given else [])])
    own = {"HOME": str(data), **version.launch.environment, "ROS_PACKAGE_PATH": packages}
    return {**passed, **own, **tags, **marks}


def _is_variable(name: str, value: str) -> bool:
    return "=" not in name and "\0" not in name + value


def _inside(folder: Path, name: str) -> Path | None:
    """Returns the path of a file of a version, in its last overlay first.

    Returns `None` for names that lead out of the version.
    """
    for top in (*reversed(overlays(folder)), folder):
        path = top / name.lstrip("/")
        if path.is_file() and folder.resolve() in path.resolve().parents:
            return path
    return None


def interpreted(path: Path) -> list[str]:
    """Returns the command line that runs a file: itself if it is a program, else with python3 (`.py`) or a shell."""
    with path.open("rb") as file:
        beginning = file.read(4)
    if (beginning == b"\x7fELF" or beginning.startswith(b"#!")) and os.access(path, os.X_OK):
        return [str(path)]
    if path.suffix == ".py":
        return [shutil.which("python3") or sys.executable, str(path)]
    return ["/bin/sh", str(path)]
