"""Pages of simulation jobs: the list, and the page of one with plan, requirements, log, recording and video."""

import os
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any
from urllib.parse import quote

from markupsafe import Markup
from starlette.responses import Response

from ...schemas.documents.simulation_jobs import JobInBrief, SimulationJobDocument
from ...schemas.documents.worlds import StoredPlace
from ...schemas.lifecycles import is_terminal
from ...schemas.runs.provenance import PROVENANCE_FILE
from ...schemas.wire.common import without_escapes
from ...schemas.wire.globs import Glob
from ...tasks.catalog import Resource
from ...tasks.files.untrusted_files import open_left
from ...tasks.inspection.reports import report_of_job
from ...tasks.jobs.job_owners import standing_of
from ...tasks.reporting import view_report
from ...tasks.reporting.drawings.plan import draw_bare_path, draw_job_plan
from ...tasks.reporting.drawings.svg_writing import Frame
from ...tasks.reporting.drawings.trajectory import finite_path
from ...tasks.reporting.outcomes import plain, times_by_part, times_with_videos, why_no_video_of_trial
from ...tasks.reporting.report_view import Page
from ...tasks.simulations.outputs.upload_files import visit_matches
from ..endpoint.origins import is_loopback
from .files import published, send_file, tail_of
from .job_states import JOB, job_line, named_in_run
from .rendering import HOME, render
from .run_records import JobsInRuns, batch_name, is_known, record_of, run_name
from .streams import Parts
from .timelines.job_timelines import RUNS_ON, VIDEOS, JobTimeline, timeline_of
from .timelines.live_runs import DRIVE, drive_in, live_view_of, open_plan, world_of
from .timelines.log_lines import LogLine, lines_of
from .visit import Visit

_PAGE_LENGTH = 50
_MOST_LOGS = 8
_GROWING_LOGS = Glob("/output/logs/*.log")
_MOST_LOG_BYTES = 32_768
_EVERY_S = 0.7


@dataclass(frozen=True)
class Log:
    """The end of a log file, for a job's web page."""

    name: str
    lines: list[LogLine]


def show_all(visit: Visit) -> Response:
    """Web page with the list of simulation jobs."""
    filters = {name: [value] for name in ("status", "tag") if (value := visit.parameter(name))}
    page = visit.listed(JOB, filters, _PAGE_LENGTH, JobInBrief.members())
    in_runs = JobsInRuns(lambda run_id: record_of(run_id, visit))
    jobs = ((job, JobInBrief.of(job).spec_run) for job in visit.seen(page.resources))
    lines = [named_in_run(job_line(job), in_runs.find(job.arn, run_id)) for job, run_id in jobs]
    return visit.page("jobs.html.j2", lines=lines, next_token=page.next_token)


def show(visit: Visit) -> Response:
    """Web page of one simulation job, whether it runs or has ended.

    Raises ResourceNotFoundException if the visitor may see no such job.
    """
    job = visit.find(JOB, visit.request.path_params["id"])
    document = SimulationJobDocument.of(job)
    has_ended = is_terminal(JOB, job.status)
    files = published(document.outputs, visit.service)
    view = view_report(report_of_job(job.arn, visit.service)) if has_ended else None
    timeline = timeline_of(document.outputs, files, visit.service, visit.parameter("trial")) if has_ended else None
    card = view and view.jobs[0]
    in_runs = JobsInRuns(lambda run_id: record_of(run_id, visit))
    in_run = in_runs.find(job.arn, document.spec_run)
    record = in_runs.record_of(document.spec_run) if document.spec_run else None
    line = named_in_run(job_line(job), in_run)
    links = f"{HOME}/jobs/{quote(job.id)}/files/"
    is_batch_seen = visit.sees(job.parent)
    world = None if has_ended else world_of(document, visit.service)
    if card is not None:
        shown = [replace(file, link=links + quote(file.name) if file.name in files else "") for file in card.files]
        told = card.job.model_copy(update={"known": in_run.known, "name": line.name} if in_run else {})
        card = replace(
            card, job=told, title=told.title, files=shown, poster=None if "video.mp4" in files else card.poster, log=""
        )
    drive = card if card is not None and timeline is not None and timeline.trial is None and timeline.end_s else None
    trial_plan = _trial_plan(view, timeline)
    names: dict[str, str] = dict(
        zip(("simulation", "videos of failures"), times_with_videos([document.request]), strict=True)
    )
    if card is not None and (trial_plan or (drive is not None and drive.plan)):  # it stands beside the video
        card = replace(card, plan=None, plan_note="")
    return visit.page(
        "job.html.j2",
        job=job,
        line=line,
        times=times_by_part({names.get(part, part): time_s for part, time_s in line.parts_s.items()}),
        standing=standing_of(job, visit.service),
        document=document,
        has_ended=has_ended,
        has_run=PROVENANCE_FILE in files or _keeps_records(job, document, visit),
        view=view,
        card=card,
        drive=drive,
        world=world,
        open_plan=open_plan(world, job.id),
        links=links,
        timeline=timeline,
        timeline_later=RUNS_ON,
        trial_plan=trial_plan,
        frame=_frame(view, timeline),
        videos=[f"{timeline.folder}{name}" for name in VIDEOS if f"{timeline.folder}{name}" in files]
        if timeline
        else [],
        no_video=_no_video(document, timeline),
        files=files,
        logs=_logs(document.outputs, files, timeline, visit) if timeline else [],
        batch_id=(job.parent or "").rpartition("/")[2] if is_batch_seen else "",
        batch_name=batch_name(job.parent or "", document.spec_run or "", record) if is_batch_seen else "",
        run_name=run_name(document.spec_run or "", record),
        run_id=document.spec_run if is_batch_seen or is_known(document.spec_run or "", visit) else "",
    )


def follow(visit: Visit) -> Response:
    """Streams status, path and log of a running job to the browser, which reloads the page when the job has ended.

    The live view is offered to browsers on this machine only. Raises ResourceNotFoundException if the visitor may see
    no such job.
    """
    found = visit.find(JOB, visit.request.path_params["id"])
    arn = found.arn
    world = world_of(SimulationJobDocument.of(found), visit.service)
    shown = ""
    logs: dict[str, int] = {}
    last: list[str] = []
    parts = Parts()
    client = visit.request.client
    is_here = client is not None and is_loopback(client.host)  # live views are served to this machine only

    def look() -> Iterator[tuple[str, Any]]:
        nonlocal shown
        job = visit.service.catalog.get(arn, kind=JOB)
        if job.status != shown:
            shown = job.status
            yield "status", job.status
        run = _run_folder(job, visit)
        live_view = live_view_of(run) if is_here else ""
        elsewhere = job.status == "Running" and (run is None or not run.is_dir())
        told = render("live_view.html.j2", live_view=live_view, elsewhere=elsewhere)
        owner = render("owner.html.j2", standing=standing_of(job, visit.service))
        yield from parts.news({"live-view": told, "owner": owner, DRIVE: drive_in(world, run)})
        if text := _new_lines(run, logs, last):
            yield "log", text
        if is_terminal(JOB, job.status):
            yield "reload", None
            yield "end", None

    return visit.follow(look, _EVERY_S)


def send(visit: Visit) -> Response:
    """Sends one of a job's output files to the browser.

    Raises ResourceNotFoundException if the visitor may see no such job.
    """
    job = visit.find(JOB, visit.request.path_params["id"])
    return send_file(SimulationJobDocument.of(job).outputs, visit.request.path_params["name"], visit.service)


def _logs(place: StoredPlace | None, files: dict[str, int], timeline: JobTimeline, visit: Visit) -> list[Log]:
    """Returns the ends of the logs of a job, or of the recorded trial that the time line shows.

    Lines have simulated times where these are recorded. The list is empty if nothing was stored.
    """
    if place is None:
        return []
    of_trial = [name for name in files if name.startswith(f"{timeline.folder}logs/")]
    folder = timeline.folder if of_trial else ""  # one that an earlier version recorded has none of its own
    times = timeline.logs if folder == timeline.folder else {}
    names = [name for name, size in files.items() if name.startswith(f"{folder}logs/") and size][:_MOST_LOGS]
    return [
        Log(
            name,
            lines_of(
                tail_of(place, name, visit.service, _MOST_LOG_BYTES), files[name], times.get(name.removeprefix(folder))
            ),
        )
        for name in names
    ]


def _trial_plan(view: Page | None, timeline: JobTimeline | None) -> Markup | None:
    """Draws the plan of the trial that the time line shows; `None` for a job whose own card has its plan."""
    if view is None or timeline is None or timeline.trial is None or timeline.result is None:
        return None
    title = f"Path of trial {timeline.trial}"
    world = next(iter(view.worlds), None)
    if world is None or world.content is None or world.frame is None:
        return draw_bare_path(timeline.result, title)
    return draw_job_plan(world.content, world.frame, world.fixtures, timeline.result, title)


def _no_video(document: SimulationJobDocument, timeline: JobTimeline | None) -> str:
    """Returns why a job, or the trial that the time line shows, has no video, and how its next run gets one."""
    result = timeline and timeline.result
    if result is not None and (problem := result.extra.get("video_error")):
        return f"No video could be made: {plain(str(problem))}."
    how = "`video: on-failure` in the request makes one of each run that fails, `video: always` one of every run."
    if timeline is not None and timeline.trial is not None:
        how = "" if document.video == "always" else " `video: always` in the request makes one of every recorded trial."
        why = why_no_video_of_trial(document.video, "" if result is None else result.verdict)
        return f"There is no video of trial {timeline.trial}: {why}.{how}"
    if document.video == "none":
        return f"There is no video: the request asks for none. {how}"
    if document.video == "on-failure" and result is not None and result.verdict == "PASS":
        asked = "There is no video: the request asks for one of failures only (`video: on-failure`)."
        return f"{asked} `video: always` makes one of every run."
    return "There is no video: none is stored."


def _frame(view: Page | None, timeline: JobTimeline | None) -> Frame | None:
    """Returns the frame of the plan on which the time line shows the robot; `None` without a plan."""
    if view is None or timeline is None or timeline.result is None:
        return None
    world = next(iter(view.worlds), None)
    if world is not None and world.frame is not None:
        return world.frame
    path = finite_path(timeline.result)
    return Frame.around((x, y) for _, x, y in path) if path else None


def _keeps_records(job: Resource, document: SimulationJobDocument, visit: Visit) -> bool:
    """Returns whether this machine has the records of a run whose outputs could not be stored."""
    run = _run_folder(job, visit)
    return document.outputs is None and run is not None and (run / "output" / PROVENANCE_FILE).is_file()


def _run_folder(job: Resource, visit: Visit) -> Path | None:
    """Returns the folder of a job's run on this machine; `None` if the job has no run."""
    run_id = JobInBrief.of(job).run_id
    return visit.service.settings.home / "jobs" / job.id / run_id if run_id else None


def _new_lines(run: Path | None, read: dict[str, int], last: list[str]) -> str:
    """Returns the new lines in the logs of a run since they were last read.

    An application may have put a link in the place of the folder or of a log, so links are not followed.
    """
    parts: list[str] = []

    def add(folder: int, name: str, _: str) -> None:
        try:
            with open_left(Path(name), folder) as file:
                size = os.fstat(file.fileno()).st_size
                start = read.get(name, max(0, size - _MOST_LOG_BYTES))
                file.seek(start)
                data = file.read(_MOST_LOG_BYTES)
        except OSError:
            return
        if (name not in read and (not size or len(read) == _MOST_LOGS)) or not data:
            return
        read[name] = start + len(data)
        if last != [name]:
            last[:] = [name]
            parts.append(f"— logs/{name} —\n")
        parts.append(_clean(data.decode(errors="replace")))

    if run is not None:
        visit_matches(run, _GROWING_LOGS, add)
    return "".join(parts)


def _clean(text: str) -> str:
    return "\n".join(without_escapes(line) for line in text.split("\n"))
