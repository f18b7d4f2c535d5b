"""Groups of failures that are alike, found without a look at the axes, so that testing axes in them stays honest."""

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .evidence import Evidence, Signature

_ATTRIBUTES = ("room", "other", "phase")
FEWEST_FAILURES = 8
"""Failures that a part of a group needs to be looked at by itself."""
_UNEVEN = 0.01
"""P-value below which failures of a requirement are taken for uneven between rooms, things or phases."""
_MOST_IN_COMMON = 0.9
"""Share of a group from which on what its failures have in common is said of it."""


@dataclass(frozen=True)
class Group:
    """Failures that are alike: they missed the same requirement first, perhaps in the same room and phase."""

    signature: Signature
    """Members that they have in common; None where they differ."""
    failed: NDArray[np.bool_]
    """Trials that failed so: True for each of them."""
    at_risk: NDArray[np.bool_]
    """Trials that failed so or passed. What failed otherwise might have failed so later; see `compared`."""
    parts: "tuple[Group, ...]" = ()
    """Groups that it is split into, the largest first; empty: it is not."""
    others: int = 0
    """Trials at risk that missed another requirement first; 0 where enough trials passed."""

    @property
    def count(self) -> int:
        """Number of trials in this group of failures."""
        return int(self.failed.sum())


def groups_of(evidence: Evidence) -> list[Group]:
    """Groups failures by the requirement that was missed first, the largest group first.

    One whose failures lie unevenly in rooms, things or phases has parts by the one of these in which they lie most so.

    Args:
        evidence: The trials.
    """
    names = Counter(each.requirement for each in evidence.signatures if each is not None)
    return [_group(evidence, name) for name, _ in sorted(names.items(), key=lambda item: (-item[1], item[0]))]


def _group(evidence: Evidence, requirement: str) -> Group:
    rows = [row for row, each in enumerate(evidence.signatures) if each and each.requirement == requirement]
    whole = _made(evidence, rows)
    if (attribute := _most_uneven(evidence, rows)) is None:
        return whole
    values = Counter(getattr(evidence.signatures[row], attribute) for row in rows)
    kept = {value for value, count in values.items() if value is not None and count >= FEWEST_FAILURES}
    split: dict[str | None, list[int]] = {}
    for row in rows:
        value = getattr(evidence.signatures[row], attribute)
        split.setdefault(value if value in kept else None, []).append(row)
    if len(split) < 2:
        return whole
    parts = sorted(
        (_made(evidence, part) for part in split.values()), key=lambda part: (-part.count, part.signature.order)
    )
    return Group(whole.signature, whole.failed, whole.at_risk, tuple(parts))


def _made(evidence: Evidence, rows: Sequence[int]) -> Group:
    failed = np.zeros(len(evidence), dtype=np.bool_)
    failed[rows] = True
    found = [each for row in rows if (each := evidence.signatures[row]) is not None]
    common = {name: _in_common(getattr(each, name) for each in found) for name in _ATTRIBUTES}
    return Group(Signature(found[0].requirement, **common), failed, failed | ~evidence.failed)


def _in_common(values: Iterable[str | None]) -> str | None:
    counts = Counter(values)
    value, count = min(counts.items(), key=lambda item: (-item[1], item[0] or ""))
    return value if count >= _MOST_IN_COMMON * counts.total() else None


def _most_uneven(evidence: Evidence, rows: Sequence[int]) -> str | None:
    """Returns the attribute (such as the room) whose values have the most unequal numbers of failures; None: none."""
    found = min(_unevenness(evidence, rows), default=(1.0, ""))
    return found[1] if found[0] < _UNEVEN else None


def _unevenness(evidence: Evidence, rows: Sequence[int]) -> Iterator[tuple[float, str]]:
    from scipy.special import chdtrc

    for attribute in _ATTRIBUTES:
        counts = Counter(getattr(evidence.signatures[row], attribute) for row in rows)
        if len(counts) > 1:
            expected = counts.total() / len(counts)
            squared = sum((count - expected) ** 2 for count in counts.values()) / expected
            yield float(chdtrc(len(counts) - 1, squared)), attribute
