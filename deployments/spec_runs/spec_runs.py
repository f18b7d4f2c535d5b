"""The ordered runs of a data home: begins them, finds how they stand, ends them, takes up those that broke off."""

import fcntl
import os
import subprocess
import sys
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path

from ...schemas.wire.errors import ThrottlingException
from .orders import Order
from .standing import CANCEL, LOCK, LOG, ORDER, Standing, read_standing, write_standing

_PROGRAM = "prefect_robomaker.deployments.cli.ordered_run"
_MOST_LOG_BYTES = 4_096

MOST_AT_ONCE = 4
"""Each is a process of some 200 MB; their jobs share the machine with all others."""


class SpecRuns:
    """Runs that are ordered of one server.

    Args:
        home: the data home.
        variables: environment variables of their processes, besides those of this one.
        audit_log: where their steps are written down; `None`: nowhere.
    """

    def __init__(self, home: Path, variables: Mapping[str, str], audit_log: Path | None = None) -> None:
        self.audit_log = audit_log
        self._runs = home / "runs"
        self._variables = variables
        self._lock = threading.Lock()

    def begin(self, order: Order, standing: Standing) -> None:
        """Begins a run, in a process that outlives this one.

        Raises:
            ThrottlingException: too many run already.
        """
        with self._lock:
            self._check_room()
            folder = self._runs / order.run_id
            folder.mkdir(parents=True)
            write_standing(folder, standing)
            (folder / ORDER).touch(0o600)  # the specification may hold secrets
            (folder / ORDER).write_text(order.model_dump_json(), encoding="utf-8")
            with _lock_of(folder, os.O_CREAT) as lock:
                # Waits a moment where another server just looks whether this run goes on.
                fcntl.flock(lock, fcntl.LOCK_EX)
                self._start(folder, lock)

    def broke_off(self) -> list[str]:
        """The runs whose processes died before they had ended, the newest first; each can be taken up again."""
        names = [path.parent.name for path in self._runs.glob(f"*/{LOCK}")]
        left = filter(self.has_broken_off, names)
        return sorted(left, key=lambda name: name.rpartition("-")[2], reverse=True)

    def has_broken_off(self, run_id: str) -> bool:
        """Whether the process of a run died before the run had ended."""
        folder = self._runs / run_id
        return (folder / LOCK).is_file() and (folder / ORDER).is_file() and not self.is_going(run_id)

    def take_up(self, run_id: str) -> bool:
        """Has a run that broke off go on: what it had made stays, and jobs that did not end are carried on.

        Returns:
            Whether it goes on; False: it has ended or goes on already.

        Raises:
            ThrottlingException: too many run already.
        """
        folder = self._runs / run_id
        with self._lock:
            self._check_room()
            try:
                with _lock_of(folder) as lock:
                    fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                    if not (folder / ORDER).is_file():
                        return False
                    self._start(folder, lock)
            except (BlockingIOError, FileNotFoundError):
                return False
        return True

    def take_up_all(self) -> list[str]:
        """Has the runs that broke off go on, as many as there is room for; answers which."""
        with suppress(ThrottlingException):
            return [run_id for run_id in self.broke_off() if self.take_up(run_id)]
        return []

    def _check_room(self) -> None:
        if len(self.going()) >= MOST_AT_ONCE:
            raise ThrottlingException(f"{MOST_AT_ONCE} runs that were ordered here go on; wait until one has ended")

    def _start(self, folder: Path, lock: int) -> None:
        """Starts the process of a run, which has the lock from now on."""
        order = (folder / ORDER).read_bytes()
        with (folder / LOG).open("ab") as log:
            process = subprocess.Popen(
                [sys.executable, "-P", "-m", _PROGRAM, str(lock)],
                pass_fds=[lock],
                env={**os.environ, **self._variables},
                stdin=subprocess.PIPE,
                stdout=subprocess.DEVNULL,
                stderr=log,
                start_new_session=True,  # Ctrl-C in a terminal is for the server alone
            )
        # A thread: the process reads its input only when it is ready, and has to be waited for when it ends.
        threading.Thread(target=process.communicate, args=(order,), daemon=True).start()

    def standing(self, run_id: str) -> Standing | None:
        """How a run stands; `None`: none of this id was ordered."""
        return read_standing(self._runs / run_id)

    def going(self) -> list[str]:
        """The runs whose processes are there, the newest first; those of other servers of the data home, too."""
        names = [path.parent.name for path in self._runs.glob(f"*/{LOCK}")]
        return sorted(filter(self.is_going, names), key=lambda name: name.rpartition("-")[2], reverse=True)

    def is_going(self, run_id: str) -> bool:
        """Whether the process of a run is there."""
        try:
            with _lock_of(self._runs / run_id) as lock:
                fcntl.flock(lock, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except BlockingIOError:
            return True
        except OSError:
            pass
        return False

    def cancel(self, run_id: str) -> None:
        """Has a run end soon: its jobs are cancelled, and its report is written."""
        (self._runs / run_id / CANCEL).touch()

    def last_words(self, run_id: str) -> str:
        """Returns the end of the log of a run's process; empty: it has none."""
        try:
            with (self._runs / run_id / LOG).open("rb") as log:
                log.seek(max(0, log.seek(0, os.SEEK_END) - _MOST_LOG_BYTES))
                return log.read().decode(errors="replace").strip()
        except OSError:
            return ""


@contextmanager
def _lock_of(folder: Path, flags: int = 0) -> Iterator[int]:
    lock = os.open(folder / LOCK, os.O_RDWR | os.O_CLOEXEC | os.O_NOFOLLOW | flags, 0o600)
    try:
        yield lock
    finally:
        os.close(lock)
