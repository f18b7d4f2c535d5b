"""View model of a deployment's report: all computed values that the HTML template shows."""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from statistics import median

from markupsafe import Markup

from ....schemas.fleet.operations.deployment_jobs import DeploymentConfig
from ....schemas.fleet.rollouts.rollout import DeploymentReport, RobotDeploymentState, Rollout
from ....schemas.runs.variables import hide_secrets
from ....schemas.wire.arns import ResourceArn
from ...reporting import outcomes
from ...reporting.outcomes import Outcome
from . import chart
from .chart import Scale, blocks_of
from .robot_phases import PHASES, Phase, RobotEnd, Span, end_of, last_moment, spans_of

MOST_ROWS = 200
"""Limit of robots with a row each in the chart; for larger fleets it shows the phases of each wave."""

_MOST_LISTED = 500
"""Limit of rows in the table of robots; those that need attention are first."""

_STATES: dict[str, tuple[Outcome, str]] = {
    "Succeeded": (Outcome.PASSED, "succeeded"),
    "Failed": (Outcome.FAILED, "failed"),
    "Canceled": (Outcome.CANCELED, "canceled"),
}


@dataclass(frozen=True)
class RobotView:
    """A robot's row in the chart and table of a deployment's report."""

    name: str
    wave: int | None
    """Number of the robot's wave; `None`: it cannot get the application."""
    end: RobotEnd
    step: str
    """Current step of a robot that is deploying; else empty."""
    before: str
    after: str
    took_s: float | None
    """Time from the robot's order to its end, in seconds; `None`: it has not ended."""
    code: str
    reason: str
    spans: Sequence[Span]
    bar: Markup = Markup()  # noqa: RUF009 - it does not change


@dataclass(frozen=True)
class WaveView:
    """A wave (group of robots) in the chart of a deployment's report."""

    number: int
    count: int
    ends: Sequence[tuple[RobotEnd, int]]
    """Number of a deployment wave's robots by result, the worst first."""
    robots: Sequence[RobotView]
    """Robots of the wave with a row each; empty in a large fleet."""
    blocks: Markup


@dataclass(frozen=True)
class Fact:
    """A labelled value in a deployment's report, such as the application's version."""

    name: str
    value: str
    is_code: bool = False


@dataclass(frozen=True)
class RolloutPage:
    """All values that the HTML template of a deployment's report needs."""

    report: DeploymentReport
    outcome: Outcome
    state: str
    headline: str
    began_at: datetime
    took: str
    counts: Sequence[tuple[RobotEnd, int]]
    """Number of a deployment's robots by result, the worst first."""
    numbers: Sequence[tuple[str, str]]
    """Key figures of the deployment: names and values."""
    facts: Sequence[Fact]
    trouble: Sequence[tuple[str, int, str]] = ()
    """Failure codes, the number of robots that failed with each, and one robot's reason."""
    waves: Sequence[WaveView] = ()
    robots: Sequence[RobotView] = ()
    hidden: int = 0
    """Number of robots that the report's table leaves out."""
    marks: Markup = Markup()  # noqa: RUF009 - it does not change
    axis: Markup = Markup()  # noqa: RUF009
    failures: Markup = Markup()  # noqa: RUF009
    pauses: Sequence[tuple[datetime, str]] = ()
    """Start and duration of each pause of a deployment."""
    phases: Mapping[Phase, str] = field(default_factory=lambda: PHASES)
    threshold: int = 0
    breached_after: str = ""

    @property
    def is_large(self) -> bool:
        """Whether the chart shows shares of waves instead of single robots."""
        return any(wave.count and not wave.robots for wave in self.waves)


def view_rollout(report: DeploymentReport) -> RolloutPage:
    """Computes the values for the HTML template of a deployment's report."""
    outcome, state = _STATES.get(report.status, (Outcome.UNFINISHED, _state_in_words(report)))
    began_s = report.created_s if report.rollout is None else report.rollout.began_s
    page = RolloutPage(
        report=report,
        outcome=outcome,
        state=state,
        headline=report.failure_reason or report.failure_code or "",
        began_at=_moment(report.created_s),
        took=outcomes.duration(_ended_s(report) - report.created_s),
        counts=(),
        numbers=(),
        facts=_facts(report),
    )
    return page if report.rollout is None else _with_rollout(page, report, report.rollout, began_s)


def _with_rollout(page: RolloutPage, report: DeploymentReport, rollout: Rollout, began_s: float) -> RolloutPage:
    scale = Scale(began_s, last_moment(report, rollout))
    is_large = len(rollout.robots) > MOST_ROWS
    robots = _robots(report, rollout, scale, drawn=not is_large)
    ends = Counter(robot.end for robot in robots.values())
    failed = [robot for robot in robots.values() if robot.code]
    breached_s = chart.breach_of(rollout)
    listed = sorted(robots.values(), key=lambda robot: robot.end.outcome.rank) if is_large else list(robots.values())
    return replace(
        page,
        headline=page.headline or _headline(ends, len(robots)),
        counts=_worst_first(ends),
        numbers=_numbers(report, rollout, list(robots.values())),
        trouble=_trouble(failed),
        waves=[_wave(number, wave, robots, scale, is_large) for number, wave in enumerate(report.waves, 1)],
        robots=listed[:_MOST_LISTED],
        hidden=max(0, len(listed) - _MOST_LISTED),
        marks=chart.marks(rollout, report.closed, scale),
        axis=chart.axis(scale),
        failures=_failures(rollout, scale),
        pauses=[
            (_moment(from_s), outcomes.duration(until_s - from_s))
            for from_s, until_s in chart.pauses_of(rollout.pauses, scale)
        ],
        threshold=rollout.plan.threshold_percentage,
        breached_after="" if breached_s is None else outcomes.duration(breached_s - rollout.began_s),
    )


def _robots(report: DeploymentReport, rollout: Rollout, scale: Scale, *, drawn: bool) -> dict[str, RobotView]:
    waves = {robot: number for number, wave in enumerate(report.waves, 1) for robot in wave}
    version = f"{report.application} {report.version}"
    found: dict[str, RobotView] = {}
    for planned in rollout.plan.robots:
        state = rollout.robots[planned.arn]
        end = end_of(state, active=rollout.status == "InProgress")
        spans = spans_of(state, scale.until_s)
        name = ResourceArn.parse(planned.arn).name
        bar = chart.robot_bar(spans, scale, f"{name}: {end.word}") if drawn else Markup()
        before = planned.installed or ""
        found[planned.arn] = RobotView(
            name=name,
            wave=waves.get(planned.arn),
            end=end,
            step=(state.step or "") if state.order == "fetched" else "",
            before=before,
            after=version if end.outcome is Outcome.PASSED else before,
            took_s=_took_s(state),
            code=(state.failure_code or "") if state.outcome == "failed" else "",
            reason=outcomes.plain(state.failure_reason or "") if state.outcome == "failed" else "",
            spans=spans,
            bar=bar,
        )
    return found


def _took_s(state: RobotDeploymentState) -> float | None:
    if state.offered_s is None or state.finished_s is None or state.finished_s < state.offered_s:
        return None
    return state.finished_s - state.offered_s


def _wave(number: int, wave: Sequence[str], robots: Mapping[str, RobotView], scale: Scale, is_large: bool) -> WaveView:
    members = [robots[robot] for robot in wave]
    ends = _worst_first(Counter(robot.end for robot in members))
    if not is_large:
        return WaveView(number, len(members), ends, members, Markup())
    told = ", ".join(f"{count} {end.word}" for end, count in ends)
    blocks = blocks_of([robot.spans for robot in members], scale)
    return WaveView(number, len(members), ends, (), chart.wave_blocks(blocks, f"Wave {number}: {told}"))


def _failures(rollout: Rollout, scale: Scale) -> Markup:
    unfit = {robot.arn for robot in rollout.plan.robots if robot.unfit_code is not None}
    takes_part = [
        state
        for robot, state in rollout.robots.items()
        if robot not in unfit and (state.gone is None or state.outcome is not None)
    ]
    times = [state.finished_s for state in takes_part if state.outcome == "failed" and state.finished_s is not None]
    return chart.failures(times, len(takes_part), rollout.plan.threshold_percentage, scale)


def _trouble(failed: Sequence[RobotView]) -> list[tuple[str, int, str]]:
    counts = Counter(robot.code for robot in failed)
    examples = {robot.code: robot.reason for robot in reversed(failed)}
    return [(code, count, examples[code]) for code, count in counts.most_common()]


def _worst_first(ends: Counter[RobotEnd]) -> list[tuple[RobotEnd, int]]:
    return sorted(ends.items(), key=lambda each: (each[0].outcome.rank, each[0].word))


def _headline(ends: Counter[RobotEnd], robots: int) -> str:
    good = sum(count for end, count in ends.items() if end.outcome is Outcome.PASSED)
    return f"{good:,} of {robots:,} {'robot' if robots == 1 else 'robots'} in sync"


def _numbers(report: DeploymentReport, rollout: Rollout, robots: Sequence[RobotView]) -> list[tuple[str, str]]:
    good = sum(robot.end.outcome is Outcome.PASSED for robot in robots)
    took = [robot.took_s for robot in robots if robot.took_s is not None and robot.end.outcome is Outcome.PASSED]
    paused_s = sum(
        until_s - from_s
        for from_s, until_s in chart.pauses_of(rollout.pauses, Scale(rollout.began_s, _ended_s(report)))
    )
    numbers = [("robots", f"{len(robots):,}"), ("in sync", f"{good:,}"), ("waves", str(len(report.waves)))]
    if took:
        numbers += [("a robot, median", outcomes.duration(median(took))), ("the slowest", outcomes.duration(max(took)))]
    return [*numbers, ("paused", outcomes.duration(paused_s))] if rollout.pauses else numbers


def _facts(report: DeploymentReport) -> list[Fact]:
    config = report.config
    facts = [
        Fact("Application", f"{report.application}, version {report.version}"),
        Fact("At the same time", f"{config.concurrentDeploymentPercentage or '–'} % of the fleet"),
        Fact("Stops when", f"{config.failureThresholdPercentage or '–'} % have failed"),
        Fact("Time-out of a robot", outcomes.duration(config.robotDeploymentTimeoutInSeconds or 0)),
        *_control(config, report.rollout),
    ]
    if report.delivery is None:
        return facts
    files = [*report.delivery.artifacts.items(), *report.delivery.agent_artifacts.items()]
    for architecture, artifact in files:
        facts.append(Fact(f"File for {architecture}", f"{artifact.file_name}, {outcomes.size(artifact.size_bytes)}"))
        facts.append(Fact("SHA-256", artifact.sha256, is_code=True))
    launch = report.delivery.launch
    facts.append(Fact("Launch", f"{launch.packageName} {launch.launchFile}", is_code=True))
    for name, file in (("Before the launch", launch.preLaunchFile), ("After the launch", launch.postLaunchFile)):
        facts += [Fact(name, file, is_code=True)] if file else []
    variables: Mapping[str, str] = hide_secrets(launch.to_wire()).get("environmentVariables", {})
    return [*facts, *(Fact("Variable", f"{name}={value}", is_code=True) for name, value in variables.items())]


def _control(config: DeploymentConfig, rollout: Rollout | None) -> Iterator[Fact]:
    """Yields the conditions under which the deployment is held back or rolled back."""
    if config.canaryRobots or config.canaryPercentage:
        yield Fact("Canaries", ", ".join(config.canaryRobots or [f"{config.canaryPercentage} %"]))
    if config.requiresApproval:
        is_approved = rollout is not None and rollout.approved_s is not None
        by = f" by {rollout.approved_by}" if rollout is not None and rollout.approved_by else ""
        yield Fact("Approval", f"given{by}" if is_approved else "not given")
    for window in config.maintenanceWindows or ():
        days = ", ".join(day.capitalize() for day in window.days or ()) or "every day"
        lasts = outcomes.duration(window.durationInSeconds)
        yield Fact("Maintenance window", f"{window.startTime} {window.timeZone or 'UTC'}, for {lasts}, {days}")
    if config.onThresholdBreached == "ROLLBACK":
        yield Fact("At the threshold", "robots go back to the version before")


def _state_in_words(report: DeploymentReport) -> str:
    if report.rollout is not None and report.rollout.paused:
        return "paused"
    return "in progress" if report.status == "InProgress" else report.status.lower()


def _ended_s(report: DeploymentReport) -> float:
    ended_s = None if report.rollout is None else report.rollout.ended_s
    return max(report.created_s, report.now_s if ended_s is None else ended_s)


def _moment(at_s: float) -> datetime:
    return datetime.fromtimestamp(at_s, UTC)
