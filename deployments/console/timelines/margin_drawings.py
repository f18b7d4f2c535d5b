"""Drawings of margins along the simulated time of a run."""

from collections.abc import Sequence
from dataclasses import dataclass

from markupsafe import Markup

from ....tasks.reporting.drawings.svg_writing import element, points
from ....tasks.runtime.episode.run_timeline import MarginSeries

WIDTH, HEIGHT = 1000.0, 120.0
"""Size of a drawing in its own units; its width is all of the time line."""
_EDGE = 8.0
"""Room above and below the line, so that its width is not cut off."""


@dataclass(frozen=True)
class MarginDrawing:
    """Margin of a requirement along a run, with its least and last value."""

    requirement: str
    unit: str
    drawing: Markup
    least: float
    last: float
    samples: list[tuple[float, float]]
    """(simulated time in s, margin), which holds until the next one."""


def draw_margins(series: Sequence[MarginSeries], end_s: float) -> list[MarginDrawing]:
    """Draws margins as steps from the start of a run to its end, with a line at 0.

    Args:
        series: The margins; those that are known at the end only, as of a goal that ends the run, are left out.
        end_s: Simulated time of the end.
    """
    return [_draw(each, end_s) for each in series if each.samples and each.samples[0][0] < end_s]


def _draw(series: MarginSeries, end_s: float) -> MarginDrawing:
    values = [value for _, value in series.samples]
    low, high = min(0.0, *values), max(0.0, *values)
    span = (high - low) or 1.0

    def at(time_s: float, value: float) -> tuple[float, float]:
        x = WIDTH * min(max(time_s / end_s, 0.0), 1.0) if end_s > 0 else 0.0
        return x, _EDGE + (HEIGHT - 2 * _EDGE) * (high - value) / span

    drawn: list[tuple[float, float]] = []
    for time_s, value in series.samples:
        if drawn:
            drawn.append((at(time_s, 0.0)[0], drawn[-1][1]))  # a value holds until the next one
        drawn.append(at(time_s, value))
    drawn.append((WIDTH, drawn[-1][1]))
    unit = series.unit or ""
    title = f"Margin of {series.requirement} by simulated time"
    zero = at(0.0, 0.0)[1]
    picture = element(
        "svg",
        element("line", x1=0, x2=WIDTH, y1=zero, y2=zero, class_="zero"),
        element("polyline", points=points(drawn), class_="margin-missed" if values[-1] < 0 else "margin-met"),
        element("line", x1=0, x2=0, y1=0, y2=HEIGHT, class_="cursor"),
        class_="margin-line",
        viewBox=f"0 0 {WIDTH:.0f} {HEIGHT:.0f}",
        preserveAspectRatio="none",
        role="img",
        aria_label=f"{title}: {values[0]:.4g} to {values[-1]:.4g} {unit}".rstrip(),
    )
    return MarginDrawing(series.requirement, unit, picture, min(values), values[-1], series.samples)
