"""First page of the console, with current jobs and runs, and the search by ARN, id, name or tag."""

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from typing import Any
from urllib.parse import quote, urlencode

from starlette.responses import RedirectResponse, Response

from ...schemas.documents.simulation_jobs import JobInBrief
from ...schemas.lifecycles import LIFECYCLES
from ...schemas.wings import parts_of_wings
from ...schemas.wire.errors import ConfigurationError
from ...tasks.catalog import Resource
from ...tasks.service.references import jobs_meant, name_of, worlds_meant
from .batches import BATCH, batch_lines
from .job_states import JOB, RUNNING, Look, job_line, look_of_status
from .pages.failures import failure_groups
from .rendering import FOLDERS, HOME, address, render
from .run_records import RecordOf, SeenRecords, going_runs, is_known, record_of, run_name, runs_in_need
from .runs import latest_runs, since_before
from .streams import Parts
from .visit import Visit

_OF_WINGS = parts_of_wings("deployments", "console.kinds")
_OTHER_KINDS = ("world-generation-job", "world-export-job", *(kind for part in _OF_WINGS for kind in part.JOBS))
_OPEN = {
    kind: [state for state in LIFECYCLES[kind].states if state not in LIFECYCLES[kind].terminal]
    for kind in (BATCH, JOB, *_OTHER_KINDS)
}
_MOST_RUNNING = 12
"""Limit of the unfinished resources of each kind that the first page shows."""

_LOOKED_AT = 200
"""Number of the newest open resources among which those are searched that a visitor may see."""

_MOST_FAILURES = 8
"""Limit of the reasons of failures that the first page shows, and of those of known ones."""

_EVERY_S = 2.0


@dataclass(frozen=True)
class OtherLine:
    """A row for an unfinished job that is neither simulation job nor batch."""

    resource: Resource
    look: Look


def show(visit: Visit) -> Response:
    """Web page with the overview of current jobs and runs."""
    runs = latest_runs(visit)
    since = since_before(runs[0], visit) if runs else None
    return visit.page("overview.html.j2", **_now(visit), **_failures(visit), runs=runs, since=since)


def follow(visit: Visit) -> Response:
    """Streams changes of the overview page, its present state and its groups of failures, until the session expires."""
    parts, records = Parts(), SeenRecords(visit)

    def look() -> Iterator[tuple[str, Any]]:
        now = render("overview_now.html.j2", **_now(visit))
        failures = render("failure_groups.html.j2", **_failures(visit, records.of))
        return parts.news({"now": now, "failures": failures})

    return visit.follow(look, _EVERY_S)


def _now(visit: Visit) -> dict[str, Any]:
    found = _open(visit)
    return {
        "going": {run_id: run_name(run_id, None) for run_id in going_runs(visit)},
        "running": RUNNING,
        "batches": batch_lines((each for each in found if each.kind == BATCH), visit),
        "jobs": [job_line(each) for each in found if each.kind == JOB],
        "others": [
            OtherLine(each, look_of_status(each.kind, each.status)) for each in found if each.kind in _OTHER_KINDS
        ],
        "worker": visit.context.worker_status() if visit.sees_all else {},
    }


def _open(visit: Visit) -> list[Resource]:
    """Returns the newest unfinished resources, except jobs of batches."""
    # Who sees only some may see none of the newest.
    most = _MOST_RUNNING if visit.sees_all else _LOOKED_AT
    found = visit.seen(visit.service.catalog.newest(_OPEN, not_below=BATCH, limit=most, members=JobInBrief.members()))
    by_kind = {kind: [each for each in found if each.kind == kind][:_MOST_RUNNING] for kind in _OPEN}
    return [each for some in by_kind.values() for each in some]


def _failures(visit: Visit, record_of_run: RecordOf | None = None) -> dict[str, Any]:
    record = record_of_run or (lambda run_id: record_of(run_id, visit))
    groups = failure_groups(visit, record)
    # Those of the newest runs first: failures of earlier ones must not take their places.
    shown = sorted((each for each in groups if not each.known), key=lambda each: each.is_past)[:_MOST_FAILURES]
    known = sorted((each for each in groups if each.known), key=lambda each: each.is_past)[:_MOST_FAILURES]
    return {
        "in_need": runs_in_need(visit, record),
        "groups": [*shown, *known],
        "more_groups": len(groups) - len(shown) - len(known),
        "posters": visit.context.posters.of(each.newest for each in groups),
    }


_MOST_CHARACTERS = 1300
_NAMED = (
    *("world-template", "simulation-application", "robot-application"),
    *(kind for part in _OF_WINGS for kind in part.NAMED),
)


def _meant(wanted: str, visit: Visit) -> list[Resource]:
    """Returns the jobs and worlds that a name or the beginning of an id means; empty if it means several runs."""
    if not wanted or wanted.startswith("arn:"):
        return []
    with suppress(ConfigurationError):  # of the beginning of several runs
        return [*jobs_meant(wanted, visit.service), *worlds_meant(wanted, visit.service)]
    return []


def find(visit: Visit) -> Response:
    """Handles the search field: redirects to the one match, or lists the matches, with status 404 if there is none.

    It searches by id or ARN, then run id, then `tag=value`, then name; resources that the visitor may not see are no
    matches.
    """
    wanted = visit.parameter("q").strip()[:_MOST_CHARACTERS]
    catalog, service = visit.service.catalog, visit.service
    arns = [wanted] if wanted.startswith("arn:") else [service.arn(kind, wanted) for kind in (*FOLDERS, *_NAMED)]
    for resource in visit.seen(catalog.get_many(arns, ()).values()):
        if page := address(resource.kind, resource.id):
            return RedirectResponse(page, 303)
    if is_known(wanted, visit):
        return RedirectResponse(f"{HOME}/runs/{quote(wanted)}", 303)
    if "=" in wanted:
        return RedirectResponse(f"{HOME}/jobs?{urlencode({'tag': wanted})}", 303)
    named = [found for kind in _NAMED if wanted and (found := catalog.find(kind, wanted)) is not None]
    meant = _meant(wanted, visit)
    named = visit.seen([*named, *meant])
    if len(named) == 1:
        return RedirectResponse(address(named[0].kind, named[0].id), 303)
    names = {each.arn: name_of(each, service) for each in named}
    return visit.page("search.html.j2", wanted=wanted, named=named, names=names, status=200 if named else 404)
