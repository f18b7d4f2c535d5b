"""Pages of finished runs of specifications, from the records in their folders."""

import re
from collections.abc import Mapping, Sequence
from functools import lru_cache
from html import unescape
from itertools import islice
from pathlib import Path
from urllib.parse import quote, unquote

from starlette.responses import HTMLResponse, Response

from ...schemas.reports.changes import SinceLastRun
from ...schemas.reports.live_comparison import in_words
from ...schemas.reports.names import is_id, newest_first
from ...schemas.reports.run_record import RunRecord
from ...schemas.wire.errors import ConfigurationError, ResourceNotFoundException
from ...tasks.causes.stored import read_why
from ...tasks.comparison.compared_runs import NightRun
from ...tasks.comparison.side_by_side import axes_of
from ...tasks.inspection.run_records import RECORD_NAME, ids_of_runs, is_night, read_record, since_last
from ...tasks.reporting import classify, view_why
from ..spec_runs.spec_runs import Standing
from .batches import batches_of_run
from .rendering import HOME
from .run_records import going_runs, is_known, place_of, read_kept, record_of, run_name, sees_run
from .visit import Visit

_MOST_LATEST = 5
_MOST_SHOWN = 40
_MOST_LOOKED_AT = 200
"""Number of the newest runs that are searched for those that a visitor may see."""

_MOST_OTHERS = 40
"""Limit of the runs offered for a comparison, as the record of each is read; the page of the history has more."""
_MOST_OTHERS_SEEN = 20
"""Limit of the runs offered to an access key with restricted resources, as each job of each run is looked up."""

_MOST_VALUES = 21
"""Values of an axis that are linked: the first one and twenty others, as in reports."""

_FILE_LINK = re.compile(r'href="(file://[^"]*)"')
_OPEN_PAGE = {"content-security-policy": "sandbox allow-scripts; frame-ancestors 'none'"}


def show_all(visit: Visit, going: Mapping[str, Standing]) -> Response:
    """Web page with the list of latest runs, current ones first."""
    return visit.page("runs.html.j2", runs=_latest(visit, _MOST_SHOWN), going=going)


def show(visit: Visit) -> Response:
    """Web page of one run: changes, batches, and jobs, failures first; of a run that goes on only its batches.

    Raises ResourceNotFoundException if the visitor may see no such run, ConfigurationError if its record cannot be
    read.
    """
    run_id = visit.request.path_params["id"]
    batches = batches_of_run(run_id, visit)
    if not is_known(run_id, visit) and (batches or run_id in going_runs(visit)):
        return visit.page("open_run.html.j2", run_id=run_id, name=run_name(run_id, None), batches=batches)
    record = find_record(visit)
    jobs = sorted(record.jobs, key=lambda job: classify(job.status, job.failure_code, job.verdict).rank)
    others, since = _others(record, visit), since_before(record, visit)
    links = {job.label: f"{HOME}/jobs/{quote(job.arn.rpartition('/')[2])}" for job in record.jobs if job.arn}
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
        job_links=links,
        links_of_changes=links | _links_of_gone(since),
        job_names={job.label: job.title for job in record.jobs},
        has_report=_path(visit).with_name("report.html").is_file(),
        others=others,
        before=_run_before(record, [other.run_id for other in others], since),
        axes=axes_of(record.jobs),
        most_values=_MOST_VALUES,
    )


def _links_of_gone(since: SinceLastRun | None) -> dict[str, str]:
    """Returns links to jobs of earlier runs that this run lacks, by id; a request that never became a job has none."""
    gone = since.gone if since is not None else ()
    return {loss.job: f"{HOME}/jobs/{quote(loss.job)}" for loss in gone if is_id(loss.job)}


def _others(record: RunRecord, visit: Visit) -> list[RunRecord]:
    """Returns other nights of the specification with jobs that the visitor may see, the newest first."""
    ids = ids_of_runs(visit.service.settings.home / "runs", record.name)
    others = [run_id for run_id in ids if run_id != record.run_id]
    if not visit.sees_all:
        others = others[:_MOST_OTHERS_SEEN]
    found = (other for run_id in others if (other := record_of(run_id, visit)) is not None)
    return list(islice((other for other in found if other.jobs and is_night(other)), _MOST_OTHERS))


def _run_before(record: RunRecord, others: Sequence[str], since: SinceLastRun | None) -> str:
    """Returns the id of the run that is compared with first; empty: all others are newer."""
    previous = None if since is None else since.previous_run_id
    if previous is not None and previous in others:
        return previous
    return next((run_id for run_id in others if run_id < record.run_id), "")


def since_before(record: RunRecord, visit: Visit) -> SinceLastRun | None:
    """Compares a run with the one before it; `None` for reruns, refused runs and confined visitors."""
    if not visit.sees_all or record.refusal is not None:
        return None
    return _since(place_of(record.run_id, visit), visit.service.settings.home / "runs")


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
    # The last two parts are the ids of job and run: the home may have been moved since the report was written.
    jobs = {
        _end_of(job.output_uri.rstrip("/")): job.arn.rpartition("/")[2]
        for job in record.jobs
        if job.output_uri and job.arn
    }

    def own(found: re.Match[str]) -> str:
        uri = unescape(found[1])
        places = [(uri[:end], uri[end + 1 :]) for end, letter in enumerate(uri) if letter == "/"]
        for place, name in places:
            if (job := jobs.get(_end_of(place))) is not None:
                return f'href="{HOME}/jobs/{quote(job)}/files/{quote(unquote(name))}"'
        return f'data-place="{found[1]}"'

    return _FILE_LINK.sub(own, report)


def _end_of(place: str) -> str:
    return "/".join(place.split("/")[-2:])


def latest_runs(visit: Visit) -> list[RunRecord]:
    """Returns the records of the newest runs that the visitor may see."""
    return _latest(visit, _MOST_LATEST)


def names_of_seen(visit: Visit) -> list[str]:
    """Returns the names of specifications with runs that the visitor may see."""
    return sorted({record.name for record in _latest(visit, _MOST_LOOKED_AT)})


def _latest(visit: Visit, most: int) -> list[RunRecord]:
    paths = (visit.service.settings.home / "runs").glob(f"*/{RECORD_NAME}")
    newest = newest_first(paths)[:_MOST_LOOKED_AT]
    records = (record for path in newest if (record := read_kept(path, path.stat().st_mtime_ns)) is not None)
    return list(islice((record for record in records if sees_run(visit, record)), most))


def _path(visit: Visit) -> Path:
    name = visit.request.path_params["id"]
    if not is_known(name, visit):
        raise ResourceNotFoundException(f"there is no run {name} in the data home of this server")
    return place_of(name, visit)


def find_record(visit: Visit) -> RunRecord:
    """Returns the record of the run that the visitor asks for.

    Raises:
        ResourceNotFoundException: The visitor may see no such run.
        ConfigurationError: The record cannot be read.
    """
    path = _path(visit)
    record = read_kept(path, path.stat().st_mtime_ns)
    if record is None:
        raise ConfigurationError(f"the record of {path.parent.name} cannot be read")
    return record


@lru_cache(maxsize=16)
def _since(path: Path, runs: Path) -> SinceLastRun | None:
    """Compares a run with the one before it; `None` for a rerun. Cached, since no run before it changes any more."""
    record = read_record(path)
    return None if record.rerun_of else since_last(NightRun.of(record), runs)
