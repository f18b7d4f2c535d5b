"""View models of each world and of a job's trials on the report page."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from markupsafe import Markup
from pydantic import ValidationError

from ...schemas.reports.report import Report, ReportedJob, ReportedWorld, Share
from ...schemas.runs.axes import AS_BUILT, value_text
from ...schemas.runs.axis_kinds.kind import Value
from ...schemas.runs.trial_rows import FailingTrial, TrialCounts, TrialsSummary
from ...schemas.wire.common import passed_of
from ...schemas.worlds.world import Preference, World
from ..results.rates import share_of
from . import outcomes
from .drawings import plan
from .drawings.svg_writing import Frame
from .pictures import Picture, PictureError, embed_picture, embed_svg


@dataclass(frozen=True)
class WorldView:
    """A world in a report's gallery, with its drawing."""

    anchor: str
    world: ReportedWorld
    content: World | None
    """Description of the world; absent if `world.json` cannot be read, `note` says why."""
    note: str
    frame: Frame | None
    fixtures: str
    """Id of the SVG group with walls and furniture."""
    drawing: Markup | None
    plan: Markup | None
    plan_uri: str
    """`data:` URL of the floor plan in the world's bundle, if it cannot be drawn from the description."""
    preview: Picture | None
    preview_note: str
    driven_by: list[int]
    """Numbers of the jobs that used the world."""

    @property
    def wishes(self) -> list[Preference]:
        """The template's preferences for this world's floor plan and interior."""
        return [*self.content.floorplan.wishes, *self.content.wishes] if self.content else []

    @property
    def unmet(self) -> list[Preference]:
        """The template's preferences that this world does not satisfy."""
        return [wish for wish in self.wishes if wish.outcome != "satisfied"]

    @property
    def area_m2(self) -> float:
        """Area of all rooms inside their walls, in m²."""
        return sum(room.floor_m2 for room in self.content.floorplan.rooms) if self.content else 0.0


def view_worlds(report: Report, budget_bytes: int) -> list[WorldView]:
    """Computes the views of a report's worlds, each numbered and with the numbers of the jobs that drove in it.

    Pictures for which `budget_bytes` does not suffice are left out, and the view says so.
    """
    drives: dict[str, list[int]] = {}
    for number, job in enumerate(report.jobs, start=1):
        if job.world_arn and not outcomes.never_began(job):  # those have no card
            drives.setdefault(job.world_arn, []).append(number)
    return [
        _view_world(world, index, drives.get(world.arn, []), budget_bytes)
        for index, world in enumerate(report.worlds, start=1)
    ]


def _view_world(world: ReportedWorld, index: int, driven_by: list[int], budget_bytes: int) -> WorldView:
    content, note = read_world(world.world_json)
    fixtures = f"world-{index}-fixtures"
    frame = drawing = own_plan = None
    plan_uri = ""
    if content is not None:
        frame = Frame.of_world(content)
        drawing = plan.draw_fixtures(content, frame, fixtures)
        own_plan = plan.draw_world_plan(content, frame, fixtures, f"Floor plan of {world.title}")
    else:
        plan_uri, note = _given_plan(world, note)
    preview, preview_note = None, "There is no preview."
    if world.preview_png:
        try:
            preview, preview_note = embed_picture(world.preview_png, budget_bytes), ""
        except PictureError as error:
            preview_note = f"No preview: {error}."
    return WorldView(
        f"world-{index}", world, content, note, frame, fixtures, drawing, own_plan, plan_uri, preview, preview_note,
        driven_by,
    )  # fmt: skip


def read_world(path: Path) -> tuple[World | None, str]:
    """Reads the description of a world (`world.json`) that can be drawn.

    Args:
        path: Path of the file.

    Returns:
        The world, or None and the reason as a sentence.
    """
    try:
        content = World.model_validate_json(path.read_bytes())
    except OSError as error:
        return None, f"{path} cannot be read ({error.strerror})."
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(str(part) for part in first["loc"]) or "the document"
        return None, f"{path} is not a world: {place}: {first['msg']}."
    try:
        Frame.of_world(content)
    except ValueError as error:
        return None, f"{path} cannot be drawn: {error}."
    return content, ""


def _given_plan(world: ReportedWorld, note: str) -> tuple[str, str]:
    if not world.floorplan_svg:
        return "", note
    try:
        return embed_svg(world.floorplan_svg), note
    except PictureError as error:
        return "", f"{note} Its floorplan.svg is not shown: {error}."


MOST_SHOWN = 20
"""Maximum number of trials, and of cells of a grid, that a job's card shows."""


@dataclass(frozen=True)
class TrialsView:
    """Summary of a job's trials for the job's card in a report."""

    planned: int
    stopped_in: int | None
    counts: TrialCounts
    share: Share
    axes: list[Share]
    """Pass rates by axis and part of the axis, in the order of the axes; without axes of a single value."""

    cells: list[Share]
    """Pass rates by cell of a grid of several axes, the worst first; empty if there is only one cell."""

    failing: list[FailingTrial]
    more: int
    """Number of further trials that did not pass, and are not shown."""

    command: str
    """Command line that repeats the first failing trial."""

    @property
    def label(self) -> str:
        """Number of trials that passed, of those that the rate is of: `4 of 6 judged trials passed`.

        Where all were judged, or none, it is `95 of 100 trials passed`.
        """
        judged = self.counts.passed + self.counts.failed
        if judged in (0, self.counts.total):
            return passed_of(self.counts.passed, self.counts.total, "trial")
        return passed_of(self.counts.passed, judged, "judged trial")

    @property
    def unjudged(self) -> str:
        """Number of trials that the rate leaves out: `2 broke, 1 without a verdict`; empty: there are none."""
        left = ((self.counts.errors, "broke"), (self.counts.unjudged, "without a verdict"))
        return ", ".join(f"{count} {words}" for count, words in left if count)


def trials_share(job: ReportedJob) -> Share | None:
    """Returns the pass rate of a job's trials; `None` for a job without trials."""
    summary = TrialsSummary.of(job.result)
    return None if summary is None else _share("trials", summary.counts)


def view_trials(job: ReportedJob) -> TrialsView | None:
    """Computes the summary of a job's trials for a report, with the worst cells; `None` without trials."""
    summary = TrialsSummary.of(job.result)
    if summary is None:
        return None
    shares = [_share(axes_in_words(each.axes) or AS_BUILT, each) for each in summary.cells]
    has_grid = len(shares) > 1 and len({each.axis for each in summary.axes}) > 1
    worst = sorted(shares, key=lambda share: (not share.errors, 1.0 if share.rate is None else share.rate))
    failing = summary.failing[:MOST_SHOWN]
    parts = Counter(each.axis for each in summary.axes)
    return TrialsView(
        planned=summary.planned,
        stopped_in=summary.stopped_in,
        counts=summary.counts,
        share=_share("all trials", summary.counts),
        # What all trials of the job have tells them apart from none.
        axes=[_share(f"{each.axis} {each.part}", each) for each in summary.axes if parts[each.axis] > 1],
        cells=worst[:MOST_SHOWN] if has_grid else [],
        failing=failing,
        more=summary.counts.failed + summary.counts.errors - len(failing),
        command=f"robomaker repro {job.label} --trial {failing[0].trial}" if failing else "",
    )


def axes_in_words(axes: Mapping[str, Value]) -> str:
    """Formats the values of a trial's axes: `SPEED=0.4, mass=1.05`."""
    return ", ".join(f"{name}={value_text(value)}" for name, value in axes.items())


def _share(name: str, counts: TrialCounts) -> Share:
    return share_of(name, counts.passed, counts.failed, counts.errors, copies=counts.copies)
