"""Slots of this machine: how many simulation jobs run here at once, in whatever batches and processes.

A slot is a file that is locked by the process that uses it, so that the slots of a process that dies are free at once.
All processes with the same data home share them.
"""

import fcntl
import logging
import os
import time
from collections.abc import Callable, Generator
from contextlib import contextmanager

from ...schemas.settings import Settings

_FOLDER = "slots"
_LOOK_S = 0.1

_logger = logging.getLogger(__name__)


class MachineSlots:
    """The slots of the machine, as many as `ROBOMAKER_MAX_JOBS` says; safe to use from several threads.

    Args:
        settings: where they are, and how many.
    """

    def __init__(self, settings: Settings) -> None:
        self._folder = settings.home / _FOLDER
        self._count = settings.max_jobs

    @contextmanager
    def hold(self, should_stop: Callable[[], bool], name: str = "a job") -> Generator[bool]:
        """Holds a slot inside the block, after waiting for one.

        Args:
            should_stop: asked while waiting; once true, waiting ends.
            name: what waits, for the log.

        Yields:
            Whether a slot is held; false only when `should_stop` ended the wait.
        """
        slot = self.take()
        if slot is None:
            _logger.info("%s waits: %d jobs run on this machine (ROBOMAKER_MAX_JOBS)", name, self._count)
        while slot is None and not should_stop():
            time.sleep(_LOOK_S)
            slot = self.take()
        try:
            yield slot is not None
        finally:
            if slot is not None:
                self.give_back(slot)

    def take(self) -> int | None:
        """Takes a slot, if one is free; `give_back` has to follow."""
        self._folder.mkdir(parents=True, exist_ok=True)
        for number in range(self._count):
            slot = os.open(self._folder / str(number), os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
            try:
                fcntl.flock(slot, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                os.close(slot)
            else:
                return slot
        return None

    def give_back(self, slot: int) -> None:
        """Frees a slot, also where a child process has inherited it."""
        fcntl.flock(slot, fcntl.LOCK_UN)
        os.close(slot)
