"""Order in which waiters get the free slots of a machine; pure.

Higher priority comes first; among equals the batch of which fewer jobs run on the machine; then who has waited longest.
"""

from collections import Counter
from collections.abc import Mapping

from .waiter_files import WaiterRecord


def may_begin(ticket: str, waiters: Mapping[str, WaiterRecord], running: Mapping[str | None, int], free: int) -> bool:
    """Whether a waiter may take one of the free slots now, or has to leave them to others.

    A batch is taken to want every slot that it can get; a job that is in no batch wants one.

    Args:
        ticket: the waiter's.
        waiters: all waiters of the machine by ticket, this one included.
        running: how many jobs run on the machine, by batch.
        free: how many slots are free.
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
