"""Formats fleets, rollouts and robots as text lines, once or continuously."""

import shutil
import time
from collections.abc import Callable, Iterator, Sequence
from datetime import datetime
from typing import TextIO

from rich.console import Console
from rich.table import Table
from rich.text import Text

from ...schemas.fleet.rollouts.rollout import RobotDeploymentState, Rollout
from ...schemas.fleet.rollouts.standings import DeploymentStanding, FleetStanding, OrderStanding, RobotStanding
from ...schemas.wire.arns import ResourceArn
from ...schemas.wire.common import counted
from ...tasks.fleet.rollout.statuses import in_words, robot_status
from ...tasks.fleet.views.fleet_standings import Look, deployment_standing
from ...tasks.fleet.views.rollout_tables import notes_of
from ..cli.output.answers import duration

MOST_ROBOTS = 40
"""Limit of rows in a fleet's table unless all are wanted; robots with problems are among them."""

_MOST_FAILURES = 10
_COLUMNS = ("robot", "status", "version", "seen", "kind", "order")
_BAD = ("Failed", "NoResponse")
_SHORT_STEPS = {
    "DownloadingExtracting": "Downloading",
    "ExecutingDownloadCondition": "Condition",
    "ExecutingPreLaunch": "PreLaunch",
    "ExecutingPostLaunch": "PostLaunch",
}


def print_fleets(fleets: Sequence[FleetStanding], stream: TextIO, *, everything: bool, now: datetime) -> None:
    """Prints fleets, each with its latest deployment and a table of its robots.

    Args:
        fleets: The fleets to show.
        stream: Output stream; names are folded to the width of a terminal, and left whole elsewhere.
        everything: Whether large fleets are shown with all their robots.
        now: The time, for when robots were seen.
    """
    console = console_for(stream)
    with console.capture() as printed:
        for number, fleet in enumerate(fleets):
            console.print(*[""] * bool(number), *fleet_lines(fleet), sep="\n")
            if fleet.robots:
                shown = fleet.robots if everything else _chosen(fleet.robots)
                console.print(_table(shown, now))
                console.print(*_failures(shown), sep="", end="")
                if hidden := len(fleet.robots) - len(shown):
                    console.print(Text(f"… and {counted(hidden, 'more robot', ',')}: --all shows them", style="dim"))
    stream.write("".join(f"{line.rstrip()}\n" for line in printed.get().splitlines()))


def console_for(stream: TextIO) -> Console:
    """Makes a text console as wide as the terminal, or unlimited elsewhere."""
    width = shutil.get_terminal_size().columns if stream.isatty() else 10_000
    return Console(file=stream, width=width, highlight=False, soft_wrap=False)


def fleet_lines(fleet: FleetStanding) -> Iterator[Text]:
    """Formats a fleet and its latest deployment as text lines."""
    robots = f"{len(fleet.robots):,} {'robot' if len(fleet.robots) == 1 else 'robots'}"
    yield Text.assemble((fleet.fleet, "bold"), f": {robots}")
    if fleet.deployment is None:
        yield Text("no deployment yet", style="dim")
        return
    yield from deployment_lines(fleet.deployment)


def deployment_lines(deployment: DeploymentStanding) -> Iterator[Text]:
    """Formats a deployment as text lines: application, status, robot counts and failure."""
    name = deployment.job.rpartition("/")[2]
    state = "paused" if deployment.paused and deployment.status == "InProgress" else deployment.status
    style = {"Succeeded": "green", "Failed": "red", "Canceled": "yellow"}.get(state, "cyan")
    yield Text.assemble(
        f"{deployment.application} {deployment.version}: ", (state, style), f"{wave_text(deployment)}  ", (name, "dim")
    )
    if counts := counts_text(deployment):
        yield Text(counts)
    if deployment.failure_code:
        yield Text(f"{deployment.failure_code}: {deployment.failure_reason or ''}".rstrip(": "), style="red")
    for note in notes_of(deployment):
        yield Text(note, style="yellow")


def wave_text(deployment: DeploymentStanding) -> str:
    """Formats the current wave of a deployment: `, wave 2 of 5`; empty after the end."""
    if deployment.waves is None or deployment.status != "InProgress":
        return ""
    return f", wave {deployment.wave} of {deployment.waves}"


def counts_text(deployment: DeploymentStanding) -> str:
    """Formats robot counts of a deployment: `2 succeeded, 1 deploying; 0 % failed of 20 %`."""
    if not deployment.counts:
        return ""
    told = ", ".join(f"{count:,} {word}" for word, count in deployment.counts.items() if count)
    return f"{told}; {deployment.failed_percent or 0:g} % failed, threshold {deployment.threshold_percent} %"


def order_text(order: OrderStanding | None) -> str:
    """Formats a robot's open order: `#7 Downloading 40 %`, `#7 offered`; empty if it has none."""
    if order is None:
        return ""
    if order.state in ("canceling", "refused"):
        return f"#{order.number} {order.state}"
    if order.step is None:
        return f"#{order.number} {order.state}"
    percent = "" if order.percent_done is None else f" {order.percent_done:.0f} %"
    return f"#{order.number} {_SHORT_STEPS.get(order.step, order.step)}{percent}"


def _chosen(robots: Sequence[RobotStanding]) -> Sequence[RobotStanding]:
    """Selects the robots of a large fleet that are shown: failed ones first, then those with an order."""
    if len(robots) <= MOST_ROBOTS:
        return robots
    return sorted(robots, key=lambda robot: (robot.status not in _BAD, robot.order is None))[:MOST_ROBOTS]


def _failures(robots: Sequence[RobotStanding]) -> Iterator[Text]:
    """Yields the reasons why robots of a fleet failed, one line each, below the table."""
    failed = [robot for robot in robots if robot.failure_code is not None]
    for robot in failed[:_MOST_FAILURES]:
        reason = f": {robot.failure_reason}" if robot.failure_reason else ""
        yield Text(f"{robot.robot}: {robot.failure_code}{reason}\n", style="red")
    if len(failed) > _MOST_FAILURES:
        yield Text(f"… and {len(failed) - _MOST_FAILURES:,} more that failed\n", style="red")


def _table(robots: Sequence[RobotStanding], now: datetime) -> Table:
    rows = [_cells(robot, now) for robot in robots]
    table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0), header_style="dim")
    for number, name in enumerate(_COLUMNS):
        if any(row[number].plain for row in rows) or name == "robot":
            table.add_column(name, overflow="fold", no_wrap=name not in ("robot", "version"))
    for row in rows:
        table.add_row(*(cell for number, cell in enumerate(row) if any(each[number].plain for each in rows)))
    return table


def _cells(robot: RobotStanding, now: datetime) -> tuple[Text, ...]:
    style = {"InSync": "green", "Failed": "red", "NoResponse": "red", "Deploying": "cyan"}.get(robot.status, "")
    return (
        Text(robot.robot),
        Text(robot.status, style=style),
        Text(robot.version or "-"),
        Text(_seen(robot, now)),
        Text(robot.kind or ""),
        Text(order_text(robot.order)),
    )


def _seen(robot: RobotStanding, now: datetime) -> str:
    if robot.last_seen is None:
        return "never" if robot.kind else "not enrolled"
    ago_s = max(0, round((now - robot.last_seen).total_seconds()))
    for unit, length_s in (("d", 86400), ("h", 3600), ("min", 60)):
        if ago_s >= length_s:
            return f"{ago_s // length_s} {unit}"
    return f"{ago_s} s"


MOST_LINES = 20
"""Limit of lines for single robots at once; of more changes, only the numbers of robots by state are printed."""

_WAIT_ENDED_TEXTS = {
    "PAUSED": "resumed",
    "APPROVAL": "approved",
    "MAINTENANCE_WINDOW": "its maintenance window is open",
}
"""Texts that say that a cause of waiting has ended."""

HEARTBEAT_S = 60.0
"""Time without a change of a deployment after which a line of counts is printed, in seconds."""


class LineWatcher:
    """Progress display of a deployment that prints a line for each change.

    Args:
        stream: Output stream, such as standard output.
        clock: Seconds on a clock that only runs forward.
    """

    def __init__(self, stream: TextIO, clock: Callable[[], float] = time.monotonic) -> None:
        self._stream = stream
        self._clock = clock
        self._began_s = self._told_s = clock()
        self._before: Look | None = None

    def __call__(self, look: Look) -> None:
        """Prints a deployment's changes since the last look, or a line of counts after a minute without changes."""
        lines = changes(self._before, look)
        self._before = look
        if not lines and self._clock() - self._told_s >= HEARTBEAT_S:
            lines = [counts_text(deployment_standing(look.job, look.rollout, look.at_s)) or look.job.status]
        if lines:
            self._told_s = self._clock()
            at = duration(self._told_s - self._began_s)
            self._stream.write("".join(f"[{at:>12}] {line}\n" for line in lines))
            self._stream.flush()


def changes(before: Look | None, after: Look) -> list[str]:
    """Describes the changes of a deployment between two snapshots, a line each.

    Args:
        before: The earlier snapshot; `None`: the first one.
        after: The later snapshot.
    """
    standing = deployment_standing(after.job, after.rollout, after.at_s)
    lines: list[str] = []
    if before is None:
        fleet = ResourceArn.parse(str(after.job.parent)).name
        lines.append(f"{standing.application} {standing.version} to {fleet}: {standing.job.rpartition('/')[2]}")
    if before is None or (before.job.status != after.job.status and not after.has_ended):
        begun = (
            f", {counted(standing.robots, 'robot', ',')} in {counted(standing.waves, 'wave')}"
            if standing.waves is not None
            else ""
        )
        lines.append(f"{standing.status}{begun}")
    if after.rollout is not None:
        lines += _of_robots(before, after, after.rollout)
        lines += _of_waits(before, standing)
    if after.has_ended:
        why = f": {standing.failure_code}: {standing.failure_reason}" if standing.failure_code else ""
        counts = counts_text(standing)
        lines += [counts] if counts else []
        lines.append(f"{standing.status}{why}")
        lines += notes_of(standing)
    return lines


def _of_waits(before: Look | None, standing: DeploymentStanding) -> list[str]:
    """Describes the causes that a deployment newly waits for, and those that it does not wait for any more.

    Args:
        before: The deployment at the poll before; `None`: this is the first.
        standing: The deployment now.
    """
    old = () if before is None else deployment_standing(before.job, before.rollout, before.at_s).waits
    now = {wait.cause for wait in standing.waits}
    was = {wait.cause for wait in old}
    begun = [in_words(wait, standing.job) for wait in standing.waits if wait.cause not in was]
    return [
        *begun,
        *(
            _WAIT_ENDED_TEXTS[cause]
            for cause in _WAIT_ENDED_TEXTS
            if cause in was - now and standing.status == "InProgress"
        ),
    ]


def _of_robots(before: Look | None, after: Look, rollout: Rollout) -> list[str]:
    old = before.rollout.robots if before is not None and before.rollout is not None else {}
    number = {robot: number for number, wave in enumerate(after.waves, 1) for robot in wave}
    active = rollout.status == "InProgress"
    lines: list[str] = []
    for robot, state in rollout.robots.items():
        said = robot_line(state, active=active)
        earlier = old.get(robot)
        was = None if earlier is None else robot_line(earlier, active=True)
        if said is not None and said != was:
            wave = f" (wave {number[robot]})" if robot in number else ""
            lines.append(f"{ResourceArn.parse(robot).name}{wave}: {said}")
    if len(lines) <= MOST_LINES:
        return lines
    counts = counts_text(deployment_standing(after.job, rollout, after.at_s))
    return [f"{counted(len(lines), 'robot', ',')} changed: {counts}"]


def robot_line(state: RobotDeploymentState, *, active: bool) -> str | None:
    """Formats a robot's state in a deployment in one line; `None` before its turn.

    Args:
        state: The robot.
        active: Whether the rollout is in progress.
    """
    if state.outcome == "failed":
        return f"{robot_status(state, active=active) or 'Failed'}: {state.failure_code}" + (
            f": {state.failure_reason}" if state.failure_reason else ""
        )
    if state.outcome == "succeeded":
        return "InSync"
    if state.gone is not None:
        return "left the fleet" if state.gone == "left" else "deleted"
    if state.order == "fetched":
        return state.step or "fetched its order"
    return f"order {state.action_id}" if state.order == "offered" else None
