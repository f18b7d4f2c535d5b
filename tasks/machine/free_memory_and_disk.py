"""Measures this machine's free memory and disk, and decides whether a job may begin."""

import shutil
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from ...schemas.runs.programs import Scarce

_MB = 10**6


@dataclass(frozen=True)
class Wait:
    """Reason why a job waits: the resource that the machine has too little of, with a text."""

    scarce: Scarce
    text: str
    """Reason why a job waits for the machine, in words, without the job's name."""


@dataclass(frozen=True)
class Need:
    """Memory and disk space in bytes that have to be free before a job begins."""

    memory_bytes: int
    disk_bytes: int


@dataclass(frozen=True)
class Room:
    """Free memory and disk space of a machine in bytes, and the number of running jobs."""

    memory_bytes: int | None
    """Available memory in bytes; `None`: unknown, so no job waits for it."""

    disk_bytes: int
    """Free bytes on the disk of the data home."""

    running: int
    """Number of jobs that run on the machine."""

    growing: int
    """Number of jobs that began a moment ago, and whose memory use may still grow."""


def why_wait(need: Need, room: Room) -> Wait | None:
    """Returns the reason why a job cannot begin on this machine; `None` if it can.

    A job that would be alone on the machine never waits for memory, as no end of another job would give it more.

    Args:
        need: Memory and disk that the job needs.
        room: Memory and disk that are free.
    """
    if room.disk_bytes < need.disk_bytes:
        text = (
            f"{room.disk_bytes // _MB} MB are free on the disk of ROBOMAKER_HOME, and a job begins with at least "
            f"{need.disk_bytes // _MB} MB (ROBOMAKER_MIN_FREE_DISK_MB)"
        )
        return Wait("disk", text)
    if room.running == 0 or room.memory_bytes is None:
        return None
    left = room.memory_bytes - room.growing * need.memory_bytes
    if left >= need.memory_bytes:
        return None
    taken = room.memory_bytes - left
    kept = f", of which jobs that have just begun may take {taken // _MB} MB" if taken else ""
    text = (
        f"{room.memory_bytes // _MB} MB of memory are available{kept}; another job begins with at least "
        f"{need.memory_bytes // _MB} MB (ROBOMAKER_JOB_MEMORY_MB)"
    )
    return Wait("memory", text)


_PROC = Path("/proc")
_CONTROL_GROUPS = Path("/sys/fs/cgroup")


def free_disk_bytes(folder: Path) -> int:
    """Returns the bytes that this user can still write to a folder's disk."""
    return shutil.disk_usage(folder).free


def available_memory_bytes(proc: Path = _PROC, control_groups: Path = _CONTROL_GROUPS) -> int | None:
    """Returns the memory in bytes that new processes can get without swapping; `None` if unknown.

    Args:
        proc: Path of the proc file system.
        control_groups: Path where control groups are mounted.
    """
    limits = [*_machine(proc), *_groups(proc, control_groups)]
    return min(limits, default=None)


def _machine(proc: Path) -> Iterator[int]:
    with suppress(OSError):
        for line in (proc / "meminfo").read_text().splitlines():
            if line.startswith("MemAvailable:"):
                yield int(line.split()[1]) * 1024


def _groups(proc: Path, control_groups: Path) -> Iterator[int]:
    """Yields the bytes of memory left in each limited control group, from this process's group up to the root.

    Yields nothing on a system without control groups.
    """
    try:
        lines = (proc / "self" / "cgroup").read_text().splitlines()
    except OSError:
        return
    for line in lines:
        _, controllers, path = line.split(":", 2)
        if not controllers:
            yield from _version_2(control_groups, path)
        elif "memory" in controllers.split(","):
            yield from _version_1(control_groups / "memory", path)


def _version_2(root: Path, path: str) -> Iterator[int]:
    for folder in _upwards(root, path):
        with suppress(OSError, ValueError):  # the limit of a group without one is `max`
            limit = int((folder / "memory.max").read_text())
            used = int((folder / "memory.current").read_text())
            yield max(0, limit - used + _cached(folder, "inactive_file"))


def _version_1(root: Path, path: str) -> Iterator[int]:
    for folder in _upwards(root, path):
        with suppress(OSError, ValueError):  # without a limit it is some 8 EiB, more than any machine has
            limit = int((folder / "memory.limit_in_bytes").read_text())
            used = int((folder / "memory.usage_in_bytes").read_text())
            yield max(0, limit - used + _cached(folder, "total_inactive_file"))


def _upwards(root: Path, path: str) -> Iterator[Path]:
    """Yields a control group's folder and the folders above it, up to the root of all control groups."""
    folder = root / path.lstrip("/")
    yield folder
    while folder != root and root in folder.parents:
        folder = folder.parent
        yield folder


def _cached(folder: Path, name: str) -> int:
    """Returns the bytes of cached file contents that the kernel frees when memory is needed; 0 if not known.

    Args:
        folder: Folder of the control group.
        name: Name of the value in its `memory.stat`.
    """
    with suppress(OSError, ValueError):
        for line in (folder / "memory.stat").read_text().splitlines():
            if line.startswith(f"{name} "):
                return int(line.split()[1])
    return 0
