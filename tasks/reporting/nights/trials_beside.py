"""Trials of two jobs side by side: the numbers to choose from, and the one that is shown first."""

from dataclasses import dataclass

from ....schemas.runs.plan import RunResult
from ....schemas.runs.trial_rows import FailingTrial, TrialsSummary

_PASSED = "passed"

Results = tuple[RunResult | None, RunResult | None]
"""Results of two jobs, the first one first; `None`: it left none."""


@dataclass(frozen=True)
class TrialsBeside:
    """Trials of two jobs of which at least one was recorded."""

    numbers: tuple[int, ...]
    """Numbers of the trials that one of the jobs recorded, or both."""
    differing: frozenset[int]
    """Those of them that passed in one of the jobs, and not in the other."""
    first: int
    """Number that is shown unless another one is chosen."""
    told: dict[int, tuple[str, str]]
    """Ends of each trial in both jobs, in words: `passed`, `failed, quick: ended at 12 s`."""


def trials_beside(results: Results) -> TrialsBeside | None:
    """Returns the trials of two jobs from which one can be chosen; `None` if neither job recorded any.

    The first that differs and was recorded in both jobs is shown first, else the first that differs, else the first
    that both recorded.

    Args:
        results: Results of both jobs.
    """
    summaries = [TrialsSummary.of(result) for result in results]
    recorded = [set() if summary is None else set(summary.recorded) for summary in summaries]
    numbers = sorted(recorded[0] | recorded[1])
    if not numbers:
        return None
    failing = [{each.trial: each for each in summary.failing} if summary else {} for summary in summaries]
    both = recorded[0] & recorded[1]
    has_each = {
        number: all(summary is not None and number < summary.planned for summary in summaries) for number in numbers
    }
    told = {
        number: (_told(summaries[0], failing[0], number), _told(summaries[1], failing[1], number)) for number in numbers
    }
    differing = [
        number
        for number in numbers
        if has_each[number] and (number in failing[0]) != (number in failing[1]) and _PASSED in told[number]
    ]
    ranked = (
        *(number for number in differing if number in both),
        *differing,
        *(number for number in numbers if number in both),
        *numbers,
    )
    return TrialsBeside(tuple(numbers), frozenset(differing), ranked[0], told)


def _told(summary: TrialsSummary | None, failing: dict[int, FailingTrial], number: int) -> str:
    if summary is None:
        return "left no result of its trials"
    if number >= summary.planned:
        return "has no such trial"
    if (found := failing.get(number)) is None:
        if summary.stopped_in is not None and number >= summary.stopped_in:
            return "was not run"
        # Only the first that did not pass are listed, and which of the others have no verdict is not known.
        is_listed = len(failing) < summary.counts.failed + summary.counts.errors and number > max(failing, default=-1)
        return "did not fail" if summary.counts.unjudged else "not known" if is_listed else _PASSED
    word = "failed" if found.verdict == "FAIL" else "broke"
    return f"{word}, {found.reason}" if found.reason else word
