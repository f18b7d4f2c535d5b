"""Checkpoint files, for readers without MuJoCo, and checkpoints of runs with trials."""

import fcntl
import os
import time
import zlib
from contextlib import suppress
from pathlib import Path

from pydantic import Field, ValidationError

from ....schemas.runs.plan import RunPlan
from ....schemas.wire.base import Model
from ...files.untrusted_files import read_left, write_anew

PLAN_FILE = "plan.json"
REASON_FILE = "not-resumable.txt"
LOCK_FILE = "lock"

KEPT = 2
"""Number of checkpoints that are kept: the last one may be incomplete after a machine failed."""

_PATTERN = "checkpoint-*.bin"
_MOST_BYTES = 4 << 30
_MOST_REASON_BYTES = 64 * 1024


class CheckpointError(Exception):
    """Raised when a run cannot be continued from a checkpoint; the message says why."""


class RunTakenError(CheckpointError):
    """Raised when another process has locked the run's checkpoints, as it continues the run already."""


class CheckpointHeader(Model):
    """Header of a checkpoint file, which can be read without unpickling."""

    sim_time_s: float = Field(description="Simulated time.")
    steps: int = Field(description="Steps of the environment so far.")
    wall_time_s: float = Field(
        ge=0, allow_inf_nan=False, description="Wall-clock time that the run has taken so far, all attempts together."
    )
    payload_bytes: int = Field(description="Size of what follows.")
    payload_crc32: int = Field(description="CRC-32 of what follows.")


def discard_checkpoints(folder: Path) -> None:
    """Deletes all checkpoints in a folder, so that the run begins anew."""
    for path in checkpoints_in(folder):
        path.unlink()


def last_checkpoint(folder: Path) -> tuple[Path, CheckpointHeader] | None:
    """Returns path and header of the last complete checkpoint in a folder; `None` if there is none."""
    for path in reversed(checkpoints_in(folder)):
        with suppress(OSError, ValidationError, CheckpointError):
            header = CheckpointHeader.model_validate_json(read_left(path, _MOST_BYTES).partition(b"\n")[0])
            payload_of(path, header)
            return path, header
    return None


def wall_time_used_s(plan: RunPlan) -> float:
    """Returns the wall-clock time in seconds until the last checkpoint; 0 without one."""
    last = last_checkpoint(plan.checkpoint_dir) if plan.checkpoint_dir else None
    return last[1].wall_time_s if last else 0.0


def resumable_plan(folder: Path) -> tuple[RunPlan, CheckpointHeader]:
    """Returns the plan of an interrupted run, and its last checkpoint.

    Makes sure that no other process is running it at that moment.

    Args:
        folder: The plan's `checkpoint_dir`.

    Raises:
        CheckpointError: The run cannot be continued; the message says why.
    """
    try:
        plan = RunPlan.model_validate_json(read_left(folder / PLAN_FILE, _MOST_BYTES))
    except (OSError, ValidationError):
        raise CheckpointError("no checkpoints of it are on this machine") from None
    last = last_checkpoint(folder)
    if last is None:
        raise CheckpointError(_reason_in(folder) or "it had not come to its first checkpoint")
    os.close(take_lock(folder / LOCK_FILE))
    return plan, last[1]


def _reason_in(folder: Path) -> str:
    try:
        return read_left(folder / REASON_FILE, _MOST_REASON_BYTES).decode(errors="replace")
    except OSError:
        return ""


def begin_checkpoints(folder: Path, plan: RunPlan) -> int:
    """Locks the checkpoint folder of a run, and stores the plan there.

    Returns:
        File descriptor of the lock, which is held until it is closed.

    Raises:
        RunTakenError: Another process executes the run.
        OSError: The folder cannot be written.
    """
    folder.mkdir(parents=True, exist_ok=True)
    lock = take_lock(folder / LOCK_FILE)
    write_anew(folder / PLAN_FILE, plan.model_dump_json().encode())
    return lock


def write_checkpoint(
    folder: Path, number: int, payload: bytes, *, sim_time_s: float, steps: int, wall_time_s: float
) -> None:
    """Writes a checkpoint, and deletes all older ones except the last.

    Args:
        folder: The plan's `checkpoint_dir`.
        number: Number of the checkpoint, from 1.
        payload: Pickled state.
        sim_time_s: Simulated time so far.
        steps: Steps of the environment so far, or trials that have finished.
        wall_time_s: Wall-clock time of all attempts together.

    Raises:
        OSError: The folder is full or cannot be written.
    """
    header = CheckpointHeader(
        sim_time_s=sim_time_s,
        steps=steps,
        wall_time_s=wall_time_s,
        payload_bytes=len(payload),
        payload_crc32=zlib.crc32(payload),
    )
    path = folder / _PATTERN.replace("*", f"{number:08d}")
    write_anew(path, header.model_dump_json().encode() + b"\n", payload)
    for old in checkpoints_in(folder)[:-KEPT]:
        old.unlink()


def number_of(path: Path) -> int:
    """Returns the number of a checkpoint from its file name."""
    return int(path.stem.rpartition("-")[2])


def checkpoints_in(folder: Path) -> list[Path]:
    """Lists the checkpoints in a folder, complete or not, oldest first."""
    return sorted(folder.glob(_PATTERN))


def payload_of(path: Path, header: CheckpointHeader) -> bytes:
    """Reads and returns the content of a checkpoint after its header, after checking it.

    Raises:
        CheckpointError: The checkpoint is incomplete.
    """
    payload = read_left(path, _MOST_BYTES).partition(b"\n")[2]
    if len(payload) != header.payload_bytes or zlib.crc32(payload) != header.payload_crc32:
        raise CheckpointError(f"{path} is not whole")
    return payload


def take_lock(path: Path) -> int:
    """Takes a file lock until the returned descriptor is closed, or this process ends.

    Raises:
        RunTakenError: Another process holds the lock.
    """
    descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(descriptor)
        raise RunTakenError("another process still runs it") from None
    return descriptor


EVERY_S = 1.0
"""Wall-clock seconds between two checkpoints."""
_PAYLOAD = b"the trials are in the journal"


class TrialCheckpoints:
    """Checkpoints of a run with trials (the number of finished trials), in a folder that is locked for this process."""

    def __init__(self, plan: RunPlan) -> None:
        """Locks the checkpoint folder of a run with trials for this process.

        Args:
            plan: Plan of the run.

        Raises:
            RunTakenError: Another process executes the run.
            OSError: The folder cannot be written.
        """
        self._folder = plan.checkpoint_dir if plan.checkpoint_every_s is not None else None
        self._began = time.perf_counter()
        self._due = self._began + EVERY_S
        self._number, self._used_s = 0, 0.0
        self._lock: int | None = None
        if self._folder is None:
            return
        self._lock = begin_checkpoints(self._folder, plan)
        if (last := last_checkpoint(self._folder)) is not None:
            self._number, self._used_s = number_of(last[0]), last[1].wall_time_s

    def save_if_due(self, trials: int, sim_time_s: float) -> None:
        """Writes a checkpoint of a job's trials if the last one is old enough; none for a run without checkpoints.

        Args:
            trials: Number of finished trials.
            sim_time_s: Total simulated time of the finished trials.

        Raises:
            OSError: The folder is full or cannot be written.
        """
        now = time.perf_counter()
        if self._folder is None or now < self._due:
            return
        self._due = now + EVERY_S
        self._number += 1
        wall_time_s = self._used_s + now - self._began
        write_checkpoint(
            self._folder, self._number, _PAYLOAD, sim_time_s=sim_time_s, steps=trials, wall_time_s=wall_time_s
        )

    def close(self) -> None:
        """Releases the lock on the checkpoint folder, so that another process may continue the run."""
        if self._lock is not None:
            os.close(self._lock)
            self._lock = None
