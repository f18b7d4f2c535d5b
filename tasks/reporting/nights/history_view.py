"""View model of the history page of a specification; the template only places its values."""

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from markupsafe import Markup

from ....schemas.reports.history import CellHistory, History, Night, SharesByNight
from ....schemas.reports.run_record import interrupted_briefly
from ....schemas.trial_copies import COPIES
from ....schemas.wire.common import passed_of
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
    """Share that was judged of a run cut short, why it was refused, numbers of jobs that took over results or failed as
    known, number of the run's processes that died, and its comparison with an earlier run; empty if there is nothing to
    say.
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
    def copies(self) -> str:
        """Legend of the numbers of copies in its tables; empty: there are none."""
        rates = (rate.shares.total for rate in (*self.world_rates, *self.requirement_rates))
        nights = (view.night.success for view in self.nights)
        shares = (*rates, *nights, *(cell.history.success for cell in self.cells))
        return COPIES.capitalize() if any(share.copies for share in shares) else ""

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
    """Returns the headline: `3 runs; 18 of 20 jobs passed in the last one`."""
    count, share = len(history.nights), history.nights[-1].success
    runs = f"{count} {'run' if count == 1 else 'runs'}"
    if history.nights[-1].refusal:
        return f"{runs}; the last one was refused before its first step"
    if history.nights[-1].step_error and not history.nights[-1].jobs:
        return f"{runs}; the last one made no jobs"
    if history.nights[-1].is_taken_over:
        return f"{runs}; the last one took over all results of earlier ones"
    if cut_short := history.nights[-1].cut_short:
        return f"{runs}; the last one was {cut_short}, {share.passed} passed"
    if share.rate is None:
        return f"{runs}; nothing was judged in the last one"
    has_trials = history.nights[-1].trials != history.nights[-1].jobs  # whose number says it
    broke = f", {share.errors} broke" if share.errors and not has_trials else ""
    return f"{runs}; {history.nights[-1].passed_in_words} in the last one{broke}"


def _view_night(night: Night, folder: Path) -> NightView:
    link = ""
    if night.report_path is not None:
        link = Path(os.path.relpath(night.report_path, folder)).as_posix()
    states = {"succeeded": Outcome.PASSED, "failed": Outcome.FAILED, "broken": Outcome.BROKEN}
    outcome = states.get(night.state, Outcome.CANCELED if night.state == "canceled" else Outcome.UNFINISHED)
    changed = ", ".join(map(change_in_words, night.changed))
    judged = night.cut_short.partition(", ")[2]
    died = interrupted_briefly(night.interruptions)
    told = filter(None, [judged, night.why_broken, night.jobs_in_words, died, night.against])
    remark = "; ".join(told)
    return NightView(night, link, outcome, changed, remark)


def _title(view: NightView) -> str:
    share = view.night.success
    judged = "judged job" if view.night.trials == view.night.jobs else "judged trial"
    told = "nothing judged" if share.rate is None else passed_of(share.passed, share.passed + share.failed, judged)
    told = view.night.cut_short or told
    told = view.night.why_broken or (view.night.jobs_in_words if view.night.is_taken_over else told)
    changed = f"\nchanged: {view.changed}" if view.changed else ""
    return f"{outcomes.moment(view.night.started_at)}: {told}{changed}"


def _view_cell(cell: CellHistory) -> CellView:
    if cell.same_inputs:
        why = "passed and failed with the same inputs"
    else:
        why = f"changed {cell.changes} times" if cell.unsteady else ""
    return CellView(cell, outcome_strip(cell.outcomes), why)


def _view_rates(rates: Sequence[SharesByNight]) -> list[RateView]:
    return [RateView(each, rate_strip(each.nights)) for each in rates]
