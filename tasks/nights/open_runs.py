"""Unfinished runs in their folders: the stored order, and the lock file that the run's process holds.

The system releases the lock when the process dies, however it dies; a process that only sleeps or is stopped keeps it.
So a living run is never taken for dead, and two processes never carry out the same run.
"""

import fcntl
import logging
import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Self

from pydantic import ValidationError

from ...schemas.job_owners import JobOwner
from ...schemas.reports.run_record import Interruption, Order
from ..execution.leases.held_leases import new_owner
from ..files.whole_files import write_whole
from ..inspection.run_records import ORDER_NAME, RECORD_NAME
from .kept_answers import ANSWERS

ORDER, LOCK, CANCEL, LOG = ORDER_NAME, "running.lock", "cancel", "process.log"
"""Files in a run's folder: order, lock, cancellation request, and the process's log."""

BEAT_S = 10.0
"""Interval in seconds at which a run's process records that it is alive."""

_logger = logging.getLogger(__name__)


class OpenRun:
    """A run that this process is carrying out, with its lock file and stored order.

    Args:
        folder: The run's.
        order: Order of the run.
        lock: The locked file, which is not closed before the process ends or the run has ended.
    """

    def __init__(self, folder: Path, order: Order, lock: int) -> None:
        self.folder = folder
        self.order = order
        self._lock = lock
        self._ended = threading.Event()

    @classmethod
    def begin(cls, folder: Path, order: Order) -> Self:
        """Stores the order of a run that begins in this process, and locks the run until the run or process ends."""
        lock = os.open(folder / LOCK, os.O_RDWR | os.O_CLOEXEC | os.O_NOFOLLOW | os.O_CREAT, 0o600)
        fcntl.flock(lock, fcntl.LOCK_EX)  # waits a moment where another process just looks whether it goes on
        run = cls(folder, order, lock)
        run.change(owner=own_name())
        return run

    @classmethod
    def inherited(cls, folder: Path, order: Order, lock: int) -> Self:
        """Continues a run whose lock the parent process has passed on."""
        run = cls(folder, order, lock)
        run.change(owner=own_name())
        return run

    @classmethod
    def claim(cls, folder: Path) -> Self | None:
        """Takes over an interrupted run whose process has died; `None` if it runs or has ended.

        Returns:
            The run; `None`: it has ended, goes on, or another process has just taken it.
        """
        try:
            lock = os.open(folder / LOCK, os.O_RDWR | os.O_CLOEXEC | os.O_NOFOLLOW)
        except OSError:
            return None
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            order = read_order(folder)
        except BlockingIOError:
            order = None
        if order is None:
            os.close(lock)
            return None
        if (folder / RECORD_NAME).is_file():  # it had ended, but for this
            run = cls(folder, order, lock)
            run.end()
            return None
        lost_at = datetime.fromtimestamp(os.fstat(lock).st_mtime, UTC)
        interruption = Interruption(lost=order.owner, lost_at=lost_at, continued_at=datetime.now(UTC))
        run = cls(folder, order, lock)
        # Written before anything else is tried: what kills each process that takes the run is so not tried for ever.
        run.change(interruptions=[*order.interruptions, interruption], owner=own_name())
        return run

    @property
    def lock(self) -> int:
        """File descriptor of the run's lock, to be passed on to a child process."""
        return self._lock

    @property
    def is_cancelled(self) -> bool:
        """Whether the run's cancellation was requested."""
        return (self.folder / CANCEL).exists()

    def cancel(self) -> None:
        """Records that the run is to be cancelled, also for a process that takes it over."""
        with suppress(OSError):
            (self.folder / CANCEL).touch()

    def change(self, **members: Any) -> None:
        """Changes members of the stored order of the run, in a file that only this user may read.

        The file is replaced as a whole and written to disk before, so that a loss of power leaves the old or the new
        one.
        """
        self.order = self.order.model_copy(update=members)
        # The specification may hold secrets.
        write_whole(self.folder / ORDER, self.order.model_dump_json(), 0o600, is_synced=True)

    def live(self) -> None:
        """Records regularly that this process is alive, until the run has ended.

        It shows when a run died, and is the only sign for machines whose network file system has no locks.
        """

        def note() -> None:
            while not self._ended.wait(BEAT_S):
                with suppress(OSError):
                    os.utime(self._lock)

        threading.Thread(target=note, name=f"life of {self.order.run_id}", daemon=True).start()

    def pass_on(self) -> None:
        """Closes the lock in this process; the child process that inherited it keeps holding it."""
        os.close(self._lock)

    def end(self) -> None:
        """Deletes the stored order, answers and lock of a finished run; a second call does nothing."""
        if self._ended.is_set():
            return
        self._ended.set()
        for name in (ANSWERS, ORDER, CANCEL, LOCK):  # without the last it is not taken up again
            with suppress(OSError):
                (self.folder / name).unlink(missing_ok=True)
        os.close(self._lock)


def own_name() -> JobOwner:
    """Returns this process's name for the run's record of its owner."""
    return JobOwner.of_lease(new_owner())


def read_order(folder: Path) -> Order | None:
    """Reads the order of an unfinished run; `None` if there is none or it cannot be read."""
    try:
        return Order.model_validate_json((folder / ORDER).read_bytes())
    except OSError:
        return None
    except ValidationError as error:
        _logger.warning("%s cannot be read, so that its run is left: %s", folder / ORDER, error.errors()[0]["msg"])
        return None


def is_going(folder: Path) -> bool:
    """Whether the process that carries out a run is alive: it holds the lock file in the run's folder.

    It is false if there is no such file.
    """
    try:
        with lock_of(folder) as lock:
            fcntl.flock(lock, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except OSError:
        pass
    return False


def has_broken_off(folder: Path) -> bool:
    """Whether a run was interrupted: its process died before the run had ended."""
    return (folder / LOCK).is_file() and (folder / ORDER).is_file() and not is_going(folder)


@contextmanager
def lock_of(folder: Path, flags: int = 0) -> Iterator[int]:
    """Opens a run's lock file inside the `with` block.

    Raises:
        OSError: There is none.
    """
    lock = os.open(folder / LOCK, os.O_RDWR | os.O_CLOEXEC | os.O_NOFOLLOW | flags, 0o600)
    try:
        yield lock
    finally:
        os.close(lock)
