"""Memory that the containers of a job share: what `/dev/shm` is for them.

Programs that find each other on one host talk through files there, ROS 2 by default. Containers that use the machine's
network find each other, so they need one place for these files; engines give each container its own, of 64 MiB.
"""

import hashlib
import os
import stat
from contextlib import suppress
from pathlib import Path

from .folders import remove

SHARED_MEMORY = "/dev/shm"  # noqa: S108 - the place in a container
_MACHINES = Path("/dev/shm")  # noqa: S108 - what is made there is private


def make_shared_memory(folder: Path, machines: Path = _MACHINES) -> Path:
    """Makes the folder that containers of a run have as `/dev/shm`; any user in them may write to it.

    It is in memory, or else, where that cannot be, on the disk.

    Args:
        folder: the run's own folder.
        machines: where the machine has a file system in memory.
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
    """Removes what `make_shared_memory` made, if it made anything.

    Args:
        folder: the run's own folder.
        machines: where the machine has a file system in memory.

    Returns:
        What of it is still there: root in a container may make folders that only root may empty.
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
    """Returns the folders for a run's shared memory: in memory if that can be, or else on the disk.

    Args:
        folder: the run's own folder.
        machines: where the machine has a file system in memory.
    """
    digest = hashlib.sha256(os.fsencode(folder.absolute())).hexdigest()[:20]
    return machines / f"robomaker-{os.geteuid()}-{digest}", folder / "shared-memory"
