"""The slots of a machine as files: a slot is held by the process that has locked its file.

So the slots of a process that dies are free at once. The file says which batch holds the slot, and since when.
"""

import fcntl
import os
from collections import Counter
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from pydantic import Field, ValidationError

from ...schemas.wire.base import Model

_MOST_BYTES = 4096


class Holder(Model):
    """A job that runs in a slot."""

    batch: str | None = Field(default=None, description="ARN of its batch; None: it is in none.")
    began_s: float = Field(default=0.0, description="When it began, in seconds since 1970.")


@dataclass(frozen=True)
class Slots:
    """Free and held slots at one moment."""

    free: tuple[int, ...]
    """Numbers of the slots that no process held."""

    holders: tuple[Holder, ...]

    def by_batch(self) -> Counter[str | None]:
        """How many jobs run, by batch."""
        return Counter(holder.batch for holder in self.holders)


class SlotFiles:
    """The slots of a machine.

    Args:
        folder: where their files are.
        count: how many there are.
    """

    def __init__(self, folder: Path, count: int) -> None:
        self._folder = folder
        self._count = count

    def look(self) -> Slots:
        """Sees which slots are free, and who holds the others."""
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
        """Takes one of some slots; returns its descriptor, or None if others were faster."""
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
        """Frees a slot, also where a child process has inherited it."""
        fcntl.flock(slot, fcntl.LOCK_UN)
        os.close(slot)

    def _open(self, number: int) -> int:
        self._folder.mkdir(parents=True, exist_ok=True)
        return os.open(self._folder / str(number), os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)


def _holder(text: bytes) -> Holder:
    """Job in a slot, from the slot's file; no facts for an earlier version, or while the file is being written."""
    with suppress(ValidationError):
        return Holder.model_validate_json(text)
    return Holder()
