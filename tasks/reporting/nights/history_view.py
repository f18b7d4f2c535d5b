"""View model of the history page of a specification; the template only places its values."""

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from markupsafe import Markup

from ....schemas.reports.history import CellHistory, History, Night, SharesByNight
from ....schemas.reports.run_record import interrupted_briefly
from .. import outcomes
from ..outcomes import Outcome
from .changes import change_in_words
from .charts import outcome_strip, rate_chart, rate_strip

_MOST_CELLS = 500
"""Maximum number of rows in the table of jobs; those that need attention come first."""


@dataclass(frozen=True)
class NightView:
    """A row of the table of runs on the history page."""

    night: Night
    link: str
    """Relative URL of the run's report; empty if there is none."""
    outcome: Outcome
    changed: str
    remark: str
    """Share that was judged of a run cut short, number of the run's processes that died, and its comparison with an
    earlier run; empty if there is nothing to say.
    """


@dataclass(frozen=True)
class CellView:
    """A row of the table of jobs on the history page."""

    history: CellHistory
    strip: Markup
    why_unsteady: str


@dataclass(frozen=True)
class RateView:
    """A row of the tables of worlds and of requirements on the history page."""

    shares: SharesByNight
    strip: Markup


@dataclass(frozen=True)
class HistoryPage:
    """All values that the HTML template of the history page needs."""

    history: History
    headline: str
    state: str
    chart: Markup
    nights: list[NightView]
    """Rows of the runs, the latest first."""
    cells: list[CellView]
    cells_hidden: int
    world_rates: list[RateView]
    requirement_rates: list[RateView]

    @property
    def latest(self) -> NightView:
        """Row of the latest run."""
        return self.nights[0]

    @property
    def failing(self) -> list[CellView]:
        """Jobs that fail in the latest run."""
        return [cell for cell in self.cells if cell.history.since is not None]

    @property
    def unsteady(self) -> list[CellView]:
        """Flaky jobs, whose results cannot be relied on."""
        return [cell for cell in self.cells if cell.history.unsteady]


def view_history(history: History, folder: Path) -> HistoryPage:
    """Computes the values for the HTML page of a specification's history.

    Args:
        history: History of at least one run.
        folder: Folder that will contain the page, to which links are relative.
    """
    nights = [_view_night(night, folder) for night in history.nights]
    last = history.nights[-1]
    return HistoryPage(
        history=history,
        headline=_headline(history),
        state=last.state,
        chart=rate_chart(history.nights, [_title(view) for view in nights]),
        nights=nights[::-1],
        cells=[_view_cell(cell) for cell in history.cells[:_MOST_CELLS]],
        cells_hidden=max(0, len(history.cells) - _MOST_CELLS),
        world_rates=_view_rates(history.worlds),
        requirement_rates=_view_rates(history.requirements),
    )


def _headline(history: History) -> str:
    """Returns the headline: `3 runs; 18 of 20 passed in the last one`."""
    count, share = len(history.nights), history.nights[-1].success
    runs = f"{count} {'run' if count == 1 else 'runs'}"
    if share.rate is None:
        return f"{runs}; nothing was judged in the last one"
    if cut_short := history.nights[-1].cut_short:
        return f"{runs}; the last one was {cut_short}, {share.passed} passed"
    broke = f", {share.errors} broke" if share.errors else ""
    return f"{runs}; {_passed(history.nights[-1])} in the last one{broke}"


def _passed(night: Night) -> str:
    """Returns the number of passed jobs or trials of a run: `18 of 20 passed`."""
    of = f"{night.success.passed} of {night.success.passed + night.success.failed}"
    return f"{of} {'passed' if night.trials == night.jobs else 'trials passed'}"


def _view_night(night: Night, folder: Path) -> NightView:
    link = ""
    if night.report_path is not None:
        link = Path(os.path.relpath(night.report_path, folder)).as_posix()
    states = {"succeeded": Outcome.PASSED, "failed": Outcome.FAILED, "broken": Outcome.BROKEN}
    outcome = states.get(night.state, Outcome.CANCELED if night.state == "canceled" else Outcome.UNFINISHED)
    changed = ", ".join(map(change_in_words, night.changed))
    judged = night.cut_short.partition(", ")[2]
    remark = "; ".join(filter(None, [judged, interrupted_briefly(night.interruptions), night.against]))
    return NightView(night, link, outcome, changed, remark)


def _title(view: NightView) -> str:
    share = view.night.success
    rate = "nothing judged" if share.rate is None else _passed(view.night)
    changed = f"\nchanged: {view.changed}" if view.changed else ""
    return f"{outcomes.moment(view.night.started_at)}: {rate}{changed}"


def _view_cell(cell: CellHistory) -> CellView:
    if cell.same_inputs:
        why = "passed and failed with the same inputs"
    else:
        why = f"changed {cell.changes} times" if cell.unsteady else ""
    return CellView(cell, outcome_strip(cell.outcomes), why)


def _view_rates(rates: Sequence[SharesByNight]) -> list[RateView]:
    return [RateView(each, rate_strip(each.nights)) for each in rates]
