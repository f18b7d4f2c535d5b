"""Leases (locks on jobs) that this process holds, so that it can release all of them before it ends.

A job worker may have to end while jobs run. Other workers continue a job at once when its lease is released; otherwise
they wait until the lease has run out. After the release the process takes no more leases, and threads that still run
in it can no longer change a job.
"""

import os
import re
import socket
import sys
import threading
import uuid
from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

from ....schemas.wire.errors import RobomakerError, ServiceUnavailableException
from ...catalog import Catalog


class WorkerStopping(RobomakerError):
    """Raised when this process is shutting down and takes no more jobs."""


def owners_of(pid: int) -> str:
    """Returns the common prefix of all lease owner names of a process on this machine."""
    return f"{socket.gethostname()}:{pid}:"


def new_owner() -> str:
    """Makes a unique owner name for a lease: machine, process, a unique part, and the program's role."""
    return f"{owners_of(os.getpid())}{uuid.uuid4().hex[:8]}:{_role()}"


@cache
def _role() -> str:
    """Returns the name of this program for people, which is the last part of lease owner names."""
    return role_of(getattr(getattr(sys.modules["__main__"], "__spec__", None), "name", ""), sys.argv)


def role_of(main: str, words: Sequence[str]) -> str:
    """Returns a program's name for people, from its main module and command line.

    Args:
        main: Name of its main module; empty: it is a script.
        words: Command line of the process.
    """
    if "prefect_robomaker.deployments.worker" in main:
        return "robomaker serve"
    if "prefect_robomaker.deployments.cli.ordered_run" in main:
        return "a continued run" if "continued" in words else "a run of the console"
    if main.startswith("prefect."):
        return "a run of a Prefect worker"
    if main.startswith("prefect_robomaker.deployments.cli") or (words and Path(words[0]).name == "robomaker"):
        command = next((word for word in words[1:] if re.fullmatch("[a-z][a-z-]*", word)), "")
        return f"robomaker {command}".strip()
    return "a Python program"


def died_here(owner: str) -> bool:
    """Whether the owner of a job's lease (lock) was a process of this machine that has died.

    False if the owner is of another machine, is alive, or cannot be read.
    """
    host, _, rest = owner.partition(":")
    pid = rest.partition(":")[0]
    if host != socket.gethostname() or not pid.isdecimal():
        return False
    try:
        os.kill(int(pid), 0)
    except ProcessLookupError:
        return True
    except PermissionError:
        return False  # a process of another user
    return False


@dataclass
class HeldLeases:
    """Leases (locks on jobs) that this process holds; safe to use from several threads."""

    _owners: dict[str, str] = field(default_factory=dict[str, str])
    _reserved: set[str] = field(default_factory=set[str])
    _closed: bool = False
    _lock: threading.Lock = field(default_factory=threading.Lock)

    @contextmanager
    def owner_of(self, arn: str) -> Generator[str]:
        """Yields an owner name for a job's lease (lock), valid inside the `with` block.

        Raises:
            WorkerStopping: No more leases are taken.
        """
        with self._lock:
            if self._closed:
                raise WorkerStopping(f"{arn} is not begun: this job worker is ending")
            if arn in self._reserved:
                owner = self._owners[arn]
            else:
                owner = new_owner()
                self._owners.setdefault(arn, owner)
        try:
            yield owner
        finally:
            with self._lock:
                if self._owners.get(arn) == owner and arn not in self._reserved:
                    del self._owners[arn]

    def adopt(self, arn: str, owner: str) -> bool:
        """Registers the lease (lock) of a job that was taken in the same transaction that stored the job.

        Returns:
            Whether `cancel_reservation` has to follow; false: another thread of this process carries the job out, or
            no more leases are taken.
        """
        with self._lock:
            if self._closed or arn in self._owners:
                return False
            self._owners[arn] = owner
            self._reserved.add(arn)
            return True

    def reserve(self, arn: str, catalog: Catalog, lease_s: float) -> bool:
        """Takes a job's lease (lock) for the thread that will run the job; `cancel_reservation` has to follow.

        Returns:
            Whether the lease was free.
        """
        with self._lock:
            if self._closed or arn in self._owners:
                return False
            owner = self._owners[arn] = new_owner()
            self._reserved.add(arn)
        is_claimed = False
        try:
            is_claimed = catalog.claim(arn, owner, lease_s)
        finally:
            if not is_claimed:
                self._forget(arn)
        return is_claimed

    def reserve_any(self, take: Callable[[str], str | None], catalog: Catalog) -> str | None:
        """Takes the lease (lock) of a job that a callback chooses; `cancel_reservation` has to follow.

        Args:
            take: Takes the lease of some job for the owner whose name it is given; returns the job's ARN, if any.
            catalog: The catalog of the jobs.

        Returns:
            The job; `None`: there was none to take, or this process takes no more.
        """
        with self._lock:
            if self._closed:
                return None
        owner = new_owner()
        if (arn := take(owner)) is None:
            return None
        with self._lock:
            if not self._closed:
                self._owners[arn] = owner
                self._reserved.add(arn)
                return arn
        catalog.release(arn, owner)  # everything was given back meanwhile
        return None

    def renew_reservation(self, arn: str, catalog: Catalog, lease_s: float) -> None:
        """Extends a reserved lease (lock of a job) once, as the job has not begun; does nothing if none is held."""
        with self._lock:
            owner = self._owners.get(arn)
        if owner is not None:
            catalog.renew(arn, owner, lease_s)

    def cancel_reservation(self, arn: str, catalog: Catalog) -> None:
        """Releases a reserved lease (lock of a job), unless that has happened already."""
        if (owner := self._forget(arn)) is not None:
            catalog.release(arn, owner)

    def are_ours(self, catalog: Catalog) -> bool:
        """Whether no other owner has taken a job that this process has locked; an expired lock is still its own.

        Raises:
            ServiceUnavailableException: The catalog does not answer.
        """
        with self._lock:
            held = dict(self._owners)
        return all(catalog.lease_of(arn)[0] in (None, owner) for arn, owner in held.items())

    def give_back_all(self, catalog: Catalog) -> tuple[str, ...]:
        """Releases every lease (lock of a job) at shutdown; this process takes no more jobs.

        Returns:
            ARNs of the jobs whose leases were released, those of batches after the jobs in them. Where the catalog does
            not answer, a lease is left to run out, and its job is missing.
        """
        with self._lock:
            self._closed = True
            # A batch's jobs first: when the batch's lease is free, theirs have to be free too.
            held = sorted(self._owners.items(), key=lambda item: ":simulation-job-batch/" in item[0])
        given_back: list[str] = []
        for arn, owner in held:
            try:
                if catalog.release(arn, owner):
                    given_back.append(arn)
            except ServiceUnavailableException:
                continue  # it runs out by itself
        return tuple(given_back)

    def _forget(self, arn: str) -> str | None:
        with self._lock:
            self._reserved.discard(arn)
            return self._owners.pop(arn, None)


HELD = HeldLeases()
"""Leases that this process holds."""
