"""Upload configurations of a request: finds the files that match their globs, without following links."""

import errno
import fcntl
import os
import signal
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ....schemas.runs.plan import ApplicationRole
from ....schemas.wire.globs import Glob
from ...files.untrusted_files import open_left
from ...storage.checksums import copy_with_holes
from ..environment.folders import HOME, Sandbox
from ..environment.run_environment import application_configs, container_sandbox, run_sandbox

MAX_DEPTH = 100
"""Maximum depth of folders that are searched."""

_FOLDER_FLAGS = os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW | os.O_CLOEXEC
_QUIET_S = 10.0

Visit = Callable[[int, str, str], None]
"""Function that receives a file: descriptor of its open folder, its name, and its path below the glob's fixed folder.
"""


def visit_matches(root: Path, glob: Glob, visit: Visit) -> None:
    """Calls a function for each regular file that matches a glob pattern, in order of names.

    Args:
        root: Folder to which absolute globs are relative.
        glob: Pattern of the files.
        visit: Function that is called; see `Visit`; it may remove the file.
    """
    with _opened_below(root, glob.fixed_folder) as folder:
        if folder is not None:
            _walk(folder, glob.fixed_folder, "", glob, visit, MAX_DEPTH)


def _walk(folder: int, path: str, below: str, glob: Glob, visit: Visit, depth: int) -> None:
    with os.scandir(folder) as found:
        entries = sorted(found, key=lambda entry: entry.name)
    for entry in entries:
        inner = f"{path}/{entry.name}"
        if entry.is_file(follow_symlinks=False):
            if glob.matches(inner):
                visit(folder, entry.name, below + entry.name)
        elif depth and entry.is_dir(follow_symlinks=False) and glob.may_match_below(inner):
            with _opened(entry.name, folder) as opened:
                if opened is not None:
                    _walk(opened, inner, f"{below}{entry.name}/", glob, visit, depth - 1)


@contextmanager
def _opened_below(root: Path, path: str) -> Iterator[int | None]:
    """Opens a folder below another one inside the `with` block, and yields its file descriptor.

    Yields `None` if the folder does not exist or a symbolic link is on the way.
    """
    folder: int | None = None
    for name in (str(root), *filter(None, path.split("/"))):
        above, folder = folder, None
        with suppress(OSError):
            folder = os.open(name, _FOLDER_FLAGS, dir_fd=above)
        if above is not None:
            os.close(above)
        if folder is None:
            break
    try:
        yield folder
    finally:
        if folder is not None:
            os.close(folder)


@contextmanager
def _opened(name: str, folder: int | None) -> Iterator[int | None]:
    try:
        descriptor = os.open(name, _FOLDER_FLAGS, dir_fd=folder)
    except OSError:
        yield None
        return
    try:
        yield descriptor
    finally:
        os.close(descriptor)


def link_or_copy(folder: int, name: str, target: Path) -> None:
    """Makes a finished file also appear under a second path, by a link or a copy, and deletes an earlier file there.

    Args:
        folder: Descriptor of the file's folder.
        name: Name of the file there.
        target: Path of the second file; its folder is created.

    Raises:
        OSError: The file does not exist, is not a regular file, or may not be read.
    """
    target.parent.mkdir(parents=True, exist_ok=True)
    target.unlink(missing_ok=True)
    with open_left(Path(name), folder) as content:
        try:
            os.link(name, target, src_dir_fd=folder, follow_symlinks=False)
        except OSError:  # on another file system, or of another user
            with target.open("xb") as copy:
                copy_with_holes(content.fileno(), copy)


def take(folder: int, name: str, target: Path) -> bool:
    """Moves a finished file to where programs that may still run cannot reach it.

    A file that a process has open for writing, or opens during the move, stays or is moved back.

    Args:
        folder: Descriptor of the file's folder.
        name: Name of the file there.
        target: New path on the same file system; its folder is created.

    Returns:
        Whether the file was moved, so that no process can write to it any more.

    Raises:
        OSError: The file does not exist, is not a regular file, or may not be read or moved.
    """
    with open_left(Path(name), folder) as content:
        if is_written_to(content.fileno()):
            return False
        target.parent.mkdir(parents=True, exist_ok=True)
        os.rename(name, target, src_dir_fd=folder)
        if is_written_to(content.fileno()):  # it was opened a moment ago
            with suppress(FileExistsError):
                os.link(target, name, dst_dir_fd=folder)
                target.unlink()
                return False
    return True


def is_written_to(descriptor: int) -> bool:
    """Returns whether a process has a file open for writing.

    The kernel grants a read lease on a file that no process has open for writing. If that is not possible (files of
    other users, file systems without leases), a file that did not change for ten seconds counts as finished.
    """
    try:
        # A writer that comes while the lease is held has a signal sent; the usual one would end this process.
        fcntl.fcntl(descriptor, fcntl.F_SETSIG, signal.SIGURG)
        fcntl.fcntl(descriptor, fcntl.F_SETLEASE, fcntl.F_RDLCK)
    except OSError as error:
        if error.errno == errno.EAGAIN:
            return True
        return time.time() - os.fstat(descriptor).st_mtime < _QUIET_S
    fcntl.fcntl(descriptor, fcntl.F_SETLEASE, fcntl.F_UNLCK)
    return False


ROLLING = "UPLOAD_ROLLING_AUTO_REMOVE"
AT_END = "UPLOAD_ON_TERMINATE"

_DEFAULTS: Mapping[str, str] = {
    "gazebo-logs": f"{HOME}/.gazebo/**",
    "ros-bags": f"{HOME}/.ros/bag/**",
    "ros-logs": f"{HOME}/.ros/log/**",
}
"""Names and globs of the default upload configurations (`useDefaultUploadConfigurations`)."""


@dataclass(frozen=True)
class Upload:
    """An upload configuration of a job: name, file pattern and when to upload, with local paths."""

    name: str
    """Name of the folder for its files below the run's outputs."""

    glob: Glob
    is_rolling: bool
    sandbox: Sandbox
    """Folders that the configuration's application sees."""

    path: str = ""
    """Glob as it was given; empty: it is a default one, which need not match anything."""


def uploads_of(request: Mapping[str, Any], folder: Path) -> list[Upload]:
    """Returns the upload configurations of a job's applications.

    Args:
        request: Request of the job.
        folder: Folder of the run.
    """
    return [
        Upload(each["name"], Glob(each["path"]), each["uploadBehavior"] == ROLLING, _sandbox(folder, role), asked)
        for role, config in application_configs(request)
        for each, asked in _configurations(config)
    ]


def _configurations(config: Mapping[str, Any]) -> Iterator[tuple[Mapping[str, Any], str]]:
    """Yields an application's upload configurations with their globs, and the default ones.

    The defaults are added unless the request excludes them; if the application has none of its own, only if the request
    includes them.
    """
    own = config.get("uploadConfigurations") or []
    yield from ((each, each["path"]) for each in own)
    if config.get("useDefaultUploadConfigurations", bool(own)):
        for name, path in _DEFAULTS.items():
            yield {"name": name, "path": path, "uploadBehavior": AT_END}, ""


def _sandbox(folder: Path, role: ApplicationRole) -> Sandbox:
    own = container_sandbox(folder, role)
    return own if own.root.is_dir() else run_sandbox(folder)
