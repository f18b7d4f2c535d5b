"""Retention policy: decides from facts, rules and the time which runs are kept; pure functions."""

from collections.abc import Iterable, Mapping, Set
from dataclasses import dataclass
from datetime import datetime

from ...schemas.reports.retention import RetentionPolicy


@dataclass(frozen=True)
class Candidate:
    """A run, order or world that may be deleted, with the facts that decide about it."""

    id: str
    ended_at: datetime
    group: str | None = None
    """Name of the specification that the run belongs to; `None`: no specification, so that only age counts."""
    failed: bool = False
    """Whether the run did not succeed."""
    busy: str = ""
    """Reason why a run or world cannot be deleted now; empty if it can."""
    begun: bool = False
    """Whether the deletion of the run or world has begun, so that only being in use keeps it."""


def why_kept(candidates: Iterable[Candidate], policy: RetentionPolicy, now: datetime) -> dict[str, str]:
    """Returns for each candidate for deletion why it is kept; missing ones may be deleted.

    A candidate is deleted only if no rule keeps it: it is older than `older_than`, is not among the newest `keep_runs`
    of its group, and did not fail if failures are kept. Candidates in use are always kept; partly deleted ones are
    deleted.

    Args:
        candidates: Units that may be deleted; their ids differ.
        policy: The rules.
        now: The time.

    Returns:
        Reason by id; candidates to delete are missing.
    """
    each = list(candidates)
    newest = _newest(each, policy.keep_runs)
    reasons: dict[str, str] = {}
    for candidate in each:
        if reason := _reason(candidate, policy, now, newest):
            reasons[candidate.id] = reason
    return reasons


def named_by(names: Mapping[str, Set[str]], kept: Set[str]) -> dict[str, str]:
    """Returns for each id that kept items refer to one of these items, the first by its own id.

    Args:
        names: Ids that each names, by id.
        kept: Ids of those that are kept.
    """
    found: dict[str, str] = {}
    for holder in sorted(kept & names.keys()):
        for name in names[holder]:
            found.setdefault(name, holder)
    return found


def _newest(candidates: list[Candidate], keep_runs: int | None) -> Set[str]:
    """Returns the ids of the newest `keep_runs` candidates of each group; none if that is `None`.

    Candidates that are partly deleted or have no group are left out. Ids decide between candidates that ended at once.
    """
    seen: dict[str, int] = {}
    newest: set[str] = set()
    whole = [each for each in candidates if not each.begun]
    for candidate in sorted(whole, key=lambda each: (each.ended_at, each.id), reverse=True):
        if candidate.group is not None:
            seen[candidate.group] = seen.get(candidate.group, 0) + 1
            if seen[candidate.group] <= (keep_runs or 0):
                newest.add(candidate.id)
    return newest


def _reason(candidate: Candidate, policy: RetentionPolicy, now: datetime, newest: Set[str]) -> str:
    if candidate.busy or candidate.begun:
        return candidate.busy
    if candidate.id in newest:
        return f"one of the newest {policy.keep_runs} of {candidate.group}"
    if policy.keep_failures and candidate.failed:
        return "it did not succeed"
    if policy.older_than is None:
        return "" if candidate.group is not None and policy.keep_runs is not None else "no age was given"
    return "" if candidate.ended_at < now - policy.older_than else "not old enough"
