"""The ordered runs of a data home: begins them, finds how they stand, ends them, takes up those that broke off."""

import fcntl
import os
import threading
from collections.abc import Iterator, Mapping
from pathlib import Path

from ...schemas.run_orders import Order
from ...schemas.wire.errors import ThrottlingException
from ...tasks.nights.open_runs import CANCEL, LOCK, LOG, ORDER, OpenRun, has_broken_off, is_going, lock_of
from ...tasks.nights.taking_up import CONTINUED, start_process
from .standing import STANDING, Standing, read_standing, write_standing

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
            with lock_of(folder, os.O_CREAT) as lock:
                # Waits a moment where another server just looks whether this run goes on. Locked before there is an
                # order, which another process could take for that of a run that broke off.
                fcntl.flock(lock, fcntl.LOCK_EX)
                (folder / ORDER).touch(0o600)  # the specification may hold secrets
                (folder / ORDER).write_text(order.model_dump_json(), encoding="utf-8")
                start_process(OpenRun(folder, order, os.dup(lock)), self._variables)

    def has_broken_off(self, run_id: str) -> bool:
        """Whether the process of a run died before the run had ended."""
        return has_broken_off(self._runs / run_id)

    def take_up(self, run_id: str) -> bool:
        """Has a run that broke off go on: what it had made stays, and jobs that did not end are carried on.

        Returns:
            Whether it goes on; False: it has ended or goes on already.

        Raises:
            ThrottlingException: too many run already.
        """
        with self._lock:
            self._check_room()
            if (claimed := OpenRun.claim(self._runs / run_id)) is None:
                return False
            start_process(claimed, self._variables, CONTINUED)
        return True

    def _open(self) -> Iterator[str]:
        """The ordered runs that have not ended; those that no visitor ordered are none of them."""
        return (path.parent.name for path in self._runs.glob(f"*/{LOCK}") if path.with_name(STANDING).is_file())

    def _check_room(self) -> None:
        if len(self.going()) >= MOST_AT_ONCE:
            raise ThrottlingException(f"{MOST_AT_ONCE} runs that were ordered here go on; wait until one has ended")

    def standing(self, run_id: str) -> Standing | None:
        """How a run stands; `None`: none of this id was ordered."""
        return read_standing(self._runs / run_id)

    def going(self) -> list[str]:
        """The runs whose processes are there, the newest first; those of other servers of the data home, too."""
        return sorted(filter(self.is_going, self._open()), key=lambda name: name.rpartition("-")[2], reverse=True)

    def is_going(self, run_id: str) -> bool:
        """Whether the process of a run is there."""
        return is_going(self._runs / run_id)

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
