"""Time line of a job, or of one of its recorded trials, from its stored outputs."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path, PurePosixPath
from typing import Any

from pydantic import ValidationError
from starlette.responses import JSONResponse, Response

from ....schemas.documents.simulation_jobs import SimulationJobDocument
from ....schemas.documents.worlds import StoredPlace
from ....schemas.lifecycles import is_terminal
from ....schemas.runs.plan import RunResult
from ....schemas.runs.trial_rows import FailingTrial, TrialsSummary, trial_folder
from ....schemas.wire.errors import ObjectNotFoundError, StorageError
from ....tasks.reporting.drawings.trajectory import finite_path
from ....tasks.runtime.episode.run_results import MAX_RESULT_BYTES, RESULT_FILE
from ....tasks.runtime.episode.run_timeline import (
    MAX_TIMELINE_BYTES,
    TIMELINE_FILE,
    FilmTimes,
    LogSeries,
    RunTimeline,
    read_timeline,
)
from ....tasks.service.service import Service
from ..files import local_file, published, read_small
from ..job_states import JOB
from ..visit import Visit
from .margin_drawings import MarginDrawing, draw_margins
from .recorded_poses import ODOMETRY, SLACK_S, Pose, RecordedPoses, fits, read_poses, thinned
from .run_marks import Mark, first_violation, marks_of

VIDEOS = ("video.mp4", "last-10s.mp4")
"""File names of a run's videos, the one that shows most first: only this one is played."""
_RECORDING = "recording.mcap"
RUNS_ON = "The time line comes when the job has ended: only then its recording is complete."
"""Sentence for the page of a job that has not ended."""


@dataclass(frozen=True)
class JobTimeline:
    """Recorded parts of a run by its simulated time, and sentences about those that are missing."""

    trial: int | None
    """Number of the recorded trial; None: the job itself."""
    trials: Sequence[int]
    """Numbers of all recorded trials; empty for a job without trials."""
    end_s: float
    """Simulated time at the end of the run, in seconds; 0: there is no time line."""
    marks: Sequence[Mark]
    margins: Sequence[MarginDrawing]
    videos: Mapping[str, FilmTimes]
    """Times of the videos that are in step, by file name within the folder."""
    logs: Mapping[str, LogSeries]
    missing: Sequence[str]
    """Sentences about the parts that are missing."""
    result: RunResult | None
    folder: str
    """Folder of the run's files within the job's outputs, with a slash; empty for the job itself."""
    planned: int = 0
    """Number of all trials; 0: the job has none."""
    failing: Mapping[int, FailingTrial] = field(default_factory=dict)
    """First trials that did not pass, by number, with the values of their axes."""

    @property
    def command(self) -> str:
        """Options of `robomaker repro` that run a trial again of which nothing was recorded; empty: it was."""
        return "" if self.trial is None or self.trial in self.trials else f"--trial {self.trial}"

    @property
    def first_violation(self) -> Mark | None:
        """The earliest missed requirement; `None` if there is none."""
        return first_violation(list(self.marks))

    @property
    def no_violation(self) -> str:
        """Sentence for a run without a moment of violation, which may have failed; empty: its result is not known."""
        if self.result is None:
            return ""
        missed = any(item.counts and not item.satisfied for item in self.result.requirements)
        if missed or self.result.verdict in ("FAIL", "ERROR"):
            return "It did not pass, at no single moment."
        return "No violation."


def timeline_of(place: StoredPlace | None, files: Mapping[str, int], service: Service, trial: str = "") -> JobTimeline:
    """Makes the time line of a job that has ended.

    Args:
        place: Place of the job's outputs; None: it has none.
        files: Names and sizes of the outputs.
        service: The service, with its object store.
        trial: Number of the trial to show, as text; empty, or no number of a trial: the first recorded one that did not
            pass, else the first recorded one.
    """
    result = _result(place, RESULT_FILE, files, service)
    summary = TrialsSummary.of(result)
    trials = [] if summary is None else [each for each in summary.recorded if _has_any(files, trial_folder(each))]
    failing = {} if summary is None else {each.trial: each for each in summary.failing}
    asked = _number(trial, trials, 0 if summary is None else summary.planned)
    if summary is not None and (not trials or (asked is not None and asked not in trials)):
        return replace(_not_recorded(asked, trials, summary.planned), failing=failing)
    first = next((each for each in failing if each in trials), trials[0] if trials else None)
    shown = None if summary is None else first if asked is None else asked
    folder = "" if shown is None else f"{trial_folder(shown)}/"
    if shown is not None:
        result = _result(place, folder + RESULT_FILE, files, service)
    recorded = _timeline(place, folder + TIMELINE_FILE, files, service)
    end_s = _end_s(result, recorded)
    if end_s <= 0:
        who = "the run" if shown is None else f"trial {shown}"
        return replace(
            _none(f"There is no time line: {who} left no simulated time."),
            trial=shown,
            trials=trials,
            folder=folder,
            planned=0 if summary is None else summary.planned,
            failing=failing,
        )
    of_run = [name for name in VIDEOS if folder + name in files]
    videos = {name: times for name in of_run if (times := _in_step(name, recorded, result)) is not None}
    return JobTimeline(
        trial=shown,
        trials=trials,
        end_s=end_s,
        marks=[] if result is None else marks_of(result),
        margins=draw_margins([] if recorded is None else recorded.margins, end_s),
        videos=videos,
        logs={} if recorded is None else {each.name: each for each in recorded.logs},
        missing=[*_missing(folder, result, recorded), *_out_of_step(of_run, videos, recorded)],
        result=result,
        folder=folder,
        planned=0 if summary is None else summary.planned,
        failing=failing,
    )


def send_timeline(visit: Visit) -> Response:
    """Sends the poses of a job's time line to its page, as JSON.

    The document has `poses` (lists of simulated time in s, x and y in m, and heading in rad or null), `end_s`, and
    `missing`, sentences about what there is not.
    """
    job = visit.find(JOB, visit.request.path_params["id"])
    document = SimulationJobDocument.of(job)
    if not is_terminal(JOB, job.status):
        return JSONResponse({"poses": [], "end_s": 0.0, "missing": [RUNS_ON]})
    files = published(document.outputs, visit.service)
    timeline = timeline_of(document.outputs, files, visit.service, visit.parameter("trial"))
    found = _poses(document.outputs, timeline, files, visit.service)
    poses = thinned(found.poses, [mark.time_s for mark in timeline.marks])
    missing = [found.missing] if found.missing else []
    return JSONResponse({"poses": [_rounded(each) for each in poses], "end_s": timeline.end_s, "missing": missing})


def _poses(
    place: StoredPlace | None, timeline: JobTimeline, files: Mapping[str, int], service: Service
) -> RecordedPoses:
    """Reads the poses of a run from its recording, else from the places of its result, which have no headings.

    The answer says in a sentence why the recording is not used, if it is not.
    """
    path = [] if timeline.result is None else finite_path(timeline.result)
    missing = "There is no recording."
    name = timeline.folder + _RECORDING
    if place is not None and name in files:
        found = _read(place, name, service)
        if found.poses and fits(found.poses, path, timeline.end_s):
            return found
        missing = found.missing or (
            f"The places on {ODOMETRY} are not those of result.json."
            if timeline.result is not None
            else f"The run left no result.json, so nothing says that {ODOMETRY} is where the robot was."
        )
    places = [Pose(time_s, x, y, None) for time_s, x, y in path]
    more = "The plan has the places of result.json, without headings." if places else "The plan shows no place."
    return RecordedPoses(places, f"{missing} {more}")


def _read(place: StoredPlace, name: str, service: Service) -> RecordedPoses:
    try:
        with local_file(place, name, service) as path:
            about = path.stat()
            return _read_once(path, about.st_size, about.st_mtime_ns)
    except (OSError, StorageError, ObjectNotFoundError):
        return RecordedPoses([], "The recording cannot be read.")


@lru_cache(maxsize=16)
def _read_once(path: Path, size_bytes: int, changed_at: int) -> RecordedPoses:
    """Reads the poses of a recording; cached until its file changes, as pages are looked at again and again."""
    del size_bytes, changed_at
    return read_poses(path)


def _rounded(pose: Pose) -> list[float | None]:
    """Returns a pose for a page: times to the microsecond, places to a tenth of a millimetre."""
    heading = None if pose.yaw_rad is None else round(pose.yaw_rad, 4)
    return [round(pose.time_s, 6), round(pose.x, 4), round(pose.y, 4), heading]


def _in_step(name: str, recorded: RunTimeline | None, result: RunResult | None) -> FilmTimes | None:
    """Returns the times of a video that follows the run; `None` if they are not recorded or do not fit the run."""
    times = None if recorded is None else recorded.videos.get(name)
    if times is None or result is None:
        return times
    slack_s = 2 / times.rate_hz + SLACK_S
    return times if abs(times.ends_s - result.sim_time_s) <= slack_s else None


def _out_of_step(
    videos: Sequence[str], in_step: Mapping[str, FilmTimes], recorded: RunTimeline | None
) -> Iterator[str]:
    """Yields a sentence if the video that is played does not follow; a wrong moment would be worse than none."""
    for name in videos[:1]:
        times = None if recorded is None else recorded.videos.get(name)
        if times is None:
            yield f"{name} does not follow: its simulated times are not recorded."
        elif name not in in_step:
            yield f"{name} does not follow: it ends at {times.ends_s:.2f} s, and the run at another time."


def _missing(folder: str, result: RunResult | None, recorded: RunTimeline | None) -> Iterator[str]:
    if result is None:
        yield "There is no result.json, so no moment is marked."
    if recorded is None:
        yield "There are no margins, and the log does not follow: the run wrote no timeline.json."
        return
    if not recorded.logs:
        none = (
            "a trial that an earlier version recorded has none of its own" if folder else "its times are not recorded"
        )
        yield f"The log does not follow: {none}."
    if not recorded.margins:
        yield "There are no margins along the run."


def _end_s(result: RunResult | None, recorded: RunTimeline | None) -> float:
    """Returns the simulated time in seconds at which a run ended: of its result, or the last one known.

    It is 0 if nothing is known or the time is not finite.
    """
    if result is not None:
        ends = [result.sim_time_s]
    elif recorded is not None:
        series = (*recorded.margins, *recorded.logs)
        ends = [times.ends_s for times in recorded.videos.values()]
        ends += [each.samples[-1][0] for each in series if each.samples]
    else:
        ends = []
    end_s = max(ends, default=0.0)
    return end_s if math.isfinite(end_s) else 0.0  # a program of the run may have written it


def _result(place: StoredPlace | None, name: str, files: Mapping[str, int], service: Service) -> RunResult | None:
    data = read_small(place, name, service, MAX_RESULT_BYTES) if name in files else None
    try:
        return None if data is None else RunResult.model_validate_json(data)
    except ValidationError:  # a program of the run may have written it
        return None


def _timeline(place: StoredPlace | None, name: str, files: Mapping[str, int], service: Service) -> RunTimeline | None:
    data = read_small(place, name, service, MAX_TIMELINE_BYTES) if name in files else None
    return None if data is None else read_timeline(data)


def _has_any(files: Mapping[str, Any], folder: str) -> bool:
    return any(PurePosixPath(name).is_relative_to(folder) for name in files)


def _number(trial: str, trials: Sequence[int], planned: int) -> int | None:
    """Reads the number of a trial from an address; `None`: it is none of them."""
    is_number = trial.isascii() and trial.isdecimal() and len(trial) < 9  # no job has more trials
    return int(trial) if is_number and (int(trial) in trials or int(trial) < planned) else None


def _not_recorded(trial: int | None, trials: Sequence[int], planned: int) -> JobTimeline:
    who = "None of its trials was recorded" if trial is None else f"Trial {trial} was not recorded"
    why = "the first that do not pass are, and those that the specification names as trials.record"
    none = _none(f"{who}, so there is no time line, video or plan: {why}.")
    folder = "" if trial is None else f"{trial_folder(trial)}/"
    return replace(none, trial=trial, trials=trials, planned=planned, folder=folder)


def _none(why: str) -> JobTimeline:
    return JobTimeline(
        trial=None,
        trials=[],
        end_s=0.0,
        marks=[],
        margins=[],
        videos={},
        logs={},
        missing=[why],
        result=None,
        folder="",
    )
