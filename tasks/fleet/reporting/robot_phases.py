"""Phases of a robot in a rollout, with start, end and outcome; pure functions of its stored state."""

from dataclasses import dataclass
from typing import Literal

from ....schemas.fleet.operations.deployment_jobs import RobotDeploymentStep
from ....schemas.fleet.rollouts.rollout import DeploymentReport, RobotDeploymentState, Rollout
from ...reporting.outcomes import Outcome

Phase = Literal["offered", "downloading", "installing", "launching"]

PHASES: dict[Phase, str] = {
    "offered": "has an order, has not fetched it",
    "downloading": "validates, downloads, asks the condition",
    "installing": "runs the file before the launch",
    "launching": "launches, runs the file after it",
}
"""Texts of a robot's phases in a deployment, in order."""

_PHASE_OF: dict[RobotDeploymentStep, Phase] = {
    "Validating": "downloading",
    "DownloadingExtracting": "downloading",
    "ExecutingDownloadCondition": "downloading",
    "ExecutingPreLaunch": "installing",
    "Launching": "launching",
    "ExecutingPostLaunch": "launching",
}
_ORDER = list(PHASES)
_LONGEST_AFTER = 0.5
"""Limit of the time shown after a rollout's end, as a share of its length.

Robots that returned long after would leave no space for the rollout itself.
"""


@dataclass(frozen=True)
class Span:
    """A phase of one robot in a deployment, with start and end in seconds since the epoch."""

    phase: Phase
    from_s: float
    until_s: float


@dataclass(frozen=True)
class RobotEnd:
    """Result of a deployment for one robot, for the report."""

    outcome: Outcome
    """Kind of a robot's deployment result, which determines sign and colour."""

    word: str


def last_moment(report: DeploymentReport, rollout: Rollout) -> float:
    """Returns the end of the chart's time axis, in seconds since the epoch."""
    if rollout.ended_s is None:
        return max(report.now_s, rollout.began_s)
    latest_s = rollout.ended_s + _LONGEST_AFTER * (rollout.ended_s - rollout.began_s)
    ends = [state.finished_s for state in rollout.robots.values() if state.finished_s is not None]
    return max(rollout.ended_s, min(latest_s, max(ends, default=0.0)))


def spans_of(state: RobotDeploymentState, until_s: float) -> list[Span]:
    """Returns the phases of a robot in a deployment, in order.

    Args:
        state: The robot; of its orders, the latest is known.
        until_s: End of the phases that are still in progress, in seconds since the epoch.
    """
    if state.offered_s is None:
        return []
    ended_s = state.finished_s if state.finished_s is not None and state.finished_s >= state.offered_s else until_s
    begins: list[tuple[float, Phase]] = [(state.offered_s, "offered")]
    if state.started_s is not None:
        begins.append((state.started_s, "downloading"))
    for step, at_s in state.step_times.items():
        # A robot that lost power may go back; it is shown where it came to first.
        if (phase := _PHASE_OF.get(step)) is not None and _ORDER.index(phase) > _ORDER.index(begins[-1][1]):
            begins.append((max(at_s, begins[-1][0]), phase))
    ends = [*(at_s for at_s, _ in begins[1:]), ended_s]
    spans = (Span(phase, at_s, min(end_s, until_s)) for (at_s, phase), end_s in zip(begins, ends, strict=True))
    return [span for span in spans if span.until_s > span.from_s]


def end_of(state: RobotDeploymentState, *, active: bool) -> RobotEnd:
    """Returns the result of a deployment for one robot, for the report.

    Args:
        state: The robot.
        active: Whether the rollout is in progress.
    """
    if state.outcome == "succeeded":
        return RobotEnd(Outcome.PASSED, "in sync")
    if state.outcome == "failed":
        if state.no_response:
            return RobotEnd(Outcome.BROKEN, "no response")
        if state.failure_code == "RobotDeploymentAborted":
            return RobotEnd(Outcome.CANCELED, "aborted")
        return RobotEnd(Outcome.FAILED, "failed")
    if state.gone is not None:
        return RobotEnd(Outcome.CANCELED, "left the fleet" if state.gone == "left" else "deleted")
    if state.order == "fetched":
        return RobotEnd(Outcome.UNFINISHED, "deploying")
    if active:
        return RobotEnd(Outcome.UNFINISHED, "has an order" if state.order == "offered" else "waits")
    return RobotEnd(Outcome.UNJUDGED, "not reached")
