"""Checkpoints of a run with trials, which goes on after the last trial that has finished.

The journal has the rows; a checkpoint says only that there are some, and how much time they took.
"""

import os
import time

from ....schemas.runs.plan import RunPlan
from .checkpoint_files import begin_checkpoints, last_checkpoint, number_of, write_checkpoint

EVERY_S = 1.0
"""Wall-clock time between two checkpoints."""
_PAYLOAD = b"the trials are in the journal"


class TrialCheckpoints:
    """Makes the checkpoints of one run; none where the run keeps none."""

    def __init__(self, plan: RunPlan) -> None:
        """Takes the folder.

        Args:
            plan: The run.

        Raises:
            RunTakenError: Another process runs the run.
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
        """Makes a checkpoint if the last one is a while ago.

        Args:
            trials: How many have finished.
            sim_time_s: Simulated time of all of them.

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
        """Gives the folder back."""
        if self._lock is not None:
            os.close(self._lock)
            self._lock = None
