"""Order in which waiters get the free slots of a machine; pure.

Higher priority comes first; among equals the batch of which fewer jobs run on the machine; then who has waited longest.
"""

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass


@dataclass(frozen=True)
class Waiter:
    """A batch that wants slots, or one job that is in no batch."""

    ticket: str
    """Unique on the machine."""

    batch: str | None
    """ARN of the batch; None: a job that is in no batch. All such jobs share as if they were one batch."""

    priority: int
    """The higher, the earlier."""

    since_s: float
    """Since when it has waited, in seconds since 1970."""


def may_begin(ticket: str, waiters: Iterable[Waiter], running: Mapping[str | None, int], free: int) -> bool:
    """Whether a waiter may take one of the free slots now, or has to leave them to others.

    A batch is taken to want every slot that it can get; a job that is in no batch wants one.

    Args:
        ticket: the waiter's.
        waiters: all waiters of the machine, this one included.
        running: how many jobs run on the machine, by batch.
        free: how many slots are free.
    """
    line = {waiter.ticket: waiter for waiter in waiters}
    counts = Counter(running)
    for _ in range(free):
        if not line:
            return False
        first = min(
            line.values(),
            key=lambda waiter: (-waiter.priority, counts[waiter.batch], waiter.since_s, waiter.ticket),
        )
        if first.ticket == ticket:
            return True
        counts[first.batch] += 1
        if first.batch is None:
            del line[first.ticket]
    return False
