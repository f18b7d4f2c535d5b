"""Whether a machine has room for another job, and if not, why; pure."""

from dataclasses import dataclass

from ...schemas.runs.machine_waits import Scarce

_MB = 10**6


@dataclass(frozen=True)
class Wait:
    """Why a job waits."""

    scarce: Scarce
    text: str
    """Reason of the wait in words, without the name of the job that waits."""


@dataclass(frozen=True)
class Need:
    """Memory and disk that have to be free before a job begins, in bytes."""

    memory_bytes: int
    disk_bytes: int


@dataclass(frozen=True)
class Room:
    """Free memory and disk of a machine, and the jobs that run on it."""

    memory_bytes: int | None
    """Available memory; None: not known, so nothing waits for it."""

    disk_bytes: int
    """Free on the disk of the data home."""

    running: int
    """How many jobs run."""

    growing: int
    """How many of those began a moment ago, and may still take all the memory that a job needs."""


def why_wait(need: Need, room: Room) -> Wait | None:
    """Tells why a job cannot begin; None: it can.

    A job that would be alone on the machine never waits for memory, as no end of another job would give it more.

    Args:
        need: what it needs.
        room: what there is.
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
