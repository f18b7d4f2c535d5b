"""View of a job's trials: pass rates with intervals, and the trials that did not pass."""

from collections.abc import Mapping
from dataclasses import dataclass

from ...schemas.reports.report import ReportedJob
from ...schemas.reports.summary import Share
from ...schemas.runs.trial_rows import FailingTrial, TrialCounts, TrialsSummary
from ..results.rates import share_of

MOST_SHOWN = 20
"""How many trials, and how many combinations of parameters, a job's card shows."""


@dataclass(frozen=True)
class TrialsView:
    """Summary of a job's trials on its card."""

    planned: int
    stopped_in: int | None
    share: Share
    combinations: list[Share]
    """Shares by combination of parameters, the worst first; empty where there is but one."""

    failing: list[FailingTrial]
    more: int
    """How many more did not pass."""

    command: str
    """Command that runs the first of the failing trials again."""

    @property
    def label(self) -> str:
        """`95 of 100 trials passed`."""
        judged = self.share.passed + self.share.failed + self.share.errors
        return f"{self.share.passed} of {judged} trials passed"


def trials_share(job: ReportedJob) -> Share | None:
    """How many trials of a job passed; `None` for a job without trials."""
    summary = TrialsSummary.of(job.result)
    return None if summary is None else _share("trials", summary.counts)


def view_trials(job: ReportedJob) -> TrialsView | None:
    """Computes what is shown; `None` for a job without trials."""
    summary = TrialsSummary.of(job.result)
    if summary is None:
        return None
    shares = [_share(parameters_in_words(each.parameters), each) for each in summary.combinations]
    worst = sorted(shares, key=lambda share: (not share.errors, 1.0 if share.rate is None else share.rate))
    failing = summary.failing[:MOST_SHOWN]
    return TrialsView(
        planned=summary.planned,
        stopped_in=summary.stopped_in,
        share=_share("all trials", summary.counts),
        combinations=worst[:MOST_SHOWN] if len(worst) > 1 else [],
        failing=failing,
        more=summary.counts.failed + summary.counts.errors - len(failing),
        command=f"robomaker repro {job.label} --trial {failing[0].trial}" if failing else "",
    )


def parameters_in_words(parameters: Mapping[str, str]) -> str:
    """`SPEED=0.4, LOAD=2`."""
    return ", ".join(f"{name}={value}" for name, value in parameters.items())


def _share(name: str, counts: TrialCounts) -> Share:
    return share_of(name, counts.passed, counts.failed, counts.errors)
