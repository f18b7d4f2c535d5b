"""Waiters for slots of a machine, as files that each waiter rewrites every second.

A file that is older than that is of a process that has died, is stopped or sleeps; it holds no other waiter back.
"""

import os
from contextlib import suppress
from pathlib import Path

from pydantic import Field, ValidationError

from ...schemas.wire.base import Model

_COUNTS_S = 3.0
_REMOVED_S = 60.0
WRITE_EVERY_S = 0.5
"""How often a waiter writes its file."""


class WaiterRecord(Model):
    """One waiter's file."""

    pid: int = Field(description="The process that waits.")
    name: str = Field(description="Name of the job or request that waits, for people.")
    batch: str | None = Field(default=None, description="ARN of its batch; None: it is in none.")
    priority: int = Field(default=0, description="The higher, the earlier.")
    since_s: float = Field(description="Since when it has waited, in seconds since 1970.")
    why: str | None = Field(default=None, description="Reason of the wait; None: jobs of its own batch.")


class WaiterFiles:
    """The waiters of a machine.

    Args:
        folder: where their files are.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def write(self, ticket: str, record: WaiterRecord, now_s: float) -> None:
        """Says that a waiter waits, for the next seconds.

        Args:
            ticket: the waiter's, unique on the machine.
            record: what it says.
            now_s: seconds since 1970.
        """
        self._folder.mkdir(parents=True, exist_ok=True)
        unfinished = self._folder / f".{ticket}"
        unfinished.write_text(record.model_dump_json())
        os.utime(unfinished, (now_s, now_s))
        unfinished.replace(self._folder / ticket)

    def remove(self, ticket: str) -> None:
        """Says that a waiter waits no more."""
        (self._folder / ticket).unlink(missing_ok=True)

    def read(self, now_s: float) -> dict[str, WaiterRecord]:
        """The waiters that live, by ticket; files of dead ones are removed.

        Args:
            now_s: seconds since 1970.
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
