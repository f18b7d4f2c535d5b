"""Folders of a run: the file tree that its processes see, and shared memory of containers."""

import hashlib
import os
import shutil
import stat
import subprocess
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

HOME = "/home/robomaker"
LOGS = "/var/log"
TEMPORARY = "/tmp"  # noqa: S108 - the job's own
DATA_SOURCES = "/opt/robomaker/datasources"
AWS = "/opt/robomaker/aws"
"""Folder with the files that tell SDKs the address of the object store; see `role_access`."""
WORLD_PACKAGES = "/opt/robomaker/worldforge"
"""Folder with the ROS packages of the job's world."""
OUTPUT, WORLD, AGENT = "/opt/robomaker/output", "/opt/robomaker/world", "/opt/robomaker/agent"
"""Folders that exist only in containers."""

_FOLDERS = (HOME, LOGS, TEMPORARY, DATA_SOURCES)
_WRITABLE = stat.S_IWUSR | stat.S_IWGRP | stat.S_IWOTH


@dataclass(frozen=True)
class Sandbox:
    """Folders of one run of a simulation job, and their paths on this machine."""

    root: Path
    """Folder of this machine that the job sees as `/`."""

    def create(self) -> "Sandbox":
        """Creates the folders that every job has, unless they exist, and returns this object."""
        for folder in _FOLDERS:
            self.place(folder).mkdir(parents=True, exist_ok=True)
        return self

    def place(self, path: str) -> Path:
        """Converts an absolute path of the job to the path on this machine.

        Raises:
            ValueError: The path is not absolute, or leads upwards.
        """
        absolute = PurePosixPath(path)
        if not absolute.is_absolute() or ".." in absolute.parts:
            raise ValueError(f"{path!r} has to be an absolute path without '..'")
        return self.root.joinpath(*absolute.parts[1:])


@dataclass(frozen=True)
class WorldPackages:
    """ROS packages generated from a job's world, in the folders of a run."""

    prefix: Path
    """ROS prefix of the packages: folder with `setup.sh` and `share`, as an installed workspace."""
    name: str
    """Name of the world in the packages."""


def protect(folder: Path) -> None:
    """Makes a folder and everything in it read-only; links are left as they are."""
    for path in [*folder.rglob("*"), folder]:
        if not path.is_symlink():
            path.chmod(path.stat().st_mode & ~_WRITABLE)


def remove(folder: Path) -> None:
    """Deletes a folder (or a file or link of that name) as far as possible, including read-only files of programs.

    What cannot be deleted stays, without an error.
    """
    if folder.is_symlink() or not folder.is_dir():
        folder.unlink(missing_ok=True)
        return
    try:
        shutil.rmtree(folder, onerror=_unprotect_and_retry)
    except (OSError, RecursionError):  # folders a thousand levels deep; rm does not mind
        subprocess.run(["rm", "-rf", "--", str(folder)], check=False, stderr=subprocess.DEVNULL)


def _unprotect_and_retry(function: object, path: str, problem: object) -> None:
    """Deletes a file or folder that could not be deleted, after making it and its parent folder writable.

    A folder that still cannot be emptied stays, without an error.
    """
    del function, problem
    target = Path(path)
    for folder in (target.parent, target):
        if folder.is_dir() and not folder.is_symlink():
            folder.chmod(0o700)
    if target.is_dir() and not target.is_symlink():
        shutil.rmtree(target, ignore_errors=True)
    else:
        target.unlink(missing_ok=True)


SHARED_MEMORY = "/dev/shm"  # noqa: S108 - the place in a container
_MACHINES = Path("/dev/shm")  # noqa: S108 - what is made there is private


def make_shared_memory(folder: Path, machines: Path = _MACHINES) -> Path:
    """Creates the folder that a run's containers mount as `/dev/shm`, and returns it.

    It is in memory, or on the disk if that is not possible. Raises `OSError` if it can be made in neither.

    Args:
        folder: Folder of the run.
        machines: Folder of this machine's file system in memory.
    """
    for private in shared_memory_places(folder, machines):
        try:
            with suppress(FileExistsError):
                private.mkdir(0o700)
            status = private.lstat()
            if not stat.S_ISDIR(status.st_mode) or status.st_uid != os.geteuid():
                continue  # somebody else was there before
            shared = private / "shm"
            shared.mkdir(exist_ok=True)
            shared.chmod(0o1777)
        except OSError:
            continue
        return shared
    raise OSError(f"no shared memory can be made in {machines} or {folder}")


def remove_shared_memory(folder: Path, machines: Path = _MACHINES) -> list[Path]:
    """Deletes the shared memory folder of a run's containers.

    Args:
        folder: Folder of the run.
        machines: Folder of this machine's file system in memory.

    Returns:
        Paths that remain: folders made by root in a container can only be emptied by root.
    """
    left = []
    for private in shared_memory_places(folder, machines):
        with suppress(OSError):
            if private.lstat().st_uid == os.geteuid():
                remove(private)
                if os.path.lexists(private):
                    left.append(private)
    return left


def shared_memory_places(folder: Path, machines: Path = _MACHINES) -> tuple[Path, Path]:
    """Returns the possible folders for a run's shared memory: in memory, and on the disk.

    Args:
        folder: Folder of the run.
        machines: Folder of this machine's file system in memory.
    """
    digest = hashlib.sha256(os.fsencode(folder.absolute())).hexdigest()[:20]
    return machines / f"robomaker-{os.geteuid()}-{digest}", folder / "shared-memory"
