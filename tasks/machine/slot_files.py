"""Lock files of machine slots and announcements of waiting processes, and the order in which these get slots."""

import fcntl
import os
from collections import Counter
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from pydantic import Field, ValidationError

from ...schemas.wire.base import Model

_MOST_BYTES = 4096


class Holder(Model):
    """Batch and start of the job that holds a machine slot (right to simulate)."""

    batch: str | None = Field(default=None, description="ARN of its batch; None: it is in none.")
    began_s: float = Field(default=0.0, description="When it began, in seconds since 1970.")


@dataclass(frozen=True)
class Slots:
    """The free and the held slots of a machine at one moment."""

    free: tuple[int, ...]
    """Numbers of the machine slots that no process held."""

    holders: tuple[Holder, ...]

    def by_batch(self) -> Counter[str | None]:
        """Counts the jobs in machine slots by batch."""
        return Counter(holder.batch for holder in self.holders)


class SlotFiles:
    """Slots of a machine as locked files, shared by all processes.

    Args:
        folder: Folder of the slots' files.
        count: Number of slots.
    """

    def __init__(self, folder: Path, count: int) -> None:
        self._folder = folder
        self._count = count

    def look(self) -> Slots:
        """Returns the numbers of the free slots, and the holders of the others; tries each slot's lock for a moment."""
        free: list[int] = []
        holders: list[Holder] = []
        for number in range(self._count):
            slot = self._open(number)
            try:
                # Shared, so that processes which look at the same moment do not take each other for holders.
                fcntl.flock(slot, fcntl.LOCK_SH | fcntl.LOCK_NB)
                fcntl.flock(slot, fcntl.LOCK_UN)
                free.append(number)
            except BlockingIOError:
                holders.append(_holder(os.pread(slot, _MOST_BYTES, 0)))
            finally:
                os.close(slot)
        return Slots(tuple(free), tuple(holders))

    def take(self, numbers: Iterable[int], holder: Holder) -> int | None:
        """Locks one of the given slots and writes its holder into the lock file.

        Returns the file descriptor, which holds the lock while it is open, or `None` if others were faster.
        """
        for number in numbers:
            slot = self._open(number)
            try:
                fcntl.flock(slot, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                os.close(slot)
            else:
                os.ftruncate(slot, 0)
                os.pwrite(slot, holder.model_dump_json().encode(), 0)
                return slot
        return None

    def give_back(self, slot: int) -> None:
        """Frees a slot by unlocking and closing its lock file, also where a child process has inherited it."""
        fcntl.flock(slot, fcntl.LOCK_UN)
        os.close(slot)

    def _open(self, number: int) -> int:
        self._folder.mkdir(parents=True, exist_ok=True)
        return os.open(self._folder / str(number), os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)


def _holder(text: bytes) -> Holder:
    """Returns the job that holds a slot, read from the slot's file.

    It has no details if an earlier version wrote the file, or while the file is being written.
    """
    with suppress(ValidationError):
        return Holder.model_validate_json(text)
    return Holder()


_COUNTS_S = 3.0
_REMOVED_S = 60.0
WRITE_EVERY_S = 0.5
"""Interval between two writes of a waiting process's file, in seconds."""


class WaiterRecord(Model):
    """Content of the file by which a process announces that it waits for a slot."""

    pid: int = Field(description="The process that waits.")
    name: str = Field(description="Name of the job or request that waits, for people.")
    batch: str | None = Field(default=None, description="ARN of its batch; None: it is in none.")
    priority: int = Field(default=0, description="The higher, the earlier.")
    since_s: float = Field(description="Since when it has waited, in seconds since 1970.")
    why: str | None = Field(default=None, description="Reason of the wait; None: jobs of its own batch.")


class WaiterFiles:
    """Files by which processes announce that they wait for a machine's slots.

    Args:
        folder: Folder of the waiters' files.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def write(self, ticket: str, record: WaiterRecord, now_s: float) -> None:
        """Announces that a process waits for a slot, for the next seconds.

        Args:
            ticket: The waiter's, unique on the machine.
            record: Content of the record.
            now_s: Seconds since 1970.
        """
        self._folder.mkdir(parents=True, exist_ok=True)
        unfinished = self._folder / f".{ticket}"
        unfinished.write_text(record.model_dump_json())
        os.utime(unfinished, (now_s, now_s))
        unfinished.replace(self._folder / ticket)

    def remove(self, ticket: str) -> None:
        """Deletes the file by which a process announces that it waits for a slot; does nothing if it is gone."""
        (self._folder / ticket).unlink(missing_ok=True)

    def read(self, now_s: float) -> dict[str, WaiterRecord]:
        """Returns the valid announcements by ticket, and deletes those that no process has renewed for long.

        Args:
            now_s: Seconds since 1970.
        """
        found: dict[str, WaiterRecord] = {}
        with suppress(FileNotFoundError):
            for path in self._folder.iterdir():
                with suppress(FileNotFoundError, ValidationError):
                    age_s = now_s - path.stat().st_mtime
                    if age_s > _REMOVED_S:
                        path.unlink(missing_ok=True)
                    elif abs(age_s) <= _COUNTS_S and not path.name.startswith("."):
                        found[path.name] = WaiterRecord.model_validate_json(path.read_bytes())
        return found


def may_begin(ticket: str, waiters: Mapping[str, WaiterRecord], running: Mapping[str | None, int], free: int) -> bool:
    """Whether a waiting job may take a free slot now, or has to leave it to others with more right.

    A batch is taken to want every slot that it can get; a job that is in no batch wants one.

    Args:
        ticket: The waiter's.
        waiters: All waiters of the machine by ticket, this one included.
        running: Number of jobs that run on the machine, by batch.
        free: Number of free slots.
    """
    line, counts = dict(waiters), Counter(running)

    def place(other: str) -> tuple[int, int, float, str]:
        waiter = line[other]
        return -waiter.priority, counts[waiter.batch], waiter.since_s, other

    for _ in range(free):
        if not line:
            return False
        first = min(line, key=place)
        if first == ticket:
            return True
        counts[line[first].batch] += 1
        if line[first].batch is None:
            del line[first]
    return False
