"""View model of the page that shows two runs, or two cells of an axis, side by side."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from ....schemas.reports.changes import MetricChange
from ....schemas.reports.comparison import Comparison
from ....schemas.reports.run_record import JobRecord
from .. import outcomes
from ..outcomes import Outcome
from .beside import DrawnWorld, PairView


@dataclass(frozen=True)
class ComparedSide:
    """One of the two sides of the page: a run, or the jobs of one value of an axis."""

    letter: str
    """`A` or `B`."""
    title: str
    """Name in the legends: when the run began, or the value; with what tells it from the other side."""
    run_id: str
    alone: Sequence[JobRecord] = ()
    """Its jobs that have no partner."""


@dataclass(frozen=True)
class PairLine:
    """A pair that has no card on the page, as a row of a table."""

    title: str
    jobs: tuple[JobRecord, JobRecord]

    @property
    def outcomes(self) -> tuple[Outcome, Outcome]:
        """The outcomes of a pair's two jobs, that of the first run's job first."""
        before, after = (outcomes.classify(job.status, job.failure_code, job.verdict) for job in self.jobs)
        return before, after


@dataclass(frozen=True)
class ComparisonPage:
    """All values that the HTML template of a comparison needs."""

    name: str
    """Name of the specification."""
    before: ComparedSide
    after: ComparedSide
    comparison: Comparison | None
    """Answer of the comparison; `None`: two cells of an axis, whose answer is in the run's report."""
    differences: Sequence[str]
    """Inputs that differ between the two sides, in words."""
    pairs: int
    """Number of all pairs."""
    changed: int
    """Number of the pairs whose two jobs ended differently."""
    not_run: int
    """Number of the pairs of which a side was not run to its end."""
    first: int
    """Number of the first card, from 1."""
    cards: Sequence[PairView]
    worlds: Sequence[DrawnWorld]
    """Worlds of the cards."""
    lines: Sequence[PairLine] = ()
    """Further pairs, which have no card."""
    earlier: str = ""
    """URL of the cards before these; empty: there are none."""
    later: str = ""
    """URL of the cards after these; empty: there are none."""
    video_folder: str = ""
    """Name of the folder beside the page that has some of its videos; empty: there is none."""
    job_link: Callable[[str], str] = field(default=lambda _: "")
    """Function that returns the URL of a job's page by the job's id; empty where there is none."""
    run_link: Callable[[str], str] = field(default=lambda _: "")
    """Function that returns the URL of a run's page by the run's id; empty where there is none."""
    trial_link: Callable[[int, int], str] = field(default=lambda *_: "")
    """Function that returns the URL of this page with a trial chosen, by numbers of pair and trial; else empty."""

    @property
    def sides(self) -> tuple[ComparedSide, ComparedSide]:
        """The two sides of a comparison, the first run's first."""
        return self.before, self.after

    @property
    def last(self) -> int:
        """Number of the last card on a comparison's page."""
        return self.first + len(self.cards) - 1

    @property
    def alone(self) -> list[tuple[str, JobRecord, Outcome]]:
        """Jobs without a partner, each with the letter of its side and its end."""
        return [
            (side.letter, job, outcomes.classify(job.status, job.failure_code, job.verdict))
            for side in self.sides
            for job in side.alone
        ]

    @property
    def bars(self) -> list[tuple[str, MetricChange, tuple[float, float, float] | None]]:
        """Margins and metrics that both runs have: name with unit, change, and its interval scaled to a plot."""
        if self.comparison is None:
            return []
        named = [(f"margin of {each.name}", each.unit or "", each) for each in self.comparison.margins]
        named += [(*outcomes.name_and_unit(each.name), each) for each in self.comparison.metrics]
        return [(f"{name}, {unit}" if unit else name, each, metric_bar(each)) for name, unit, each in named]


def metric_bar(metric: MetricChange) -> tuple[float, float, float] | None:
    """Scales a metric's change and its interval to a plot from -100 to 100; `None`: it has no interval."""
    if metric.low is None or metric.high is None:
        return None
    reach = max(abs(metric.low), abs(metric.high)) * 1.1
    if not math.isfinite(reach) or reach == 0:
        return None
    low, middle, high = (100 * value / reach for value in (metric.low, metric.difference, metric.high))
    return low, middle, high
