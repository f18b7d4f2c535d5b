"""Trials that failures are compared with: those that passed, and where nearly none did, those that failed otherwise.

The choice looks at how trials ended and never at axes, so that permutation tests of axes stay valid.
"""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ...schemas.reports.causes import NO_REQUIREMENT
from ..results.table import ResultTable
from .evidence import Evidence
from .groups import Group

_NEARLY_NONE = 0.1
"""Share of trials that passed below which they are too few to be compared with: a region of an axis may have none."""
_DURATION_LIMIT = "duration limit"
"""Cause of the end of a trial that ran as long as it may: what it missed at its end did not cut it short."""
_LAST_MOMENT_S = 0.1
"""Time before the end of a trial, two control steps, in which a violation is taken for what ended it."""


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
