"""The folders of a job: what `/home/robomaker` and the like are on this machine while it runs.

| in the job | here |
| --- | --- |
| `/home/robomaker` | `<root>/home/robomaker`, the `HOME` of all its processes |
| `/var/log` | `<root>/var/log` |
| `/tmp` | `<root>/tmp`, their `TMPDIR` |
| `/opt/robomaker/datasources/<name>/<key>` | the same below the root, read-only |
"""

import shutil
import stat
import subprocess
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

HOME = "/home/robomaker"
LOGS = "/var/log"
TEMPORARY = "/tmp"  # noqa: S108 - the job's own
DATA_SOURCES = "/opt/robomaker/datasources"
AWS = "/opt/robomaker/aws"
"""Folder of the files from which SDKs know the object store; see `role_access`."""
OUTPUT, WORLD, AGENT = "/opt/robomaker/output", "/opt/robomaker/world", "/opt/robomaker/agent"
"""Folders that only containers have."""

_FOLDERS = (HOME, LOGS, TEMPORARY, DATA_SOURCES)
_WRITABLE = stat.S_IWUSR | stat.S_IWGRP | stat.S_IWOTH


@dataclass(frozen=True)
class Sandbox:
    """The folders of one run of a job."""

    root: Path
    """Folder of this machine that is `/` for the job."""

    def create(self) -> "Sandbox":
        """Makes the folders that every job has."""
        for folder in _FOLDERS:
            self.place(folder).mkdir(parents=True, exist_ok=True)
        return self

    def place(self, path: str) -> Path:
        """Returns the path on this machine of an absolute path of the job.

        Raises:
            ValueError: the path is not absolute, or leads upwards.
        """
        absolute = PurePosixPath(path)
        if not absolute.is_absolute() or ".." in absolute.parts:
            raise ValueError(f"{path!r} has to be an absolute path without '..'")
        return self.root.joinpath(*absolute.parts[1:])


def protect(folder: Path) -> None:
    """Makes all that is in a folder read-only, and the folder itself; links are left as they are."""
    for path in [*folder.rglob("*"), folder]:
        if not path.is_symlink():
            path.chmod(path.stat().st_mode & ~_WRITABLE)


def remove(folder: Path) -> None:
    """Removes a folder as far as that is possible, whatever programs have left in it."""
    if folder.is_symlink() or not folder.is_dir():
        folder.unlink(missing_ok=True)
        return
    try:
        shutil.rmtree(folder, onerror=_unprotect_and_retry)
    except (OSError, RecursionError):  # folders a thousand levels deep; rm does not mind
        subprocess.run(["rm", "-rf", "--", str(folder)], check=False, stderr=subprocess.DEVNULL)


def _unprotect_and_retry(function: object, path: str, problem: object) -> None:
    """Makes the folder of what cannot be removed writable, and removes it then."""
    del function, problem
    target = Path(path)
    for folder in (target.parent, target):
        if folder.is_dir() and not folder.is_symlink():
            folder.chmod(0o700)
    if target.is_dir() and not target.is_symlink():
        shutil.rmtree(target, ignore_errors=True)
    else:
        target.unlink(missing_ok=True)
