"""Copies of trials: those that went through the same states as an earlier one and were judged alike.

Jobs with the same seed, world and application repeat to the bit, and a seed or an axis may change nothing. A copy shows
nothing more than its original, so it does not count wherever results are taken for evidence: in intervals, comparisons
and causes.
"""

from collections.abc import Hashable, Iterable

COPIES = "copies: trials that went through the same states as another and were judged alike; no interval counts them"
"""Legend of tables whose rates have a number of copies beside them."""


def copy_key(states: Hashable | None, *alike: Hashable) -> int | None:
    """Returns a number that a trial shares with its copies, within this process; `None`: it has no copies.

    Args:
        states: Digest of all states of the trial; of a pair, both digests. `None`: not known.
        alike: Everything else in which copies are the same: the judgement, and the world, which states do not show.
    """
    return None if states is None else hash((states, *alike))


def are_copies(keys: Iterable[int | None]) -> list[bool]:
    """Returns for each trial whether it is a copy of an earlier one.

    Args:
        keys: Keys of the trials, from `copy_key`.
    """
    seen: set[int] = set()
    found: list[bool] = []
    for key in keys:
        found.append(key in seen)
        if key is not None:
            seen.add(key)
    return found


def copies_not_counted(count: int) -> str:
    """Returns the remark on a rate: `2 copies not counted`; empty if there are none."""
    return f"{count} {'copy' if count == 1 else 'copies'} not counted" if count else ""
