"""Groups of failures that are alike, and the trials that each is compared with: those that passed.

Where nearly none passed, they are compared with those that failed otherwise, too. Neither looks at axes, so that
permutation tests of axes stay valid.
"""

import json
import math
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...schemas.reports.causes import NO_REQUIREMENT
from ..results.table import ResultTable
from .evidence import Evidence, Signature

_ATTRIBUTES = ("room", "other", "phase")
_IN_WORDS = {"requirement": "missed first", "room": "in", "other": "touched or too near", "phase": "when"}
"""Attributes of a failure, and words for its values in a list."""
FEWEST_FAILURES = 8
"""Failures that a part of a group needs to be looked at by itself."""
_NEARLY_NONE = 0.1
"""Share of trials that passed below which they are too few to be compared with: a region of an axis may have none."""
_DURATION_LIMIT = "duration limit"
"""Cause of the end of a trial that ran as long as it may: what it missed at its end did not cut it short."""
_LAST_MOMENT_S = 0.1
"""Time before the end of a trial, two control steps, in which a violation is taken for what ended it."""
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


def all_failures(evidence: Evidence, wholes: Sequence[Group]) -> Group | None:
    """Returns all failures as one group, whatever they missed first; None: there is one requirement, or no failure.

    A cause that lets trials fail in many ways leaves too few failures of each way to be shown.

    Args:
        evidence: The trials.
        wholes: Their groups by requirement.
    """
    if len(wholes) < 2:
        return None
    together = _made(evidence, np.flatnonzero(evidence.failed).tolist())
    return replace(together, signature=together.signature._replace(requirement=""))


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


def breakdown_of(evidence: Evidence, group: Group) -> dict[str, dict[str, int]]:
    """Counts a group's failures by requirement, room, thing and phase; one that all known failures share is left out.

    Args:
        evidence: The trials.
        group: The failures.
    """
    found = [evidence.signatures[row] for row in np.flatnonzero(group.failed).tolist()]
    told: dict[str, dict[str, int]] = {}
    for attribute, words in _IN_WORDS.items():
        counts = Counter(value for each in found if each and (value := getattr(each, attribute)) is not None)
        if len(counts) > 1:
            told[words] = dict(sorted(counts.items(), key=lambda item: (-item[1], item[0])))
    return told


def is_compared_with_failures(evidence: Evidence) -> bool:
    """Returns whether so few trials passed that failures are compared with trials that failed otherwise, too."""
    return int((~evidence.failed).sum()) < _NEARLY_NONE * len(evidence)


def compared(results: ResultTable, evidence: Evidence, group: Group) -> Group:
    """Returns a whole group as it is compared where nearly no trial passed: all trials that its requirement judged.

    Trials that missed the requirement after another count as failures: left out, they would make it look rarer where
    the other one is missed. Trials that met it and failed otherwise count as passed unless that failure cut them short.

    Args:
        results: The table of results.
        evidence: Its trials.
        group: All failures that missed one requirement first.
    """
    if group.signature.requirement == NO_REQUIREMENT:
        return group
    texts, ends_s, ended_by = (
        results.texts("requirements"), results.numbers("sim_time_s"), results.texts("ended_by"),
    )  # fmt: skip
    judged = [_judged(texts[row] or "[]", group.signature.requirement) for row in evidence.rows.tolist()]
    failed = group.failed | np.array([bool(own and not own["satisfied"]) for own, _ in judged], dtype=np.bool_)
    times_s = [_violated_at_s(own) for own, _ in judged if own and not own["satisfied"]]
    latest_s = max(times_s, default=math.inf)
    met = [
        bool(own and own["satisfied"])
        and (ended_by[row] == _DURATION_LIMIT or _had_its_chance(missed, float(ends_s[row]), latest_s))
        for (own, missed), row in zip(judged, evidence.rows.tolist(), strict=True)
    ]
    at_risk = failed | ~evidence.failed | np.array(met, dtype=np.bool_)
    others = int((at_risk & evidence.failed & ~group.failed).sum())
    return replace(group, failed=failed, at_risk=at_risk, parts=(), others=others)


def _judged(text: str, requirement: str) -> tuple[Mapping[str, Any] | None, Sequence[Mapping[str, Any]]]:
    """Returns a trial's judgement of a requirement, `None` if it was not judged, and the requirements it missed."""
    counted = [each for each in json.loads(text) if each.get("counts", True) and not each.get("error")]
    own = next((each for each in counted if each["name"] == requirement), None)
    return own, [each for each in counted if not each["satisfied"]]


def _had_its_chance(missed: Sequence[Mapping[str, Any]], end_s: float, latest_s: float) -> bool:
    """Whether a trial was not cut short by its failure, or lasted until the latest time at which others missed."""
    if math.isnan(end_s):
        return False
    is_cut = any(end_s - _LAST_MOMENT_S <= _violated_at_s(each) < math.inf for each in missed)
    return not is_cut or end_s >= latest_s


def _violated_at_s(requirement: Mapping[str, Any]) -> float:
    found = requirement.get("first_violation_s")
    return math.inf if found is None else float(found)
