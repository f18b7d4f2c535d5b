"""Verdicts of runs: decided from requirements, defects of the run and trials."""

from collections.abc import Sequence
from dataclasses import dataclass

from ....schemas.runs.plan import Requirement, Verdict


@dataclass(frozen=True)
class Parts:
    """Facts about a run from which its verdict is decided."""

    own: Verdict = "NONE"
    """Verdict of the environment, or of a program that runs without one."""

    requirements: Sequence[Requirement] = ()
    """Requirements of job and environment; those with `counts: false` are ignored."""

    defects: Sequence[Requirement] = ()
    """Defects of the run itself (broken physics, no steps), as missed requirements."""

    trials: "TrialParts | None" = None
    """Counts of the run's trials by verdict; `None`: the run is a single episode."""

    is_canceled: bool = False
    """Whether the run was cancelled; it has no verdict then."""


@dataclass(frozen=True)
class TrialParts:
    """Numbers of a run's trials: planned, passed, failed, with errors, and without a verdict."""

    planned: int
    passed: int
    failed: int
    errors: int
    unjudged: int


def decide_verdict(parts: Parts) -> Verdict:
    """Decides the verdict of a run: PASS, FAIL or ERROR.

    ERROR takes precedence over FAIL, since measurements of a broken run cannot be trusted. There are two exceptions: a
    robot that fell through the floor has failed, unless the physics itself broke; and trials are independent, so that a
    failed trial counts even if another one is broken.

    Args:
        parts: Facts about the run.
    """
    if parts.is_canceled:
        return "NONE"
    if parts.trials is not None:
        return _of_trials(parts.trials)
    judged = [item for item in parts.requirements if item.counts]
    against = [*judged, *parts.defects]
    if any(not item.satisfied for item in parts.defects) and all(item.error is None for item in parts.defects):
        return "FAIL"
    if parts.own == "ERROR" or any(item.error is not None for item in against):
        return "ERROR"
    if parts.own == "FAIL" or not all(item.satisfied for item in against):
        return "FAIL"
    return "PASS" if parts.own == "PASS" or judged else "NONE"


def _of_trials(trials: TrialParts) -> Verdict:
    finished = trials.passed + trials.failed + trials.errors + trials.unjudged
    if trials.failed:
        return "FAIL"
    if trials.errors or finished < trials.planned or (trials.passed and trials.unjudged):
        return "ERROR"
    return "PASS" if trials.passed else "NONE"
