"""Pages of finished runs of specifications, from the records in their folders."""

import math
import re
import time
from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from html import unescape
from itertools import islice
from pathlib import Path
from urllib.parse import quote, unquote

from starlette.responses import HTMLResponse, Response

from ...schemas.reports.changes import SinceLastRun
from ...schemas.reports.live_comparison import in_words
from ...schemas.reports.names import newest_first
from ...schemas.reports.run_record import JobRecord, RunRecord
from ...schemas.wire.errors import ConfigurationError, ResourceNotFoundException
from ...tasks.causes.stored import read_why
from ...tasks.comparison.compared_runs import NightRun
from ...tasks.comparison.side_by_side import axes_of
from ...tasks.inspection.run_records import RECORD_NAME, ids_of_runs, is_night, read_record, since_last
from ...tasks.reporting import classify, view_why
from ..spec_runs.spec_runs import Standing, read_standing
from .batches import batches_of_run, record_at
from .rendering import HOME
from .visit import Visit

_MOST_LATEST = 5
_MOST_SHOWN = 40
_MOST_LOOKED_AT = 200
"""Number of the newest runs that are searched for those that a visitor may see."""

_MOST_OTHERS = 40
"""Limit of the runs offered for a comparison, as the record of each is read; the page of the history has more."""
_MOST_OTHERS_SEEN = 20
"""Limit of the runs offered to an access key with restricted resources, as each job of each run is looked up."""

_SEEN_FOR_S = 60.0
"""Seconds after which a page that is followed asks again whether a run may be seen: changed tags count by then."""

_MOST_VALUES = 21
"""Values of an axis that are linked: the first one and twenty others, as in reports."""

_FILE_LINK = re.compile(r'href="(file://[^"]*)"')
_OPEN_PAGE = {"content-security-policy": "sandbox allow-scripts; frame-ancestors 'none'"}


def show_all(visit: Visit, going: Mapping[str, Standing]) -> Response:
    """Web page with the list of latest runs, current ones first."""
    return visit.page("runs.html.j2", runs=_latest(visit, _MOST_SHOWN), going=going)


def show(visit: Visit) -> Response:
    """Web page of one run: changes, batches, and jobs, failures first; of a run that still goes on only its batches.

    Raises ResourceNotFoundException if the visitor may see no such run, ConfigurationError if its record cannot be
    read.
    """
    run_id = visit.request.path_params["id"]
    batches = batches_of_run(run_id, visit)
    if batches and not is_known(run_id, visit):
        return visit.page("open_run.html.j2", run_id=run_id, batches=batches)
    record = find_record(visit)
    jobs = sorted(record.jobs, key=lambda job: classify(job.status, job.failure_code, job.verdict).rank)
    others, since = _others(record, visit), since_before(record, visit)
    return visit.page(
        "run.html.j2",
        run=record,
        answer=in_words(record.against) if record.against else "",
        jobs=[job for job in jobs if not job.known],
        known=[job for job in jobs if job.known],
        outcome_of=lambda job: classify(job.status, job.failure_code, job.verdict),
        batches=batches,
        since=since,
        why=view_why(read_why(_path(visit).parent)),
        job_links={job.label: f"{HOME}/jobs/{quote(job.arn.rpartition('/')[2])}" for job in record.jobs if job.arn},
        has_report=_path(visit).with_name("report.html").is_file(),
        others=others,
        before=_run_before(record, others, since),
        axes=axes_of(record.jobs),
        most_values=_MOST_VALUES,
    )


def _others(record: RunRecord, visit: Visit) -> list[str]:
    """Returns the ids of other nights of the specification that the visitor may see, the newest first."""
    ids = ids_of_runs(visit.service.settings.home / "runs", record.name)
    others = [run_id for run_id in ids if run_id != record.run_id]
    if not visit.sees_all:
        others = others[:_MOST_OTHERS_SEEN]
    found = (other for run_id in others if (other := record_of(run_id, visit)) is not None)
    return [other.run_id for other in islice(filter(is_night, found), _MOST_OTHERS)]


def _run_before(record: RunRecord, others: Sequence[str], since: SinceLastRun | None) -> str:
    """Returns the id of the run that is compared with first; empty: all others are newer."""
    previous = None if since is None else since.previous_run_id
    if previous is not None and previous in others:
        return previous
    return next((run_id for run_id in others if run_id < record.run_id), "")


def since_before(record: RunRecord, visit: Visit) -> SinceLastRun | None:
    """Compares a run with the one before it; `None` for reruns and confined visitors."""
    if not visit.sees_all:
        return None
    return _since(_place(record.run_id, visit), visit.service.settings.home / "runs")


def send_report(visit: Visit) -> Response:
    """Sends the run's HTML report to the browser, isolated because it contains untrusted output.

    Raises ResourceNotFoundException if the visitor may see no such run, or if the run has no report.
    """
    path = _path(visit).with_name("report.html")
    if not path.is_file():
        raise ResourceNotFoundException("the run has no report; `robomaker report` writes it")
    return HTMLResponse(_with_own_links(path.read_text(encoding="utf-8"), find_record(visit)), headers=_OPEN_PAGE)


def _with_own_links(report: str, record: RunRecord) -> str:
    """Returns a report whose links to local files, which browsers cannot open, lead to the jobs' pages instead."""
    jobs = {job.output_uri.rstrip("/"): job.arn.rpartition("/")[2] for job in record.jobs if job.output_uri and job.arn}

    def own(found: re.Match[str]) -> str:
        uri = unescape(found[1])
        places = [(uri[:end], uri[end + 1 :]) for end, letter in enumerate(uri) if letter == "/"]
        for place, name in places:
            if place in jobs:
                return f'href="{HOME}/jobs/{quote(jobs[place])}/files/{quote(unquote(name))}"'
        return f'data-place="{found[1]}"'

    return _FILE_LINK.sub(own, report)


def latest_runs(visit: Visit) -> list[RunRecord]:
    """Returns the records of the newest runs that the visitor may see."""
    return _latest(visit, _MOST_LATEST)


def names_of_seen(visit: Visit) -> list[str]:
    """Returns the names of specifications with runs that the visitor may see."""
    return sorted({record.name for record in _latest(visit, _MOST_LOOKED_AT)})


def _latest(visit: Visit, most: int) -> list[RunRecord]:
    paths = (visit.service.settings.home / "runs").glob(f"*/{RECORD_NAME}")
    newest = newest_first(paths)[:_MOST_LOOKED_AT]
    records = (record for path in newest if (record := record_at(path, path.stat().st_mtime_ns)) is not None)
    return list(islice((record for record in records if sees_run(visit, record)), most))


def sees_run(visit: Visit, record: RunRecord) -> bool:
    """Whether a visitor may see a run: if the visitor ordered it, or may see all its steps and jobs."""
    if visit.sees_all:
        return True
    standing = read_standing(_place(record.run_id, visit).parent)
    if standing is not None and visit.key is not None and standing.key_id == visit.key.id:
        return True
    steps, jobs = ({each.arn for each in some if each.arn} for some in (record.steps, record.jobs))
    return bool(steps) and all(_sees_each(visit, arns) for arns in (steps, jobs))  # of others the first tells


def _sees_each(visit: Visit, arns: set[str]) -> bool:
    return len(visit.seen(visit.service.catalog.get_many(arns, ()).values())) == len(arns)


def _place(run_id: str, visit: Visit) -> Path:
    return visit.service.settings.home / "runs" / run_id / RECORD_NAME


def is_known(name: str, visit: Visit) -> bool:
    """Whether there is a run of that id, which the visitor may see."""
    path = _record_path(name, visit)
    if path is None:
        return False
    return visit.sees_all or (
        (record := record_at(path, path.stat().st_mtime_ns)) is not None and sees_run(visit, record)
    )


def _record_path(name: str, visit: Visit) -> Path | None:
    """Returns the path of the record of a run that has ended; `None` if there is none."""
    # Longer names are none: the file system would refuse them with an error of its own.
    is_name = "/" not in name and name not in ("", ".", "..") and len(name.encode()) <= 255
    path = _place(name, visit)
    return path if is_name and path.is_file() else None


def record_of(run_id: str, visit: Visit) -> RunRecord | None:
    """Returns the record of a run that has ended; `None` if there is none that the visitor may see."""
    if not is_known(run_id, visit):
        return None
    path = _place(run_id, visit)
    return record_at(path, path.stat().st_mtime_ns)


class SeenRecords:
    """Records of runs for a page that is followed: whether the visitor may see a run is asked once a minute.

    The catalog is asked for each job of a run where the key sees only some resources, and the page is made every two
    seconds.

    Args:
        visit: The visit.
        clock: Seconds, from any moment.
    """

    def __init__(self, visit: Visit, clock: Callable[[], float] = time.monotonic) -> None:
        self._visit = visit
        self._clock = clock
        self._asked: dict[str, tuple[float, bool]] = {}

    def of(self, run_id: str) -> RunRecord | None:
        """Returns the record of a run that has ended; `None` if there is none that the visitor may see."""
        path = _record_path(run_id, self._visit)
        if path is None:  # not remembered: the run may end any moment
            return None
        now_s = self._clock()
        asked_s, is_seen = self._asked.get(run_id, (-math.inf, False))
        if now_s - asked_s >= _SEEN_FOR_S:
            is_seen = is_known(run_id, self._visit)
            self._asked[run_id] = now_s, is_seen
        return record_at(path, path.stat().st_mtime_ns) if is_seen else None


def job_in_run(arn: str, run_id: str | None, visit: Visit) -> JobRecord | None:
    """Returns the record of a job in its run, with its name there; `None` if it has none, or its run goes on."""
    record = record_of(run_id, visit) if run_id else None
    jobs = [] if record is None else record.jobs
    return next((job for job in jobs if job.arn == arn), None)


def _path(visit: Visit) -> Path:
    name = visit.request.path_params["id"]
    if not is_known(name, visit):
        raise ResourceNotFoundException(f"there is no run {name} in the data home of this server")
    return _place(name, visit)


def find_record(visit: Visit) -> RunRecord:
    """Returns the record of the run that the visitor asks for.

    Raises:
        ResourceNotFoundException: The visitor may see no such run.
        ConfigurationError: The record cannot be read.
    """
    path = _path(visit)
    record = record_at(path, path.stat().st_mtime_ns)
    if record is None:
        raise ConfigurationError(f"the record of {path.parent.name} cannot be read")
    return record


@lru_cache(maxsize=16)
def _since(path: Path, runs: Path) -> SinceLastRun | None:
    """Compares a run with the one before it; `None` for a rerun. Cached, since no run before it changes any more."""
    record = read_record(path)
    return None if record.rerun_of else since_last(NightRun.of(record), runs)
