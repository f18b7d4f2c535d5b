"""Drawings of a rollout: bars of robots, blocks of waves, the axis, and the share of robots that have failed.

The height of a bar says the same as its colour: the further a robot is, the taller.
"""

from collections.abc import Iterable, Sequence

from markupsafe import Markup

from ....schemas.rollouts.rollout import Pause, Rollout
from ..drawings.svg import element
from .scale import Scale, percent
from .shares import COLUMNS, Block
from .spans import Phase, Span

BAR, WAVE, PANEL = 18, 44, 72
"""Heights of a robot's row, a wave's row and the panel of failures, in pixels."""

HEIGHTS: dict[Phase, int] = {"offered": 2, "downloading": 6, "installing": 11, "launching": 16}
_GAP = 6
_CELLS = 200
"""Changes of the share of failures that are nearer than this part of the width are drawn as one."""


def marks(rollout: Rollout, closed: Iterable[Pause], scale: Scale) -> Markup:
    """Marks that all rows share: pauses, times without an open window, the moment of the threshold."""
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
    """When the threshold was reached, in seconds since the epoch; nothing: it was not."""
    return rollout.ended_s if rollout.failure_code == "FailureThresholdBreached" else None


def pauses_of(pauses: Iterable[Pause], scale: Scale) -> list[tuple[float, float]]:
    """From when to when no robot got an order; a pause that goes on reaches up to the end of the chart."""
    return [(pause.from_s, scale.until_s if pause.until_s is None else pause.until_s) for pause in pauses]


def robot_bar(spans: Sequence[Span], scale: Scale, label: str) -> Markup:
    """The row of a robot."""
    return _row([_bar(span, scale) for span in spans], BAR, label)


def wave_blocks(blocks: Iterable[Block], label: str) -> Markup:
    """The row of a wave: how many of its robots did what."""
    return _row([_block(block) for block in blocks], WAVE, label)


def axis(scale: Scale) -> Markup:
    """The times above the rows; narrow screens show every other."""
    last = len(scale.ticks()) - 1
    words = []
    for number, (part, text) in enumerate(scale.ticks()):
        place = "first" if number == 0 else "last" if number == last and part > 0.93 else ""
        parity = "odd" if number % 2 else "even"
        words.append(element("text", text, class_=f"tick {place} {parity}".replace("  ", " "), x=percent(part), y="12"))
    return element("svg", *words, class_="time", height="16", aria_hidden="true")


def failures(times_s: Sequence[float], robots: int, threshold_percentage: int, scale: Scale) -> Markup:
    """The share of robots that have failed, and the threshold.

    Args:
        times_s: when each robot failed, in seconds since the epoch.
        robots: how many take part.
        threshold_percentage: at which share the rollout stops, in percent.
        scale: the time.
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
    """Positions at which the number of failures changes, with the new number; it begins with none, at 0."""
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
