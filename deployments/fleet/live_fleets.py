"""Live display of a rollout: redrawn on a terminal, or printed as lines."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import TextIO

from rich.console import Console, Group
from rich.live import Live
from rich.table import Table
from rich.text import Text

from ...schemas.fleet.rollouts.rollout import Rollout
from ...schemas.wire.arns import ResourceArn
from ...tasks.fleet.rollout.download_progress import remaining_s
from ...tasks.fleet.views.fleet_standings import Look, deployment_standing
from ..cli.output.answers import duration
from ..cli.output.progress import is_animated
from .fleets_in_words import LineWatcher, deployment_lines, robot_line

_BAR_WIDTH = 40
_MOST_ROBOTS = 12
_MOST_FAILURES = 5
_PARTS = (("succeeded", "green", "━"), ("failed", "red", "✗"), ("canceled", "yellow", "╌"), ("deploying", "cyan", "╾"))


Show = Callable[[Look], None]


@contextmanager
def fleet_watcher(stream: TextIO, environ: Mapping[str, str]) -> Iterator[Show]:
    """Chooses the progress display of a deployment: animated on a terminal, else plain lines.

    Args:
        stream: Output stream, such as standard output.
        environ: Environment variables; `CI` and a dumb `TERM` mean lines.
    """
    if not is_animated(stream, environ):
        yield LineWatcher(stream)
        return
    with live_block(stream) as show:
        yield show


@contextmanager
def live_block(stream: TextIO) -> Iterator[Show]:
    """Draws a deployment's progress on a terminal inside the `with` block."""
    console = Console(file=stream, highlight=False)
    with Live(console=console, auto_refresh=False, transient=False) as live:
        yield lambda look: live.update(render(look), refresh=True)


def render(look: Look) -> Group:
    """Renders a deployment's progress: bar, deploying robots, latest failures."""
    standing = deployment_standing(look.job, look.rollout, look.at_s)
    fleet = ResourceArn.parse(str(look.job.parent)).name
    lines = [Text.assemble((fleet, "bold"), f", for {duration(look.at_s - look.job.created_at.timestamp())}")]
    lines += deployment_lines(standing)
    if look.rollout is None:
        return Group(*lines)
    bar = _bar(standing.counts, standing.robots)
    return Group(*lines[:2], bar, *lines[2:], _deploying(look, look.rollout), *_failures(look.rollout))


def _bar(counts: dict[str, int], total: int) -> Text:
    """Draws a progress bar whose parts differ in sign and colour; each part that is not empty is visible."""
    bar, left = Text(), _BAR_WIDTH
    for word, style, sign in _PARTS:
        count = counts.get(word, 0)
        width = min(left, max(1, round(_BAR_WIDTH * count / max(total, 1)))) if count else 0
        bar.append(sign * width, style=style)
        left -= width
    bar.append("·" * left, style="dim")
    done = sum(counts.get(word, 0) for word in ("succeeded", "failed", "canceled"))
    return bar.append(f"  {done:,}/{total:,}")


def _deploying(look: Look, rollout: Rollout) -> Table:
    table = Table.grid(padding=(0, 2, 0, 0))
    table.add_column(overflow="ellipsis", no_wrap=True, max_width=30)
    table.add_column(no_wrap=True)
    table.add_column(no_wrap=True)
    busy = [(robot, state) for robot, state in rollout.robots.items() if state.is_open]
    for robot, state in busy[:_MOST_ROBOTS]:
        percent = (
            "" if state.percent_done is None or state.step != "DownloadingExtracting" else f"{state.percent_done:.0f} %"
        )
        left_s = remaining_s(state, look.at_s)
        left = f", {duration(left_s)} to go" if left_s else ""
        said = robot_line(state, active=True) or ""
        table.add_row(Text(ResourceArn.parse(robot).name), Text(said, style="cyan"), Text(f"{percent}{left}"))
    if len(busy) > _MOST_ROBOTS:
        table.add_row(Text(f"… and {len(busy) - _MOST_ROBOTS:,} more", style="dim"))
    return table


def _failures(rollout: Rollout) -> Iterator[Text]:
    failed = [(state.finished_s or 0.0, robot, state) for robot, state in rollout.robots.items() if state.failure_code]
    for _, robot, state in sorted(failed, key=lambda each: each[0])[-_MOST_FAILURES:]:
        reason = f": {state.failure_reason.splitlines()[0]}" if state.failure_reason else ""
        said = f"✗ {ResourceArn.parse(robot).name}: {state.failure_code}{reason}"
        yield Text(said, style="red", no_wrap=True, overflow="ellipsis")
