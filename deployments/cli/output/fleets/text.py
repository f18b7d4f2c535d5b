"""Fleets, deployments and robots as text for a terminal."""

import shutil
from collections.abc import Iterator, Sequence
from datetime import datetime
from typing import TextIO

from rich.console import Console
from rich.table import Table
from rich.text import Text

from .....schemas.rollouts.standings import DeploymentStanding, FleetStanding, OrderStanding, RobotStanding
from .....tasks.fleet.views.notes import notes_of

MOST_ROBOTS = 40
"""Rows of a fleet's table unless all are wanted; those that need a look are among them."""

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
    """Prints fleets: each with its latest deployment and a table of its robots.

    Args:
        fleets: what to show.
        stream: where to; names are folded to the width of a terminal, and left whole elsewhere.
        everything: whether large fleets are shown with all their robots.
        now: the time, for when robots were seen.
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
                    console.print(Text(f"… and {hidden:,} more robots: --all shows them", style="dim"))
    stream.write("".join(f"{line.rstrip()}\n" for line in printed.get().splitlines()))


def console_for(stream: TextIO) -> Console:
    """A console as wide as the terminal; elsewhere as wide as needed, so that nothing is cut for other programs."""
    width = shutil.get_terminal_size().columns if stream.isatty() else 10_000
    return Console(file=stream, width=width, highlight=False, soft_wrap=False)


def fleet_lines(fleet: FleetStanding) -> Iterator[Text]:
    """A fleet and its latest deployment, in a few lines."""
    robots = f"{len(fleet.robots):,} {'robot' if len(fleet.robots) == 1 else 'robots'}"
    yield Text.assemble((fleet.fleet, "bold"), f": {robots}")
    if fleet.deployment is None:
        yield Text("no deployment yet", style="dim")
        return
    yield from deployment_lines(fleet.deployment)


def deployment_lines(deployment: DeploymentStanding) -> Iterator[Text]:
    """A deployment in a few lines: what, how it stands, how many robots stand how, and why it failed."""
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
    """`, wave 2 of 5` while it goes on."""
    if deployment.waves is None or deployment.status != "InProgress":
        return ""
    return f", wave {deployment.wave} of {deployment.waves}"


def counts_text(deployment: DeploymentStanding) -> str:
    """`2 succeeded, 1 deploying; 0 % failed of 20 %`; empty where it has not begun."""
    if not deployment.counts:
        return ""
    told = ", ".join(f"{count:,} {word}" for word, count in deployment.counts.items() if count)
    return f"{told}; {deployment.failed_percent or 0:g} % failed, threshold {deployment.threshold_percent} %"


def order_text(order: OrderStanding | None) -> str:
    """`#7 Downloading 40 %`; `#7 offered` before the robot has fetched it."""
    if order is None:
        return ""
    if order.state in ("canceling", "refused"):
        return f"#{order.number} {order.state}"
    if order.step is None:
        return f"#{order.number} {order.state}"
    percent = "" if order.percent_done is None else f" {order.percent_done:.0f} %"
    return f"#{order.number} {_SHORT_STEPS.get(order.step, order.step)}{percent}"


def _chosen(robots: Sequence[RobotStanding]) -> Sequence[RobotStanding]:
    """The robots of a large fleet that are shown: at first those that failed, then those with an order."""
    if len(robots) <= MOST_ROBOTS:
        return robots
    return sorted(robots, key=lambda robot: (robot.status not in _BAD, robot.order is None))[:MOST_ROBOTS]


def _failures(robots: Sequence[RobotStanding]) -> Iterator[Text]:
    """Why robots failed, a line each, below the table."""
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
