"""Live state of a run on this machine: its notes, its live view, and the path that its robot has driven."""

import json
import re
from pathlib import Path

from markupsafe import Markup

from ....schemas.documents.simulation_jobs import SimulationJobDocument
from ....schemas.wire.errors import RobomakerError
from ....schemas.wire.globs import Glob
from ....tasks.files.untrusted_files import open_left
from ....tasks.inspection.reports import report_of_world
from ....tasks.reporting import WorldView, draw_drive, draw_open_plan, view_worlds
from ....tasks.runtime.episode.progress import PATH_FILE, points_of
from ....tasks.runtime.video.video_settings import LIVE_VIEW_FILE
from ....tasks.service.service import Service
from ....tasks.simulations.outputs.upload_files import visit_matches
from ....tasks.simulations.planning.run_plans import world_arn

_APPLICATION_FOLDER = "work"  # below that of the run


def note_of(run: Path | None, name: str, most_bytes: int) -> bytes:
    """Reads a small file that a running application has written; links are not followed.

    Args:
        run: The folder of the run; `None`: it is not on this machine.
        name: Name of the file.
        most_bytes: Most bytes of it that are read.

    Returns:
        First bytes of the file; empty if it cannot be read.
    """
    found: list[bytes] = []

    def read(folder: int, file_name: str, _: str) -> None:
        try:
            with open_left(Path(file_name), folder) as file:
                found.append(file.read(most_bytes))
        except OSError:
            return

    if run is not None:
        visit_matches(run, Glob(f"/{_APPLICATION_FOLDER}/{name}"), read)
    return b"".join(found)


_MOST_NOTE_BYTES = 1024
_ADDRESS = re.compile(r"http://127\.0\.0\.1:[0-9]{1,5}/")


def live_view_of(run: Path | None) -> str:
    """Returns the URL of a run's live view; empty if it has none.

    Args:
        run: The folder of the run; `None`: it is not on this machine.
    """
    try:
        url = json.loads(note_of(run, LIVE_VIEW_FILE, _MOST_NOTE_BYTES))["url"]
    except (ValueError, KeyError, TypeError):
        return ""
    return url if isinstance(url, str) and _ADDRESS.fullmatch(url) else ""


DRIVE = "drive"
"""HTML element id of the part of the plan that shows the robot's path."""

_MOST_BYTES = 512 * 1024
_MOST_POINTS = 500


def world_of(document: SimulationJobDocument, service: Service) -> WorldView | None:
    """Returns the drawing of the world that a job drives in; `None` if it has none, or if none can be read or drawn."""
    arn = world_arn(document.request)
    if arn is None:
        return None
    try:
        [view] = view_worlds(report_of_world(arn, service), budget_bytes=0)
    except RobomakerError:  # what the page has besides is worth more
        return None
    return None if view.content is None or view.frame is None else view


def open_plan(view: WorldView | None, job_id: str) -> Markup | None:
    """Draws the floor plan on which a job's web page shows the robot's path; `None` if the world has no drawing."""
    if view is None or view.content is None or view.frame is None:
        return None
    title = f"Plan of {view.world.title} with the path of {job_id} so far"
    return draw_open_plan(view.content, view.frame, view.fixtures, title, DRIVE)


def drive_in(view: WorldView | None, run: Path | None) -> str:
    """Draws the robot's path so far in a running job; empty if the path, or the plan it is on, is unknown here."""
    path = points_of(note_of(run, PATH_FILE, _MOST_BYTES).decode(errors="replace"))
    if view is None or view.frame is None or not path:
        return ""
    step = -(-len(path) // _MOST_POINTS)
    return draw_drive([*path[:-1:step], path[-1]], view.frame)
