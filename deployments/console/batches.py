"""Pages of simulation job batches: the list, and the page of one with a grid that fills while its jobs end."""

import time
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from functools import cache, cached_property
from itertools import islice
from typing import Any

from markupsafe import Markup, escape
from starlette.responses import Response

from ...schemas.documents.simulation_jobs import BatchInBrief, FailedRequest
from ...schemas.job_owners import JobStanding
from ...schemas.lifecycles import is_terminal
from ...schemas.reports.names import with_id
from ...schemas.reports.report import Share
from ...schemas.reports.run_record import RunRecord
from ...schemas.runs.programs import StopReason
from ...tasks.catalog import Resource
from ...tasks.jobs.job_owners import standing_of
from ...tasks.reporting.outcomes import times_by_part
from .batch_caches import Known
from .job_states import JOB, KNOWN, UNFINISHED, WAITING, JobLine, Look, look_of_status, named_in_run, rate_of
from .rendering import address, icon, render
from .run_records import JobsInRuns, batch_name, has_known_failures_only, record_of, run_name
from .streams import Parts
from .visit import Visit

BATCH = "simulation-job-batch"
_PAGE_LENGTH = 20
"""Number of batches in a page of the list: batches hold all their requests, and each costs milliseconds to read."""

_MOST_SHOWN = 24
"""Number of failures that a batch's page shows with their reasons."""

_MOST_POSTERS = 12
_LOOKED_AT = 200
"""Number of the newest batches that are searched for those of a run."""

_NEVER_BEGUN = (StopReason.BATCH_CANCELED, StopReason.BATCH_TIMED_OUT)
"""Failure codes of requests that were not refused: their batch ended before they began."""
_EVERY_S = 1.0
_BROKEN = Look("broken", "not created")
_ENDED = {
    "Completed": Look("passed", "succeeded"),
    "Failed": Look("broken", "broken"),
    "Canceled": Look("canceled", "canceled"),
    "TimedOut": Look("unfinished", "timed out"),
}
"""Display of batches that have ended, by status, in the words and colours of runs."""


@dataclass(frozen=True)
class BatchLine:
    """A row of the web console's list of batches."""

    id: str
    name: str
    """Step and specification that ordered the batch: `drive of nightly`; its id if no run did."""
    status: str
    look: Look
    total: int
    done: int
    """Number of a batch's jobs that have ended."""
    spec_run: str
    run_name: str
    """Name of the specification that ordered the batch; empty if no run did."""
    created_at: datetime
    updated_at: datetime
    tags: dict[str, str]


@dataclass(frozen=True)
class Tile:
    """A tile for one request in the grid of a batch's web page."""

    number: int
    look: Look
    job: JobLine | None = None

    @property
    def title(self) -> str:
        """Tooltip of the tile: job or request number, and state."""
        return f"{self._who}: {self.look.value}"

    @property
    def _who(self) -> str:
        if self.job is None:
            return f"request {self.number}"
        return with_id(self.job.name, self.job.id)

    @property
    def html(self) -> str:
        """HTML of a request's tile on a batch's page."""
        title = escape(self.title)
        inside = f"{icon(self.look.icon)}<span>{self.number}</span>"
        if self.job is None:
            seen = f'<span class="tile {self.look.key}" title="{title}">{inside}'
            return f'{seen}<span class="hidden"> {escape(self.look.value)}</span></span>'
        link = address(JOB, self.job.id)
        return f'<a class="tile {self.look.key}" href="{link}" title="{title}" aria-label="{title}">{inside}</a>'


@dataclass(frozen=True)
class BatchView:
    """All values of a batch's web page."""

    batch: Resource
    look: Look
    tiles: Sequence[Tile]
    rate: Share | None
    left_s: float | None
    """Estimated remaining time of a batch, in seconds; `None`: it has ended, or no job has."""
    name: str
    """Step and specification that ordered the batch: `drive of nightly`; its id if no run did."""
    spec_run: str
    run_name: str
    """Name of the specification that ordered the batch; empty if no run did."""
    concurrency: int
    reason: str
    refused: Mapping[int, FailedRequest]
    """Requests that were refused, so that no job was made of them, by number."""
    standing: JobStanding | None
    """Process that runs a batch; `None`: no process has begun."""

    @property
    def grid(self) -> Markup:
        """HTML of all request tiles of a batch, as list items."""
        items = (f'<li id="tile-{tile.number}">{tile.html}</li>' for tile in self.tiles)
        return Markup("".join(items))  # noqa: S704 - each text in it is escaped

    @cached_property
    def counts(self) -> dict[Look, int]:
        """Numbers of a batch's requests by state, most frequent first."""
        return dict(Counter(tile.look for tile in self.tiles).most_common())

    @property
    def times(self) -> str:
        """Total time of all jobs of a batch by activity, as text."""
        parts_s: Counter[str] = Counter()
        for tile in self.tiles:
            parts_s.update(tile.job.parts_s if tile.job is not None else {})
        return times_by_part(parts_s)

    @property
    def shares(self) -> list[tuple[str, int]]:
        """Numbers of a batch's requests by CSS class, for the progress bar."""
        return [(look.key, count) for look, count in self.counts.items()]

    @property
    def ended(self) -> int:
        """Number of a batch's requests that are finished."""
        return sum(count for look, count in self.counts.items() if look not in UNFINISHED)

    @cached_property
    def failures(self) -> list[JobLine]:
        """Jobs of a batch that failed or broke, latest first."""
        found = [tile.job for tile in self.tiles if tile.job is not None and tile.job.is_failure]
        return sorted(found, key=lambda job: job.updated_at, reverse=True)

    @property
    def known(self) -> list[JobLine]:
        """Jobs of a batch whose failure is known in its run, in the order of the request."""
        return [tile.job for tile in self.tiles if tile.job is not None and tile.job.look == KNOWN]

    @property
    def may_run_again(self) -> bool:
        """Whether the batch can be run again: it has ended, and some requests failed, broke or were canceled."""
        return self.has_ended and any(tile.look.key not in ("passed", "unjudged") for tile in self.tiles)

    @property
    def has_ended(self) -> bool:
        """Whether the batch has its final status, such as completed or canceled: the page no longer changes."""
        return is_terminal(BATCH, self.batch.status)


def show_all(visit: Visit) -> Response:
    """Web page with the list of batches."""
    filters = {name: [value] for name in ("status", "tag") if (value := visit.parameter(name))}
    page = visit.listed(BATCH, filters, _PAGE_LENGTH, ())
    lines = batch_lines(visit.seen(page.resources), visit)
    return visit.page("batches.html.j2", lines=lines, next_token=page.next_token)


def show(visit: Visit) -> Response:
    """Web page of one batch of simulation jobs.

    Raises ResourceNotFoundException if the visitor may see no such batch.
    """
    batch = visit.find(BATCH, visit.request.path_params["id"], ())
    view = _view(batch, visit)
    return visit.page("batch.html.j2", **_parts_of(view, visit))


def follow(visit: Visit) -> Response:
    """Streams changed parts of a batch's web page to the browser, until the batch has ended or the session expires.

    Raises ResourceNotFoundException if the visitor may see no such batch.
    """
    batch_id = visit.request.path_params["id"]
    visit.find(BATCH, batch_id, ())
    shown: dict[int, str] = {}
    parts = Parts()
    last: tuple[int, Known, int] | None = None

    def look() -> Iterator[tuple[str, Any]]:
        nonlocal last
        batch = visit.find(BATCH, batch_id, ())
        minute = int(time.monotonic() // 60)  # of what says how long ago something was
        now = (batch.revision, visit.context.job_lines.of(batch.arn), minute)
        if last is not None and (last[0], last[2]) == (now[0], now[2]) and last[1] is now[1]:
            return
        last = now
        view = _view(batch, visit)
        values = _parts_of(view, visit)
        tiles = [tile for tile in view.tiles if shown.get(tile.number) != tile.title]
        shown.update({tile.number: tile.title for tile in tiles})
        if tiles:
            yield "tiles", {f"tile-{tile.number}": tile.html for tile in tiles}
        names = {"batch-head": "batch_head", "failures": "failures", "batch-acts": "batch_acts"}
        yield from parts.news({name: render(f"{each}.html.j2", visit=visit, **values) for name, each in names.items()})
        if view.has_ended:
            yield "end", None

    return visit.follow(look, _EVERY_S)


def batch_lines(batches: Iterable[Resource], visit: Visit) -> list[BatchLine]:
    """Makes rows of batches for lists in the web console."""
    briefs = visit.context.briefs.of(batches)
    record = cache(lambda run_id: record_of(run_id, visit) if run_id else None)
    return [
        _line(batch, brief, {} if _has_ended(batch) else _count(batch, visit), record(brief.spec_run or ""))
        for batch, brief in briefs
    ]


def batches_of_run(run_id: str, visit: Visit) -> list[BatchLine]:
    """Makes rows of the batches that a run has started."""
    page = visit.service.catalog.list(BATCH, limit=_LOOKED_AT, members=())
    briefs = visit.context.briefs.of(visit.seen(page.resources))
    return batch_lines((batch for batch, brief in briefs if brief.spec_run == run_id), visit)


def _count(batch: Resource, visit: Visit) -> dict[str, int]:
    return visit.service.catalog.count_children(batch.arn, JOB)


def _has_ended(batch: Resource) -> bool:
    return is_terminal(BATCH, batch.status)


def _line(batch: Resource, document: BatchInBrief, counts: dict[str, int], record: RunRecord | None) -> BatchLine:
    total = document.request_count or sum(counts.values())
    done = total if _has_ended(batch) else sum(count for each, count in counts.items() if is_terminal(JOB, each))
    return BatchLine(
        id=batch.id,
        name=batch_name(batch.arn, document.spec_run or "", record) or batch.id,
        status=batch.status,
        look=_look(batch, document.verdicts, total, record),
        total=total,
        done=done,
        spec_run=document.spec_run or "",
        run_name=run_name(document.spec_run or "", record),
        created_at=batch.created_at,
        updated_at=batch.updated_at,
        tags=dict(batch.tags),
    )


def _look(batch: Resource, verdicts: dict[str, int] | None, total: int, record: RunRecord | None) -> Look:
    """Returns how a batch's state is shown, in the words of runs: one that is completed as its jobs ended.

    Args:
        batch: The batch.
        verdicts: Numbers of its jobs by verdict; `None`: it has not ended.
        total: Number of its requests.
        record: Record of the run that ordered it, which has its known failures; `None`: there is none.
    """
    if batch.status == "Completed" and verdicts is not None:
        if verdicts.get("ERROR") or sum(verdicts.values()) < total:
            return Look("broken", "broken")
        if verdicts.get("FAIL") and not has_known_failures_only(batch.arn, record):
            return Look("failed", "failed")
        if verdicts == {"PASS": total}:
            return Look("passed", "passed")
    return _ENDED.get(batch.status) or look_of_status(BATCH, batch.status)


def _jobs(visit: Visit, batch: str) -> list[tuple[str, JobLine]]:
    """Returns the ARNs and rows of a batch's jobs that the visitor may see."""
    known = visit.context.job_lines.of(batch).values()
    seen = {job.arn for job in visit.seen(job for job, _ in known)}
    return [(job.arn, line) for job, line in known if job.arn in seen]


def _view(batch: Resource, visit: Visit) -> BatchView:
    [(batch, document)] = visit.context.briefs.of([batch])
    run_id = document.spec_run or ""
    record = record_of(run_id, visit) if run_id else None
    in_runs = JobsInRuns(lambda _: record)
    named = (named_in_run(line, in_runs.find(arn, run_id)) for arn, line in _jobs(visit, batch.arn))
    by_number = {job.number: job for job in named}
    failed = {int(place) + 1 for place in document.failed}
    unseen = Look("canceled", "not shown, or never begun") if _has_ended(batch) else WAITING
    requests = document.request_count
    tiles = [
        Tile(number, job.look, job)
        if (job := by_number.get(number)) is not None
        else Tile(number, _BROKEN if number in failed else unseen)
        for number in range(1, requests + 1)
    ]
    return BatchView(
        batch=batch,
        look=_look(batch, document.verdicts, requests, record),
        tiles=tiles,
        rate=rate_of(by_number.values()),
        left_s=None if is_terminal(BATCH, batch.status) else _left_s(batch, list(by_number.values()), requests),
        name=batch_name(batch.arn, run_id, record) or batch.id,
        spec_run=run_id,
        run_name=run_name(run_id, record),
        concurrency=document.batch_policy.max_concurrency,
        reason=document.failure_reason or "",
        refused={
            number: each
            for place, each in document.failed.items()
            if (number := int(place) + 1) not in by_number and each.failure_code not in _NEVER_BEGUN
        },
        standing=standing_of(batch, visit.service),
    )


def _left_s(batch: Resource, jobs: Sequence[JobLine], requests: int) -> float | None:
    """Estimates the time to go in seconds, at the pace at which jobs have ended so far; `None`: none has ended."""
    ended = [job.updated_at for job in jobs if is_terminal(JOB, job.status)]
    if not ended:
        return None
    took_s = (max(ended) - batch.created_at).total_seconds()
    return took_s / len(ended) * (requests - len(ended))


def _parts_of(view: BatchView, visit: Visit) -> dict[str, Any]:
    failures = view.failures
    return {
        "view": view,
        "failures": failures[:_MOST_SHOWN],
        "more_failures": len(failures) - _MOST_SHOWN,
        "refused_requests": dict(islice(view.refused.items(), _MOST_SHOWN)),
        "more_refused": len(view.refused) - _MOST_SHOWN,
        "posters": visit.context.posters.of(failures[:_MOST_POSTERS]),
    }
