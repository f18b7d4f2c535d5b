"""Drawings of causes as SVG: margins over an axis, and failure rates over an axis or two, with their intervals."""

from collections.abc import Callable, Iterator, Sequence

from markupsafe import Markup

from ....schemas.reports.causes import CellPlot, MarginPlot, PlotCell
from .svg_writing import element

_WIDTH = 380
"""Units of all drawings: letters of 12 units are 12 pixels where a phone shows a drawing over its whole width."""
_ROW = 26
_LABELS, _COUNTS = 132, 56
"""Width for labels at the left, and for numbers at the right."""
_HEAD = 30
_MARGIN_HEIGHT, _LEFT, _FOOT, _TOP = 210, 68, 40, 12
"""Heights and widths around a plot; nine letters, as `-0.000195` has, are 60 units wide."""
_SMALL_LETTER = 5.6
"""Mean width of a letter of the heads of columns."""


def draw_cells(plot: CellPlot) -> Markup:
    """Draws failure rates with their intervals: one row for each part of an axis, or a field for each cell of two."""
    return _draw_fields(plot) if len(plot.axes) > 1 else _draw_rows(plot)


def draw_margins(plot: MarginPlot) -> Markup:
    """Draws the margins of trials over an axis, with the median and the middle 80 % of each part of it."""
    xs = [x for x, _ in plot.points] + [end for part in plot.parts for end in part[:2]]
    ys = [y for _, y in plot.points] + [y for part in plot.parts for y in part[2:]] + [0.0]
    across, up = _scale(xs, _LEFT, _WIDTH - 12), _scale(ys, _MARGIN_HEIGHT - _FOOT, _TOP)
    bottom = _MARGIN_HEIGHT - _FOOT
    unit = f" {plot.unit}" if plot.unit else ""
    parts = [
        element(
            "g",
            element(
                "rect",
                element("title", f"{low_x:.4g} to {high_x:.4g}: {middle:.3g}{unit}, 80 % {low:.3g} to {high:.3g}"),
                class_="middle",
                x=across(low_x),
                y=up(high),
                width=max(2.0, across(high_x) - across(low_x)),
                height=max(1.0, up(low) - up(high)),
            ),
            element(
                "line",
                class_="median",
                x1=across(low_x),
                x2=max(across(high_x), across(low_x) + 2),
                y1=up(middle),
                y2=up(middle),
            ),
        )
        for low_x, high_x, low, middle, high in plot.parts
    ]
    dots = [
        element("circle", class_="dot missed" if y < 0 else "dot", cx=across(x), cy=up(y), r=2) for x, y in plot.points
    ]
    frame = [
        element("line", class_="axis", x1=_LEFT, x2=_WIDTH - 12, y1=bottom, y2=bottom),
        element("line", class_="limit", x1=_LEFT, x2=_WIDTH - 12, y1=up(0.0), y2=up(0.0)),
        *(_x_label(across(x), bottom + 16, f"{x:.3g}", anchor) for x, anchor in _ends(xs)),
        *(_y_label(up(y), f"{y:.3g}") for y in _apart([min(ys), 0.0, max(ys)], up)),
        _x_label((_LEFT + _WIDTH - 12) / 2, bottom + 33, _cut(plot.axis, 40), "middle"),
    ]
    title = f"Margin of {plot.requirement}{unit and ' in' + unit} over {plot.axis}; below 0 it was missed"
    return _svg(_MARGIN_HEIGHT, title, [*parts, *dots, *frame])


def _scale(values: Sequence[float], start: float, end: float) -> Callable[[float], float]:
    low, high = min(values), max(values)
    span = (high - low) or 1.0
    return lambda value: start + (value - low) / span * (end - start)


def _ends(xs: Sequence[float]) -> list[tuple[float, str]]:
    return [(min(xs), "start"), (max(xs), "end")] if min(xs) < max(xs) else [(xs[0], "start")]


def _apart(values: Sequence[float], up: Callable[[float], float]) -> Iterator[float]:
    """Yields the values whose labels do not touch each other; 0 always stays, and comes first."""
    kept = [0.0]
    for value in values:
        if all(abs(up(value) - up(other)) > 14 for other in kept):
            kept.append(value)
    yield from kept


def _draw_rows(plot: CellPlot) -> Markup:
    high = max(cell.high for cell in plot.cells)
    across = _scale([0.0, high or 1.0], _LABELS, _WIDTH - _COUNTS)
    height = _HEAD + _ROW * len(plot.cells) + 4
    drawn = [
        element("line", class_="axis", x1=_LABELS, x2=_LABELS, y1=_HEAD - 6, y2=height),
        _x_label(_LABELS, 14, "0", "middle"),
        _x_label(_WIDTH - _COUNTS, 14, f"{100 * high:.0f} % fail so", "middle"),
        _x_label(0, 14, _cut(plot.axes[0], 18), "start"),
    ]
    for place, cell in enumerate(plot.cells):
        y = _HEAD + _ROW * (place + 0.5)
        drawn += [
            element(
                "g",
                element("title", _words(cell)),
                *_row(cell, y, across(cell.low), across(cell.high), across(cell.rate)),
            ),
        ]
    return _svg(height, f"{plot.group} by {plot.axes[0]}: share of the trials that fail so, 95 % intervals", drawn)


def _row(cell: PlotCell, y: float, low: float, high: float, rate: float) -> Iterator[Markup]:
    yield _x_label(0, y + 4, _cut(cell.part, 20), "start")
    yield element("line", class_="span", x1=low, x2=high, y1=y, y2=y)
    yield element("circle", class_="point", cx=rate, cy=y, r=4.5)
    yield _x_label(_WIDTH, y + 4, f"{cell.failed}/{cell.trials}", "end")


def _draw_fields(plot: CellPlot) -> Markup:
    rows = list(dict.fromkeys(cell.part for cell in plot.cells))
    columns = list(dict.fromkeys(cell.other_part for cell in plot.cells))
    left, wide, tall = 96, (_WIDTH - 96) / len(columns), 44
    most = max(cell.rate for cell in plot.cells) or 1.0
    letters = max(4, int(wide / _SMALL_LETTER))
    drawn = [
        _x_label(0, 32, _cut(plot.axes[0], 14), "start"),
        _x_label((left + _WIDTH) / 2, 12, _cut(plot.axes[1], 36), "middle"),
        *(_column(left + wide * (at + 0.5), _cut(part, letters)) for at, part in enumerate(columns)),
        *(_x_label(0, 42 + tall * (at + 0.55), _cut(part, 15), "start") for at, part in enumerate(rows)),
    ]
    for cell in plot.cells:
        x, y = left + wide * columns.index(cell.other_part), 40 + tall * rows.index(cell.part)
        middle = x + wide / 2
        shade = f"{0.08 + 0.5 * cell.rate / most:.2f}"
        drawn.append(
            element(
                "g",
                element("title", _words(cell)),
                element("rect", class_="field", fill_opacity=shade, x=x + 1, y=y + 1, width=wide - 2, height=tall - 2),
                element("text", f"{100 * cell.rate:.0f} %", class_="rate", x=middle, y=y + 19, text_anchor="middle"),
                element(
                    "text", f"{100 * cell.low:.0f}–{100 * cell.high:.0f}", x=middle, y=y + 35, text_anchor="middle"
                ),
            )
        )
    words = f"{plot.group} by {plot.axes[0]} and {plot.axes[1]}: share of the trials that fail so, 95 % intervals"
    return _svg(44 + tall * len(rows), words, drawn)


def _column(x: float, text: str) -> Markup:
    return element("text", text, class_="column", x=x, y=32, text_anchor="middle")


def _words(cell: PlotCell) -> str:
    place = f"{cell.part}, {cell.other_part}" if cell.other_part else cell.part
    return f"{place}: {cell.failed} of {cell.trials}, 95 % {100 * cell.low:.0f} to {100 * cell.high:.0f} %"


def _x_label(x: float, y: float, text: str, anchor: str) -> Markup:
    return element("text", text, x=x, y=y, text_anchor=anchor)


def _y_label(y: float, text: str) -> Markup:
    return element("text", text, x=_LEFT - 6, y=y + 4, text_anchor="end")


def _cut(text: str, letters: int) -> str:
    return text if len(text) <= letters else f"{text[: letters - 1]}…"


def _svg(height: float, title: str, children: Sequence[Markup]) -> Markup:
    return element(
        "svg", element("title", title), *children, class_="cause-plot", viewBox=f"0 0 {_WIDTH} {height:.0f}", role="img"
    )
