"""Success rates with confidence intervals: of all trials of a run, by world, by requirement, and by room."""

import math
from collections import Counter
from collections.abc import Hashable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from ...schemas.reports.report import ReportedJob, Share
from ...schemas.reports.run_record import CaseOutcome
from ...schemas.runs.requirements import REQUIREMENT_KINDS
from ...schemas.trial_copies import copy_key
from .table import ResultTable

_Z_95 = 1.959963984540054  # two-sided 95 % quantile of the normal distribution


def wilson_interval(successes: float, trials: float, quantile: float = _Z_95) -> tuple[float, float]:
    """Computes the Wilson score confidence interval of a success rate, at 95 % by default.

    Chosen over the textbook interval because batches are small and rates near 0 or 1 are common:
    20 passes of 20 give 0.84 to 1, not 1 to 1.

    Args:
        successes: Number of successes, 0 to `trials`; not whole where copies of trials are left out of both.
        trials: Number of trials, at least 1.
        quantile: Two-sided quantile of the normal distribution for the confidence level.

    Returns:
        Lower and upper bound, both in [0, 1].

    Raises:
        ValueError: There are no trials, or more successes than trials.
    """
    if trials < 1 or not 0 <= successes <= trials:
        raise ValueError(f"{successes} successes of {trials} trials; want 0 <= successes <= trials and trials >= 1")
    rate = successes / trials
    spread = quantile**2 / trials
    middle = rate + spread / 2
    reach = math.sqrt(spread * (rate * (1 - rate) + spread / 4))
    # At the ends the formula gives exactly 0 and 1; rounding must not push them inside or beyond.
    low = 0.0 if successes == 0 else (middle - reach) / (1 + spread)
    high = 1.0 if successes == trials else (middle + reach) / (1 + spread)
    return low, high


@dataclass
class Counts:
    """Numbers of trials that passed, failed, or ended with an error; counts can be added."""

    passed: int = 0
    failed: int = 0
    errors: int = 0
    with_key: int = 0
    """Number of trials that passed or failed and whose states are known."""
    keys: frozenset[int] = frozenset()
    """Different keys of those, from `copy_key`: a trial of another run may be a copy, too."""

    @classmethod
    def of(cls, judged: Iterable[tuple[bool, int | None]], errors: int = 0) -> "Counts":
        """Counts trials: whether each passed, and its key; what ended with an error is counted apart."""
        each = list(judged)
        known = [key for _, key in each if key is not None]
        passed = sum(has_passed for has_passed, _ in each)
        return cls(passed, len(each) - passed, errors, len(known), frozenset(known))

    def share(self, name: str) -> Share:
        """Returns these counts as a pass rate with its confidence interval, under a name."""
        return share_of(name, self.passed, self.failed, self.errors, copies=self.with_key - len(self.keys))

    def __add__(self, other: "Counts") -> "Counts":
        return Counts(
            self.passed + other.passed,
            self.failed + other.failed,
            self.errors + other.errors,
            self.with_key + other.with_key,
            self.keys | other.keys,
        )


def share_of(name: str, passed: int, failed: int, errors: int = 0, *, copies: int = 0) -> Share:
    """Returns a pass rate with its confidence interval (Wilson) from counts; without trials it has no rate.

    Trials that ended with an error do not count for the rate.

    Args:
        name: Name of the rate: what the trials have in common.
        passed: Number of trials that passed.
        failed: Number of trials that failed.
        errors: Number of trials that ended with an error.
        copies: Number of trials that passed or failed and are copies of others; the interval is as wide as that of the
            others.
    """
    trials = passed + failed
    if not trials:
        return Share(name=name, passed=passed, failed=failed, errors=errors)
    low, high = wilson_interval(passed / trials * (trials - copies), trials - copies)
    return Share(
        name=name, passed=passed, failed=failed, errors=errors, copies=copies, rate=passed / trials, low=low, high=high
    )  # fmt: skip


def of_outcomes(name: str, outcomes: Sequence[CaseOutcome], keys: Sequence[int | None]) -> Share:
    """Returns the pass rate of jobs or trials; stopped and unjudged ones do not count.

    Args:
        name: Name of the rate: what the jobs or trials have in common.
        outcomes: Outcome of each job or trial.
        keys: Key of each, which copies share.
    """
    return _counts(zip(outcomes, keys, strict=True)).share(name)


def of_table(name: str, results: ResultTable, *, errors_fail: bool = False) -> Share:
    """Returns the pass rate of all trials in a results table; see `of_outcomes`.

    Args:
        name: Name of the rate: what the trials have in common.
        results: Table of results.
        errors_fail: Whether trials with errors count as failed.
    """
    outcomes = results.texts("outcome")
    if errors_fail:
        outcomes = ["failed" if each == "broken" else each for each in outcomes]
    return _counts(zip(outcomes, trial_keys(results, outcomes), strict=True)).share(name)


def trial_keys(results: ResultTable, judged: Iterable[Hashable], states: Sequence[str | None] = ()) -> list[int | None]:
    """Returns the key of each row of a results table, which copies share; see `copy_key`.

    Args:
        results: Table of results.
        judged: How each row was judged.
        states: Digest of all states of each row; empty: those of the table.
    """
    digests = states or results.texts("state_digest")
    return [copy_key(*each) for each in zip(digests, results.texts("world"), judged, strict=True)]


def counts_by(results: ResultTable, column: str) -> dict[str, Counts]:
    """Counts a run's trials by outcome, for each value of a text column (such as the world), in order of occurrence.

    Trials with an empty cell in the column are not counted.
    """
    outcomes = results.texts("outcome")
    groups: dict[str, list[tuple[str | None, int | None]]] = {}
    for name, outcome, key in zip(results.texts(column), outcomes, trial_keys(results, outcomes), strict=True):
        if name is not None:
            groups.setdefault(name, []).append((outcome, key))
    return {name: _counts(rows) for name, rows in groups.items()}


def by_world(results: ResultTable) -> list[Share]:
    """Returns the pass rate of each world, with its confidence interval, worst first."""
    return _worst_first(counts.share(name) for name, counts in counts_by(results, "world_name").items())


def by_room(jobs: Iterable[ReportedJob]) -> list[Share]:
    """Returns for each room name the share of jobs in which the robot visited the room, worst first."""
    visits: dict[str, list[bool]] = {}
    for job in jobs:
        for room in job.result.rooms if job.result else ():
            visits.setdefault(room.name, []).append(room.visited)
    return _worst_first(share_of(name, sum(found), len(found) - sum(found)) for name, found in visits.items())


def requirement_counts(results: ResultTable) -> dict[str, Counts]:
    """Counts, for each requirement, the trials that met it, that missed it, and in which it could not be judged.

    Trials that ended with an error do not count as met, as they might have missed it later. Requirements without any
    count are left out.
    """
    broken: Counter[str] = Counter(
        each.name
        for row in results.rows_with_errors()
        for each in results.requirements_at(row)
        if each.error and each.counts
    )
    codes, outcomes = results.codes("outcome")
    is_judged = np.isin(codes, [code for code, outcome in enumerate(outcomes) if outcome != "broken"])
    states = trial_keys(results, [None] * len(results))
    found = {}
    for name in results.requirements:
        rows = zip(results.met(name).tolist(), is_judged.tolist(), states, strict=True)
        judged = (
            (met == 1, copy_key(key, met)) for met, has_verdict, key in rows if met == 0 or (met == 1 and has_verdict)
        )
        counts = Counts.of(judged, broken[name])
        if counts != Counts():
            found[name] = counts
    return found


def by_requirement(results: ResultTable) -> list[Share]:
    """Returns the pass rate of each requirement, worst first, with its smallest margin."""
    units = margin_units(results)
    return _worst_first(
        _with_margin(counts.share(name), units.get(name, set()), results)
        for name, counts in requirement_counts(results).items()
    )


def _with_margin(share: Share, units: set[str | None], results: ResultTable) -> Share:
    if len(units) != 1:
        return share  # nothing to compare, or seconds with metres
    met = results.met(share.name)
    # A margin of trials that met it would contradict that it was missed, where those have none.
    of_these = met == 0 if share.failed else met >= 0
    margins = np.where(of_these, results.numbers(f"margin.{share.name}"), np.nan)
    if np.isnan(margins).all():
        return share
    row = int(np.nanargmin(margins))
    [unit] = units
    job = results.job_names()[row]
    return share.model_copy(update={"worst_margin": float(margins[row]), "worst_job": job, "unit": unit})


def margin_units(results: ResultTable) -> dict[str, set[str | None]]:
    """Returns the units of each requirement's margins, if they have a single unit however a run ends.

    All trials of a job have the same requirements. Requirements that are met or not have no unit. The margin of a goal
    is in seconds if it was reached, and in metres if not.
    """
    units: dict[str, set[str | None]] = {}
    for row in results.first_rows:
        for each in results.requirements_at(row):
            if each.counts and each.margin is not None and _compares(each.kind):
                units.setdefault(each.name, set()).add(each.unit)
    return units


def units_if_met(results: ResultTable) -> dict[str, str]:
    """Returns the units of margins of requirements such as goals, which have it only in trials that met them."""
    every = (each for row in results.first_rows for each in results.requirements_at(row) if each.counts)
    kinds = ((each.name, REQUIREMENT_KINDS.get(each.kind or "")) for each in every)
    return {name: kind.unit_if_met for name, kind in kinds if kind is not None and kind.unit_if_met is not None}


def _compares(kind: str | None) -> bool:
    known = REQUIREMENT_KINDS.get(kind or "")
    return known is None or known.margins_compare


def _counts(trials: Iterable[tuple[str | None, int | None]]) -> Counts:
    """Counts trials by their outcome; those with a verdict have keys."""
    each = list(trials)
    judged = [(outcome == "passed", key) for outcome, key in each if outcome in ("passed", "failed")]
    return Counts.of(judged, sum(outcome == "broken" for outcome, _ in each))


def _worst_first(shares: Iterable[Share]) -> list[Share]:
    """Returns rates sorted: those with errors or failures first, by rate; the others keep their order."""
    return sorted(shares, key=lambda share: (not share.errors, share.rate if share.rate is not None else 1.0))
