"""Checkpoints of a run with trials, which goes on after the last trial that has finished.

The journal has the rows; a checkpoint says only that there are some, and how much time they took.
"""

import os
import time
import zlib
from collections.abc import Callable

from ....schemas.runs.plan import RunPlan
from .checkpoint_files import (
    LOCK_FILE,
    PLAN_FILE,
    CheckpointHeader,
    checkpoint_file,
    checkpoints_in,
    last_checkpoint,
    take_lock,
    write_whole,
)

EVERY_S = 1.0
"""Wall-clock time between two checkpoints."""
_KEPT = 2
_PAYLOAD = b"the trials are in the journal"


class TrialCheckpoints:
    """Makes the checkpoints of one run; none where the run keeps none."""

    def __init__(self, plan: RunPlan, clock: Callable[[], float] = time.perf_counter) -> None:
        """Takes the folder.

        Args:
            plan: The run.
            clock: Wall-clock seconds.

        Raises:
            RunTakenError: Another process runs the run.
            OSError: The folder cannot be written.
        """
        self._folder = plan.checkpoint_dir if plan.checkpoint_every_s is not None else None
        self._clock = clock
        self._began = clock()
        self._due = self._began + EVERY_S
        self._number, self._used_s = 0, 0.0
        self._lock: int | None = None
        if self._folder is None:
            return
        self._folder.mkdir(parents=True, exist_ok=True)
        self._lock = take_lock(self._folder / LOCK_FILE)
        write_whole(self._folder / PLAN_FILE, plan.model_dump_json().encode())
        if (last := last_checkpoint(self._folder)) is not None:
            self._number, self._used_s = int(last[0].stem.rpartition("-")[2]), last[1].wall_time_s

    def save_if_due(self, trials: int, sim_time_s: float) -> None:
        """Makes a checkpoint if the last one is a while ago.

        Args:
            trials: How many have finished.
            sim_time_s: Simulated time of all of them.

        Raises:
            OSError: The folder is full or cannot be written.
        """
        now = self._clock()
        if self._folder is None or now < self._due:
            return
        self._due = now + EVERY_S
        header = CheckpointHeader(
            sim_time_s=sim_time_s,
            steps=trials,
            wall_time_s=self._used_s + now - self._began,
            payload_bytes=len(_PAYLOAD),
            payload_crc32=zlib.crc32(_PAYLOAD),
        )
        self._number += 1
        write_whole(self._folder / checkpoint_file(self._number), header.model_dump_json().encode() + b"\n", _PAYLOAD)
        for old in checkpoints_in(self._folder)[:-_KEPT]:
            old.unlink()

    def close(self) -> None:
        """Gives the folder back."""
        if self._lock is not None:
            os.close(self._lock)
            self._lock = None
