"""Trials of two jobs side by side: the ones to choose from, and the one that is shown first."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from ....schemas.runs.axes import trial_in_words
from ....schemas.runs.axis_kinds.kind import Value
from ....schemas.runs.plan import RunResult
from ....schemas.runs.trial_rows import FailingTrial, TrialsSummary
from ....schemas.runs.trials import Trials

_PASSED = "passed"
_LEFT_NONE, _HAS_NONE, _NOT_RUN = "left no result of its trials", "has no such trial", "was not run"
NOT_RUN = (_LEFT_NONE, _HAS_NONE, _NOT_RUN)
"""Ends of a trial, in words, of which nothing can be run again."""
_MOST_SEARCHED = 20_000
"""Limit of the trials that are searched for the same seed and values, of jobs with different trials: 0.2 s."""

_Key = tuple[int, frozenset[tuple[str, Value]]]


@dataclass(frozen=True)
class SideTrials:
    """Trials of one of two jobs: the results of the job, and the trials that its request orders."""

    result: RunResult | None
    """Result of the job; `None`: it left none."""
    trials: Trials | None = None
    """Trials of its request; `None`: they are not known, or it has none."""
    first_seed: int | None = None
    """Seed of the job; `None`: it is not known."""

    def axes(self, number: int) -> Mapping[str, Value]:
        """Returns the values of the axes of one trial; empty if they are not known."""
        if self.trials is None or self.first_seed is None or not 0 <= number < self.trials.count:
            return {}
        return self.trials.trial(number, self.first_seed).axes

    def key(self, number: int) -> _Key | None:
        """Returns seed and values of a trial, by which it is the same in both jobs; `None` if they are not known."""
        if self.trials is None or self.first_seed is None or not 0 <= number < self.trials.count:
            return None
        trial = self.trials.trial(number, self.first_seed)
        return trial.seed, frozenset(trial.axes.items())

    def find(self, wanted: set[_Key]) -> dict[_Key, int]:
        """Returns the numbers of the trials with some seeds and values; of many trials the first ones are searched."""
        count = 0 if self.trials is None else min(self.trials.count, _MOST_SEARCHED)
        numbers = ((self.key(number), number) for number in range(count))
        return {key: number for key, number in numbers if key is not None and key in wanted}


Both = tuple[SideTrials, SideTrials]
"""Trials of two jobs, those of the first one first."""


@dataclass(frozen=True)
class TrialsBeside:
    """Trials of two jobs of which at least one was recorded, by their numbers in the second job."""

    numbers: tuple[int, ...]
    """Numbers of the trials that one of the jobs recorded, or both."""
    differing: frozenset[int]
    """Those of them that passed in one of the jobs, and not in the other."""
    first: int
    """Number that is shown unless another one is chosen."""
    told: dict[int, tuple[str, str]]
    """Ends of each trial in both jobs, in words: `passed`, `failed, quick: ended at 12 s`."""
    titles: dict[int, str] = field(default_factory=dict[int, str])
    """Names of the trials: `friction 0.4 (trial 17)`."""
    before: dict[int, int | None] = field(default_factory=dict[int, "int | None"])
    """Numbers of the same trials in the first job; `None`: it has no such trial."""


def trials_beside(sides: Both) -> TrialsBeside | None:
    """Returns the trials of two jobs from which one can be chosen; `None` if neither job recorded any.

    A trial is the same in both jobs if it has the same seed and values of axes; where those are not known, if it has
    the same number. The first that differs and was recorded in both jobs is shown first, else the first that differs,
    else the first that both recorded.

    Args:
        sides: Trials of both jobs.
    """
    summaries = [TrialsSummary.of(side.result) for side in sides]
    recorded = [set[int]() if summary is None else set(summary.recorded) for summary in summaries]
    before = _partners(sides, (recorded[0], recorded[1]))
    numbers = sorted(before)
    if not numbers:
        return None
    failing = [{each.trial: each for each in summary.failing} if summary else {} for summary in summaries]
    both = {number for number in numbers if number in recorded[1] and before[number] in recorded[0]}
    told = {
        number: (_told(summaries[0], failing[0], before[number]), _told(summaries[1], failing[1], number))
        for number in numbers
    }
    differing = [
        number
        for number in numbers
        if not {_HAS_NONE, _LEFT_NONE}.intersection(told[number])
        and (before[number] in failing[0]) != (number in failing[1])
        and _PASSED in told[number]
    ]
    ranked = (
        *(number for number in differing if number in both),
        *differing,
        *(number for number in numbers if number in both),
        *numbers,
    )
    numbered = sides[0] if sides[1].trials is None else sides[1]
    titles = {number: trial_in_words(number, numbered.axes(number)) for number in numbers}
    return TrialsBeside(tuple(numbers), frozenset(differing), ranked[0], told, titles, before)


def _partners(sides: Both, recorded: Sequence[set[int]]) -> dict[int, int | None]:
    """Returns the recorded trials by their numbers in the second job, each with its number in the first job.

    Recorded trials of the first job that the second one does not have are left out.
    """
    first, second = sides
    if first.trials is None or second.trials is None or _are_numbered_alike(first, second):
        return {number: number for number in recorded[0] | recorded[1]}
    keys = {key: number for number in recorded[1] if (key := second.key(number)) is not None}
    in_first = first.find(set(keys))
    found: dict[int, int | None] = {number: in_first.get(key) for key, number in keys.items()}
    others = {key: number for number in recorded[0] if (key := first.key(number)) is not None and key not in keys}
    return found | {number: others[key] for key, number in second.find(set(others)).items()}


def _are_numbered_alike(first: SideTrials, second: SideTrials) -> bool:
    ours, theirs = (
        side.trials and side.trials.model_dump(exclude={"record", "record_failed"}) for side in (first, second)
    )
    return ours == theirs and first.first_seed == second.first_seed


def _told(summary: TrialsSummary | None, failing: Mapping[int, FailingTrial], number: int | None) -> str:
    if summary is None:
        return _LEFT_NONE
    if number is None or number >= summary.planned:
        return _HAS_NONE
    if (found := failing.get(number)) is None:
        if summary.stopped_in is not None and number >= summary.stopped_in:
            return _NOT_RUN
        # Only the first that did not pass are listed, and which of the others have no verdict is not known.
        is_listed = len(failing) < summary.counts.failed + summary.counts.errors and number > max(failing, default=-1)
        return "did not fail" if summary.counts.unjudged else "not known" if is_listed else _PASSED
    word = "failed" if found.verdict == "FAIL" else "broke"
    return f"{word}, {found.reason}" if found.reason else word
