"""Small SVG charts of a specification's runs: pass rates with intervals, outcomes, bars of rates."""

from collections import Counter
from collections.abc import Iterable, Sequence

from markupsafe import Markup

from ....schemas.reports.history import Night
from ....schemas.reports.report import Share
from ....schemas.reports.run_record import CaseOutcome
from ..drawings.svg_writing import element, number, points

WIDTH, HEIGHT = 720.0, 250.0
"""Width and height of the chart in units of its drawing."""

_LEFT, _RIGHT, _TOP, _BOTTOM = 58.0, 12.0, 12.0, 40.0
_MOST_DATES = 6
_ONE_LINE, _TWO_LINES = 14.0, 26.0
"""Height of the dates above the chart's lower edge: texts are 10 to 24 units high, and times go below the dates."""
_CELL, _GAP, _TALL = 10, 2, 16
# Shape and colour say the same: what passed is low, what did not is high.
_HEIGHTS: dict[CaseOutcome, tuple[int, int]] = {
    "passed": (10, 6), "failed": (0, 16), "broken": (0, 16), "canceled": (7, 2), "unfinished": (7, 2),
    "no verdict": (7, 2),
}  # fmt: skip
_KEYS: dict[CaseOutcome, str] = {
    "passed": "passed", "failed": "failed", "broken": "broken", "canceled": "canceled", "unfinished": "unfinished",
    "no verdict": "unjudged",
}  # fmt: skip


def rate_chart(nights: Sequence[Night], titles: Sequence[str]) -> Markup:
    """Draws the pass rate of each run with its confidence interval; a line marks changed inputs.

    Args:
        nights: Figures of the runs, oldest first.
        titles: Tooltip of each run.
    """
    columns = [
        element("g", element("title", title), *_column(night, index, len(nights)), class_="night")
        for index, (night, title) in enumerate(zip(nights, titles, strict=True))
    ]
    return element(
        "svg",
        *_grid(),
        _line(nights),
        *columns,
        *_dates(nights),
        class_="chart",
        viewBox=f"0 0 {WIDTH:.0f} {HEIGHT:.0f}",
        role="img",
        aria_label="Pass rate of each run with its 95 percent interval; the table below has the numbers",
    )


def outcome_strip(outcomes: Sequence[CaseOutcome | None]) -> Markup:
    """Draws a job's outcomes as a row of boxes, one for each run, oldest first."""
    boxes: dict[str, list[str]] = {}
    for index, outcome in enumerate(outcomes):
        if outcome is not None:
            top, height = _HEIGHTS[outcome]
            boxes.setdefault(_KEYS[outcome], []).append(_box(index, top, height))
    counts = ", ".join(f"{outcomes.count(each)} {each}" for each in _KEYS if each in outcomes)
    return _strip(len(outcomes), counts, ((key, "".join(paths)) for key, paths in boxes.items()))


def rate_strip(nights: Sequence[Share | None]) -> Markup:
    """Draws pass rates as a row of bars, one for each run, oldest first."""
    passed, failed = [], []
    for index, share in enumerate(nights):
        if share is not None and share.rate is not None:
            height = round(share.rate * _TALL, 1)
            passed.append(_box(index, _TALL - height, height))
            failed.append(_box(index, 0, _TALL - height))
    return _strip(len(nights), "Pass rate of each run", (("failed", "".join(failed)), ("passed", "".join(passed))))


def _strip(count: int, label: str, paths: Iterable[tuple[str, str]]) -> Markup:
    return element(
        "svg",
        *(element("path", class_=key, d=path) for key, path in paths),
        class_="nights",
        viewBox=f"0 0 {max(count, 1) * _CELL} {_TALL}",
        preserveAspectRatio="none",
        role="img",
        aria_label=label,
    )


def _box(index: int, top: float, height: float) -> str:
    return f"M{index * _CELL} {top:g}h{_CELL - _GAP}v{height:g}h-{_CELL - _GAP}z"


def _place(index: int, count: int) -> float:
    width = WIDTH - _LEFT - _RIGHT
    return _LEFT + (index + 0.5) * width / count


def _height(rate: float) -> float:
    return _TOP + (1 - rate) * (HEIGHT - _TOP - _BOTTOM)


def _grid() -> list[Markup]:
    lines = []
    for percent in (0, 25, 50, 75, 100):
        y = _height(percent / 100)
        lines.append(element("line", class_="axis", x1=_LEFT, y1=y, x2=WIDTH - _RIGHT, y2=y))
        if percent % 50 == 0:
            lines.append(element("text", f"{percent} %", class_="tick", x=_LEFT - 6, y=y, dy=".35em"))
    return lines


def _line(nights: Sequence[Night]) -> Markup:
    rates = [(index, night.success.rate) for index, night in enumerate(nights)]
    middle = [(_place(index, len(nights)), _height(rate)) for index, rate in rates if rate is not None]
    return element("polyline", class_="trend", points=points(middle))


def _column(night: Night, index: int, count: int) -> list[Markup]:
    x, foot, share = _place(index, count), HEIGHT - _BOTTOM, night.success
    parts = [element("line", class_="mark", x1=x, y1=_TOP, x2=x, y2=foot)] if night.changed else []
    if night.is_taken_over:
        return [*parts, element("circle", class_="taken", cx=x, cy=foot - 5, r=4)]
    if share.rate is None:
        return [*parts, element("path", class_="none", d=f"M{number(x - 4)} {number(foot - 9)}l8 8m0 -8l-8 8")]
    radius = max(2.0, min(5.0, 120 / count))
    if share.low is not None and share.high is not None:
        parts.append(element("line", class_="span", x1=x, y1=_height(share.low), x2=x, y2=_height(share.high)))
    return [
        *parts,
        element("circle", class_="point", cx=x, cy=_height(share.rate), r=radius),
    ]


def _dates(nights: Sequence[Night]) -> list[Markup]:
    count = len(nights)
    every = max(1, -(-count // _MOST_DATES))
    shown = range(count - 1, -1, -every)  # counted from the last, which readers look for
    days = Counter(nights[index].started_at.date() for index in shown)
    y = HEIGHT - (_TWO_LINES if max(days.values(), default=0) > 1 else _ONE_LINE)
    labels = []
    for index in shown:
        at, x = nights[index].started_at, _place(index, count)
        labels.append(element("text", f"{at:%d %b}".lstrip("0"), class_="date", x=x, y=y))
        if days[at.date()] > 1:  # a day alone does not tell them apart
            labels.append(element("text", f"{at:%H:%M}", class_="date", x=x, y=y, dy="1.1em"))
    return labels
