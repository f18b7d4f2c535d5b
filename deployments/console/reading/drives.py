"""The world in which a job drives, and the path that its robot has driven so far on this machine."""

from pathlib import Path

from markupsafe import Markup

from ....schemas.documents.simulation_jobs import SimulationJobDocument
from ....schemas.wire.errors import RobomakerError
from ....tasks.inspection.reports import report_of_world
from ....tasks.reporting import WorldView, draw_drive, draw_open_plan, view_worlds
from ....tasks.runtime.episode.driven_path import PATH_FILE, points_of
from ....tasks.service.service import Service
from ....tasks.simulations.planning.run_plans import world_arn
from .notes import note_of

DRIVE = "drive"
"""Id of the part of the plan that has the path."""

_MOST_BYTES = 512 * 1024
_MOST_POINTS = 500


def world_of(document: SimulationJobDocument, service: Service) -> WorldView | None:
    """The world in which a job drives; `None`: in none, or in one that is not there any more."""
    arn = world_arn(document.request)
    if arn is None:
        return None
    try:
        [view] = view_worlds(report_of_world(arn, service), budget_bytes=0)
    except RobomakerError:  # what the page has besides is worth more
        return None
    return None if view.content is None or view.frame is None else view


def open_plan(view: WorldView | None, job_id: str) -> Markup | None:
    """The plan on which a page shows the path."""
    if view is None or view.content is None or view.frame is None:
        return None
    title = f"Plan of {view.world.label} with the path of {job_id} so far"
    return draw_open_plan(view.content, view.frame, view.fixtures, title, DRIVE)


def drive_in(view: WorldView | None, run: Path | None) -> str:
    """The path that the robot has driven so far, drawn; empty: none is noted on this machine."""
    path = points_of(note_of(run, PATH_FILE, _MOST_BYTES).decode(errors="replace"))
    if view is None or view.frame is None or not path:
        return ""
    step = -(-len(path) // _MOST_POINTS)
    return draw_drive([*path[:-1:step], path[-1]], view.frame)
