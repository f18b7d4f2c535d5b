"""View of the causes of failures, in pages and as lines of text."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TypeGuard

from markupsafe import Markup

from ...schemas.reports.causes import CellPlot, MarginPlot, TestedLift, Why
from .drawings.causes import draw_cells, draw_margins

_MOST_LIFTS = 40
_MOST_LINES = 5
_FEWEST_TOLD = 2
"""Failures from which on their groups are told: of one, its own lines say all there is."""


@dataclass(frozen=True)
class WhyView:
    """Causes of failures with their drawings, for a page."""

    found: Why
    cells: list[tuple[CellPlot, Markup]]
    margins: list[tuple[MarginPlot, Markup]]
    lifts: list[TestedLift]
    """The tested lifts with the smallest p-values."""


def view_why(why: Why | None) -> WhyView | None:
    """Computes the view of a run's causes of failures, with plots and the surest lifts; `None` if none are told."""
    if not is_told(why):
        return None
    # The best region of two axes may be that of one of them: told apart by nothing, the surer one is listed.
    surest: dict[tuple[str, str], TestedLift] = {}
    for each in sorted(why.lifts, key=lambda each: (each.p_value, -each.lift)):
        surest.setdefault((each.group, each.region), each)
    return WhyView(
        found=why,
        cells=[(plot, draw_cells(plot)) for plot in why.cell_plots],
        margins=[(plot, draw_margins(plot)) for plot in why.margin_plots],
        lifts=list(surest.values())[:_MOST_LIFTS],
    )


def is_told(why: Why | None) -> TypeGuard[Why]:
    """Whether groups of a run's failures say more than its jobs do."""
    return why is not None and why.failed >= _FEWEST_TOLD


def why_in_lines(why: Why | None, most: int = _MOST_LINES) -> Iterator[str]:
    """Yields a line for all failures, if they share a cause or none has one, and one for each of the largest groups.

    Groups with a claim come first; each line ends with how to repeat one of its trials.

    Args:
        why: Causes of a run's failures; None: there are none.
        most: Number of groups.
    """
    if not is_told(why):
        return
    leading = why.leading
    if leading is not None:
        yield "; ".join(filter(None, (why.size, why.headline, leading.details, leading.command)))
    groups = sorted(why.groups, key=lambda each: not each.claims)
    for group in groups[:most]:
        yield f"{group.told(why.reason_of(group))}; {group.command}"
    if leading is None and len(groups) > 1 and why.copies:
        yield why.size
    if len(groups) > most:
        yield f"and {len(groups) - most} more groups of failures"
    if not any(group.claims for group in groups):
        yield from why.refused[:1]
