"""Sequential comparison of a running run with an earlier one: takes pairs in order, and decides as early as possible.

Pairs are taken in an order that the requests determine, and only up to the first missing one, so that jobs that end
early, such as those that fail at once, do not come first. A step is a pair, or, if whole worlds are flipped, all pairs
of a world.

Afterwards e-values decide, and no test of the trials there are: a test of a fixed number of trials is wrong more often
than it says where the trials ended because of what they showed.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...schemas.reports.live_comparison import Against, AgainstAnswer, Answer
from ...schemas.trial_copies import are_copies, copy_key
from ...schemas.wire.common import counted
from .compared_runs import NightRun
from .pairing import BROKEN, FAILED, PASSED, STOPPED, copies_in_words, states_of_pair
from .statistics.e_processes import (
    Numbers,
    best_margin,
    best_sign,
    fewest_worlds,
    margin_wealth,
    mixed,
    sign_wealth,
    threshold,
)

Outcomes = NDArray[np.int8]
States = Sequence[str | None]


@dataclass(frozen=True)
class PairedTrials:
    """Trials of a job of the earlier run, with those of the same job in the running run."""

    world: str
    """Content hash of the world; empty: none."""
    before: Outcomes
    """Outcomes in the earlier run, as codes such as `PASSED`."""
    after: Outcomes | None = None
    """Outcomes in the later run, with `STOPPED` for missing ones; None: the job has not ended."""
    is_fair: bool = True
    """Whether both runs judge the job by the same requirements."""
    before_states: States = ()
    """Digest of all states of each trial of the earlier run, None where it is not known; empty: none is."""
    after_states: States = ()
    """The same of the later run."""

    @property
    def states(self) -> list[tuple[str, str] | None]:
        """Digests of both trials of each pair; None where one of them is not known."""
        unknown: States = (None,) * len(self.before)
        pairs = zip(self.before_states or unknown, self.after_states or unknown, strict=True)
        return [states_of_pair(*each) for each in pairs]

    def changes(self, *, counts_lost: bool, has_margin: bool) -> Numbers:
        """Returns 1 for each trial that got better, -1 for worse, 0 for none, NaN where that is not judged.

        Args:
            counts_lost: Whether trials with errors, cancelled or missing ones count as failed; else they are not
                judged.
            has_margin: Whether that also holds for other requirements, since they could hide a decrease.
        """
        after = np.full(len(self.before), STOPPED, dtype=np.int8) if self.after is None else self.after
        change = (after == PASSED).astype(np.float64) - (self.before == PASSED)
        if counts_lost:
            known = self.before <= BROKEN
            if not self.is_fair:
                change = np.where(self.before == PASSED, -1.0, 0.0)
                known = known & has_margin
        else:
            known = (self.before <= FAILED) & (after <= FAILED) & self.is_fair
        return np.where(known, change, np.nan)


@dataclass(frozen=True)
class Decision:
    """Present answer of a comparison, with the evidence for each answer and the number of used pairs."""

    answer: Answer | None
    """Answer; None: undecided."""
    pairs: int
    """Number of pairs that were used."""
    judged: int
    """Number of used pairs with a verdict in both runs."""
    planned: int
    """Number of all planned pairs."""
    is_hopeless: bool
    """Whether the remaining pairs cannot decide anything."""
    depends_on_lost: bool
    """Whether the answer changes if trials with errors or missing ones count as failed instead of being left out."""
    e_values: dict[str, float] = field(default_factory=dict)
    """Largest evidence by answer: the smaller one of both ways to count trials with errors."""
    worlds: int | None = None
    """Number of worlds that were used, if whole worlds are flipped."""
    repeated: int = 0
    """Number of used pairs with the same states as another one of their world: they show nothing more."""


def decide(trials: Sequence[PairedTrials], asked: Against, lost: Sequence[PairedTrials] = ()) -> Decision:
    """Decides whether a running run is better or worse than an earlier one, from the pairs that have ended.

    An answer needs enough evidence in two ways: with trials with errors left out, and counted as failed.

    Args:
        trials: Trials of both runs by job, in the order of use.
        asked: Error probability and margin.
        lost: Jobs of the earlier run that the later one lacks; with a margin, they could hide the decrease.
    """
    steps, enough = _Steps(trials, asked), threshold(asked.alpha)
    versions = [_Version.of(steps, lost, counts_lost=counts_lost) for counts_lost in (False, True)]
    found: dict[Answer, Numbers] = {
        name: np.minimum(*(version.evidence[name] for version in versions)) for name in versions[0].evidence
    }
    first: dict[Answer, int] = {
        name: int(np.argmax(each >= enough)) for name, each in found.items() if (each >= enough).any()
    }
    answer = min(first, key=lambda name: first[name], default=None)
    looked_at = first[answer] + 1 if answer else steps.ended
    reached = [{name for name, each in version.evidence.items() if (each >= enough).any()} for version in versions]
    return Decision(
        answer=answer,
        pairs=int(steps.sizes[:looked_at].sum()),
        judged=int(versions[0].known[:looked_at].sum()),
        planned=int(steps.sizes.sum()),
        is_hopeless=not any(all(version.can_reach(name, enough) for version in versions) for name in found),
        depends_on_lost=answer is None and reached[0] != reached[1],
        e_values={name: math.exp(each[looked_at - 1]) if looked_at else 1.0 for name, each in found.items()},
        worlds=looked_at if steps.are_worlds else None,
        repeated=int(steps.repeats[:looked_at].sum()),
    )


class _Steps:
    """Pairs, or worlds with all their pairs, as arrays in the order of their first trial.

    Which of the two is used is decided before any trial of the later run has ended.
    """

    def __init__(self, trials: Sequence[PairedTrials], asked: Against) -> None:
        self.asked = asked
        self._trials = trials
        counts = [len(each.before) for each in trials]
        names = list(dict.fromkeys(each.world for each in trials if len(each.before)))
        self.are_worlds = sum(counts) > len(names) >= fewest_worlds(asked.alpha)
        if self.are_worlds:
            numbers = {world: number for number, world in enumerate(names)}
            self._of_trials = np.repeat([numbers.get(each.world, 0) for each in trials], counts)
        else:
            self._of_trials = np.arange(sum(counts))
        self._count = len(names) if self.are_worlds else sum(counts)
        before = _joined([each.before for each in trials])
        self._is_copy = _copies(trials)
        self.repeats = self._summed(self._is_copy)
        """Number of pairs of each step with the same states as an earlier one of their world."""
        waits = np.repeat(np.array([each.after is None for each in trials], dtype=bool), counts)
        self.sizes = self._summed(np.ones(len(before))).astype(np.int64)
        gaps = np.flatnonzero(self._summed(waits))
        self.ended = int(gaps[0]) if len(gaps) else self._count
        """Number of steps before the first one with an unfinished trial."""
        # All that passed can get worse, and all else can get better.
        self.can_gain = self._summed(before != PASSED) > 0
        self.can_lose = self._summed(before == PASSED) > 0

    def changes(self, *, counts_lost: bool) -> tuple[Numbers, Numbers]:
        """Returns the sum of the changes in each ended step, and the number of its judged pairs."""
        has_margin = self.asked.margin is not None
        change = _joined([each.changes(counts_lost=counts_lost, has_margin=has_margin) for each in self._trials])
        known = ~np.isnan(change) & ~self._is_copy
        return self._summed(np.where(known, change, 0.0))[: self.ended], self._summed(known)[: self.ended]

    def _summed(self, values: NDArray[Any]) -> Numbers:
        return np.bincount(self._of_trials, values.astype(np.float64), self._count).astype(np.float64)


def _copies(trials: Sequence[PairedTrials]) -> NDArray[np.bool_]:
    """Returns a mask of the pairs that repeat an earlier one of their world, state by state, as `each_once` does."""
    keys: list[int | None] = []
    for each in trials:
        after = each.before if each.after is None else each.after  # then no state is known
        ended = zip(each.states, each.before.tolist(), after.tolist(), strict=True)
        keys += [copy_key(states, each.world, each.is_fair, *outcomes) for states, *outcomes in ended]
    return np.array(are_copies(keys), dtype=bool)


@dataclass(frozen=True)
class _Version:
    """Evidence with one of the two ways to count trials with errors."""

    evidence: dict[Answer, Numbers]
    """Logarithm of the largest evidence for each answer up to each step."""
    best: dict[Answer, float]
    """Logarithm of the evidence for each answer if all remaining pairs support it."""
    known: Numbers
    """Number of judged pairs of each step."""

    @classmethod
    def of(cls, steps: _Steps, lost: Sequence[PairedTrials], *, counts_lost: bool) -> "_Version":
        margin, rest = steps.asked.margin, slice(steps.ended, None)
        sums, known = steps.changes(counts_lost=counts_lost)
        # Passed trials that the later run lacks are looked at first: it is known from the beginning that they fail.
        has_lost = counts_lost and margin is not None
        missing = -np.ones(sum(int((each.before == PASSED).sum()) for each in lost) if has_lost else 0)
        nets = np.concatenate([missing, sums])
        up, down = sign_wealth(nets), sign_wealth(-nets)
        gains, losses = int(steps.can_gain[rest].sum()), int(steps.can_lose[rest].sum())
        wealth: dict[Answer, Numbers] = {"better": up, "worse": down}
        best: dict[Answer, float] = {
            "better": best_sign(_last(up), gains, are_worlds=steps.are_worlds),
            "worse": best_sign(_last(down), losses, are_worlds=steps.are_worlds),
        }
        if margin is not None:
            means = np.where(known > 0, sums / np.maximum(known, 1), np.nan)
            wealth["not worse"] = not_worse = margin_wealth(np.concatenate([missing, means]), margin)
            others = len(steps.can_gain[rest]) - gains
            best["not worse"] = best_margin(_last(not_worse), gains, others, margin)
        evidence: dict[Answer, Numbers] = {
            name: np.maximum.accumulate(mixed(each))[len(missing) :] for name, each in wealth.items()
        }
        return cls(evidence, best, known)

    def can_reach(self, answer: Answer, enough: float) -> bool:
        """Returns whether the evidence for an answer is enough, or can still become so."""
        return bool((self.evidence[answer] >= enough).any()) or self.best[answer] >= enough


def _last(wealth: Numbers) -> Numbers:
    return wealth[-1] if len(wealth) else np.zeros(wealth.shape[1:])


def _joined(arrays: Sequence[NDArray[Any]]) -> NDArray[Any]:
    return np.concatenate([np.zeros(0), *arrays])


def told_decision(asked: Against, found: Decision, *, is_over: bool) -> AgainstAnswer:
    """Converts a decision to the model that records have.

    Args:
        asked: The question.
        found: The decision.
        is_over: Whether all pairs there will be have been looked at, so that what is open stays open.
    """
    answer: Answer = found.answer or "no difference shown"
    pairs = f"{found.pairs} of {counted(found.planned, 'pair')}"
    worlds = f", {counted(found.worlds, 'world')}" if found.worlds else ""
    repeated = f"; {copies_in_words(found.repeated)}" if found.repeated else ""
    if found.answer is not None:
        why = f"decided after {pairs}{worlds}"
    elif not found.planned:
        answer, why = "not comparable", "no job has the step, world and seed of one of that run"
    elif found.pairs and not found.judged:
        answer, why = "not comparable", f"none of {pairs} has a verdict by the same requirements in both runs"
    elif found.depends_on_lost:
        answer = "not comparable"
        why = f"after {pairs}{worlds} the answer depends on trials that broke or are missing; repair that and run again"
    elif found.is_hopeless and not is_over:
        why = f"after {pairs}{worlds} the others cannot decide it any more"
    else:
        why = f"not decided after {pairs}{worlds}"
    return AgainstAnswer(
        run_id=asked.run_id,
        alpha=asked.alpha,
        margin=asked.margin,
        answer=answer,
        why=f"{why}{repeated}",
        pairs=found.pairs,
        planned=found.planned,
        e_values=dict(found.e_values),
    )


def answer_while_running(
    before: NightRun, after: NightRun, alpha: float, margin: float | None
) -> tuple[Answer, str] | None:
    """Returns the answer about two runs of which one was looked at while it ran, and why it is that.

    Args:
        before: The first run.
        after: The second run.
        alpha: Error probability of all answers together; it may differ from the one with which the run was ordered.
        margin: Fall of the pass rate that would matter, a share from 0 to 1; None: any.

    Returns:
        None: a test of all trials answers.
    """
    found = after.against
    if found is not None and found.run_id == before.run_id:
        return _by_evidence(after, found, alpha, margin)
    for run in (before, after):
        if run.against is not None and run.stopped_early:
            why = f"run {run.run_id} stopped early against run {run.against.run_id}, by what its trials showed"
            return "not comparable", f"{why}; compare it with that run, or run it again without --against"
    return None


def _by_evidence(after: NightRun, found: AgainstAnswer, alpha: float, margin: float | None) -> tuple[Answer, str]:
    if margin != found.margin:
        asked = f"--margin {100 * found.margin:.3g}" if found.margin is not None else "no --margin"
        return "not comparable", f"run {after.run_id} was carried out against {found.run_id} with {asked}: ask so, too"
    if alpha == found.alpha or found.answer == "not comparable":
        return found.answer, f"{found.why}{_evidence(found)}"
    enough: list[Answer] = [
        name for name in ("better", "not worse", "worse") if found.e_values.get(name, 0.0) >= 2 / alpha
    ]
    answer: Answer = "no difference shown"
    if enough:
        answer = max(enough, key=lambda name: found.e_values[name])
    pairs = f"{found.pairs} of {counted(found.planned, 'pair')}"
    return answer, f"after {pairs}, at alpha {alpha:g}{_evidence(found)}"


def _evidence(found: AgainstAnswer) -> str:
    told = ", ".join(f"{name} {value:.3g}" for name, value in found.e_values.items())
    return f" (e-values: {told}; {2 / found.alpha:.3g} decide at alpha {found.alpha:g})" if told else ""
