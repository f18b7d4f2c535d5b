"""SVG charts of a rollout: bars of robots, blocks of waves, failure shares of large fleets, and the time axis."""

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from markupsafe import Markup

from ....schemas.fleet.rollouts.rollout import Pause, Rollout
from ...reporting import outcomes
from ...reporting.drawings.svg_writing import element
from .robot_phases import PHASES, Phase, Span

_STEPS_S = (
    0.5, 1, 2, 5, 10, 15, 30, 60, 120, 300, 600, 900, 1800, 3600, 7200, 14400, 21600, 43200, 86400, 172800, 432000,
)  # fmt: skip
_MOST_TICKS = 6


@dataclass(frozen=True)
class Scale:
    """Time axis of a deployment's chart: its start and end in seconds since the epoch."""

    from_s: float
    until_s: float

    @property
    def length_s(self) -> float:
        """Length of a deployment chart's time axis in seconds; always above 0."""
        return max(self.until_s - self.from_s, 0.1)

    def part(self, at_s: float) -> float:
        """Returns the position of a time on the axis, from 0 at the left to 1 at the right."""
        return min(1.0, max(0.0, (at_s - self.from_s) / self.length_s))

    def at(self, at_s: float) -> str:
        """Returns the position of a time as an SVG coordinate, in percent of the width."""
        return percent(self.part(at_s))

    def width(self, from_s: float, until_s: float) -> str:
        """Returns the width of a time span as an SVG length, in percent."""
        return percent(self.part(until_s) - self.part(from_s))

    def ticks(self) -> list[tuple[float, str]]:
        """Returns at most seven axis ticks at round times: position from 0 to 1, and label."""
        step_s = next((step for step in _STEPS_S if self.length_s / step <= _MOST_TICKS), self.length_s / _MOST_TICKS)
        times = [number * step_s for number in range(int(self.length_s / step_s) + 1)]
        return [(min(1.0, time_s / self.length_s), _in_words(time_s)) for time_s in times]


def _in_words(time_s: float) -> str:
    return outcomes.duration(time_s).replace(".0 s", " s") if time_s else "0"


def percent(part: float) -> str:
    """Formats a fraction of the width for SVG, in percent with at most two decimals: `12.5%`."""
    return f"{100 * part:.2f}".rstrip("0").rstrip(".") + "%"


COLUMNS = 120
"""Number of columns into which the chart's time axis is divided."""


@dataclass(frozen=True)
class Block:
    """A rectangle in a deployment's chart: robots that are in the same phase for some columns."""

    phase: Phase
    column: int
    columns: int
    below: float
    """Share of the wave's robots that are drawn below the chart's rectangle."""

    share: float
    """Share of the wave's robots that are in this phase."""


def blocks_of(robots: Sequence[Iterable[Span]], scale: Scale) -> list[Block]:
    """Converts the phases of a wave's robots to stacked rectangles for the chart.

    Args:
        robots: The spans of each.
        scale: The time.
    """
    columns = _columns(robots, scale)
    blocks: list[Block] = []
    for phase in PHASES:
        begun, before = 0, (0, 0)
        for column in range(COLUMNS + 1):
            now = _height(columns, column, phase)
            if now == before:
                continue
            if before[1]:
                below, count = (each / len(robots) for each in before)
                blocks.append(Block(phase, begun, column - begun, below, count))
            begun, before = column, now
    return blocks


def _columns(robots: Sequence[Iterable[Span]], scale: Scale) -> list[Counter[Phase]]:
    """Counts the robots of a wave in each phase, in the middle of each column of the chart."""
    columns: list[Counter[Phase]] = [Counter() for _ in range(COLUMNS)]
    for spans in robots:
        for span in spans:
            first, last = (round(scale.part(at_s) * COLUMNS) for at_s in (span.from_s, span.until_s))
            for column in range(first, min(last, COLUMNS)):
                columns[column][span.phase] += 1
    return columns


def _height(columns: Sequence[Counter[Phase]], column: int, phase: Phase) -> tuple[int, int]:
    """Returns the numbers of robots drawn below a phase and in it, in a column; 0 after the last column."""
    if column == len(columns):
        return 0, 0
    counts = columns[column]
    below = 0
    for each in reversed(PHASES):  # those that are furthest lie at the bottom
        if each == phase:
            break
        below += counts[each]
    return (below, counts[phase]) if counts[phase] else (0, 0)


BAR, WAVE, PANEL = 18, 44, 72
"""Heights of a robot's row, a wave's row and the panel of failures, in pixels."""

HEIGHTS: dict[Phase, int] = {"offered": 2, "downloading": 6, "installing": 11, "launching": 16}
_GAP = 6
_CELLS = 200
"""Resolution of the failure curve, in cells over the width: changes within one cell are drawn as one."""


def marks(rollout: Rollout, closed: Iterable[Pause], scale: Scale) -> Markup:
    """Draws the marks common to all rows: pauses, closed maintenance windows, and the failure threshold."""
    parts = [
        element("rect", class_=kind, x=scale.at(begin_s), y="0", width=scale.width(begin_s, end_s), height="100%")
        for kind, pauses in (("closed", closed), ("pause", rollout.pauses))
        for begin_s, end_s in pauses_of(pauses, scale)
    ]
    if (breached_s := breach_of(rollout)) is not None:
        at = scale.at(breached_s)
        parts.append(element("line", class_="breach", x1=at, x2=at, y1="0", y2="100%"))
    return element("g", *parts, id="rollout-marks")


def breach_of(rollout: Rollout) -> float | None:
    """Returns when a deployment to a fleet failed as too many robots had, in seconds since the epoch; else `None`."""
    return rollout.ended_s if rollout.failure_code == "FailureThresholdBreached" else None


def pauses_of(pauses: Iterable[Pause], scale: Scale) -> list[tuple[float, float]]:
    """Returns start and end of each pause on the chart; an open pause reaches to the end."""
    return [(pause.from_s, scale.until_s if pause.until_s is None else pause.until_s) for pause in pauses]


def robot_bar(spans: Sequence[Span], scale: Scale, label: str) -> Markup:
    """Draws a robot's row in the chart."""
    return _row([_bar(span, scale) for span in spans], BAR, label)


def wave_blocks(blocks: Iterable[Block], label: str) -> Markup:
    """Draws a wave's row in the chart: how many of its robots are in which phase."""
    return _row([_block(block) for block in blocks], WAVE, label)


def axis(scale: Scale) -> Markup:
    """Draws the time labels above the chart; narrow screens show every second one."""
    last = len(scale.ticks()) - 1
    words = []
    for number, (part, text) in enumerate(scale.ticks()):
        place = "first" if number == 0 else "last" if number == last and part > 0.93 else ""
        parity = "odd" if number % 2 else "even"
        words.append(element("text", text, class_=f"tick {place} {parity}".replace("  ", " "), x=percent(part), y="12"))
    return element("svg", *words, class_="time", height="16", aria_hidden="true")


def failures(times_s: Sequence[float], robots: int, threshold_percentage: int, scale: Scale) -> Markup:
    """Draws the curve of the share of failed robots, and the failure threshold.

    Args:
        times_s: Time at which each robot failed, in seconds since the epoch.
        robots: Number of robots that take part.
        threshold_percentage: Share of failed robots at which the rollout stops, in percent.
        scale: The time.
    """
    steps = _steps(sorted(times_s), scale)
    shares = [100 * count / max(robots, 1) for _, count in steps]
    top = min(100.0, 1.25 * max(threshold_percentage, *shares))
    height = [PANEL - _GAP - (PANEL - 2 * _GAP) * share / top for share in shares]
    lines: list[Markup] = []
    ends = [*(part for part, _ in steps[1:]), 1.0]
    for number, ((part, _), end, y) in enumerate(zip(steps, ends, height, strict=True)):
        if number:
            x = percent(part)
            lines.append(element("line", class_="failing", x1=x, x2=x, y1=height[number - 1], y2=y))
        lines.append(element("line", class_="failing", x1=percent(part), x2=percent(end), y1=y, y2=y))
    limit = PANEL - _GAP - (PANEL - 2 * _GAP) * threshold_percentage / top
    lines.append(element("line", class_="limit", x1="0", x2="100%", y1=limit, y2=limit))
    label = f"{shares[-1]:.3g} percent of the robots failed; the threshold is {threshold_percentage} percent"
    return _row(lines, PANEL, label)


def _steps(times_s: Sequence[float], scale: Scale) -> list[tuple[float, int]]:
    """Returns the positions at which the number of failures changes, with the new number; begins with (0, 0)."""
    steps = {0.0: 0}
    for count, at_s in enumerate(times_s, 1):
        steps[round(scale.part(at_s) * _CELLS) / _CELLS] = count
    return sorted(steps.items())


def _bar(span: Span, scale: Scale) -> Markup:
    height = HEIGHTS[span.phase]
    return element(
        "rect",
        class_=span.phase,
        x=scale.at(span.from_s),
        y=(BAR - height) / 2,
        width=scale.width(span.from_s, span.until_s),
        height=height,
    )


def _block(block: Block) -> Markup:
    return element(
        "rect",
        class_=block.phase,
        x=percent(block.column / COLUMNS),
        y=f"{100 * (1 - block.below - block.share):.2f}%",
        width=percent(block.columns / COLUMNS),
        height=f"{100 * block.share:.2f}%",
    )


def _row(parts: Sequence[Markup], height: int, label: str) -> Markup:
    common = element("use", href="#rollout-marks")
    return element("svg", common, *parts, class_="row", height=height, role="img", aria_label=label)
