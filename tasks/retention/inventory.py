"""Inventory of deletable data: runs of specifications, jobs ordered through SDKs, worlds; and what each refers to."""

import re
from collections.abc import Iterator, Mapping, Set
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from ...schemas.documents.kinds import DOCUMENTS
from ...schemas.documents.simulation_jobs import ReusedFrom, SimulationJobDocument
from ...schemas.lifecycles import is_terminal
from ...schemas.reports.names import began
from ...schemas.reports.run_record import RunRecord
from ...schemas.reports.run_states import shown_state
from ..catalog import Resource
from ..service.service import Service
from .policy import Candidate

RECORD, REMOVING = "run.json", "run.removing.json"
"""File name of a run's record, before and after its deletion has begun.

After it, no reader takes the remaining files for a complete run.
"""

JOB, BATCH, EXPORT = "simulation-job", "simulation-job-batch", "world-export-job"
_UNRECORDED_FOR = timedelta(days=14)
"""Time for which a run without a record may still be running: as long as a job may last."""
_PAGE = 500
_WORLD = re.compile(r"arn:[^\s\"]*:world/[^\s\"]+")


@dataclass(frozen=True)
class Unit:
    """A run with its jobs, or jobs ordered without a run, which is kept, thinned out or deleted as a whole."""

    candidate: Candidate
    state: str
    folder: Path | None = None
    """Folder of the run that may be deleted; `None`: there is none."""
    record: RunRecord | None = None
    orders: tuple[str, ...] = ()
    """ARNs of the jobs and batches that the run created or refers to."""
    jobs: Mapping[str, Resource] = field(default_factory=dict[str, Resource])
    """Existing jobs of the unit, including those in batches, by ARN; a batch comes after its jobs."""

    @property
    def names(self) -> set[str]:
        """ARNs of everything that the unit refers to."""
        worlds = {world for job in self.jobs.values() for world in worlds_in(_content(job))}
        # A job that took over results has none of its own.
        origins = {origin.job for job in self.jobs.values() if (origin := _origin(job))}
        steps = self.record.steps if self.record else []
        found = set(self.record.worlds.values()) if self.record else set[str]()
        return (
            worlds
            | found
            | origins
            | {*self.orders, *self.jobs}
            | {arn for step in steps for arn in worlds_in(step.output)}
        )


def find_runs(service: Service) -> list[Unit]:
    """Lists all runs of specifications in the data home as units to keep or delete."""
    folders = sorted(path for path in (service.settings.home / "runs").glob("*") if path.is_dir())
    return [_run(folder, service) for folder in folders]


def find_orders(service: Service, runs: list[Unit]) -> list[Unit]:
    """Lists finished jobs and batches that belong to no run, as units to keep or delete.

    Args:
        service: The service, with its catalog and object store.
        runs: All runs.
    """
    ours = {name for run in runs for name in run.orders} | {arn for run in runs for arn in run.jobs}
    since = open_since(runs)
    found = (each for each in _all(service, (JOB, BATCH, EXPORT)) if not (each.parent and each.kind == JOB))
    return [_order(each, service) for each in found if each.arn not in ours and not _is_since(each, since)]


def find_worlds(service: Service, runs: list[Unit]) -> list[Resource]:
    """Lists all worlds that may be deleted, except those that a current run may just have created.

    Args:
        service: The service, with its catalog and object store.
        runs: All runs.
    """
    since = open_since(runs)
    return [world for world in _all(service, ("world",)) if not _is_since(world, since)]


def is_imported(world: Resource) -> bool:
    """Returns whether somebody made a world by `robomaker world import`: no seed and no job makes it again."""
    return world.id.startswith("import-")


def worlds_of_jobs(service: Service, besides: Set[str]) -> set[str]:
    """Returns the ARNs of the worlds that jobs and batches use.

    Args:
        service: The service, with its catalog and object store.
        besides: ARNs of those that do not count.
    """
    named = (job for job in _all(service, (JOB, BATCH, EXPORT)) if job.arn not in besides)
    return {world for job in named for world in worlds_in(_content(job))}


def texts_of_jobs(service: Service, besides: Set[str]) -> set[str]:
    """Returns all texts in the documents of jobs and batches, as keys of objects are.

    Args:
        service: The service, with its catalog and object store.
        besides: ARNs of those that do not count.
    """
    named = (job for job in _all(service, (JOB, BATCH)) if job.arn not in besides)
    return {text for job in named for text in texts_in(_content(job))}


def takers_over(service: Service, besides: Set[str]) -> dict[str, str]:
    """Returns, for jobs whose results were reused, the job that reused them, by ARN.

    Args:
        service: The service, with its catalog and object store.
        besides: ARNs of jobs that do not count.
    """
    others = (job for job in _all(service, (JOB,)) if job.arn not in besides)
    return {origin.job: job.arn for job in others if (origin := _origin(job))}


def with_jobs_of(orders: Mapping[str, str], service: Service) -> dict[str, str]:
    """Returns a mapping of protected jobs and batches with the jobs of these batches added.

    Args:
        orders: Text that says what needs an order, by the order's ARN.
        service: The service, with its catalog and object store.
    """
    return {arn: who for order, who in orders.items() for arn in _with_children([order], service)}


def open_since(runs: list[Unit]) -> datetime | None:
    """Returns the start of the oldest run that may still be running; newer resources may belong to it.

    Returns `None` if no run may be running.
    """
    return min((_begun(run) for run in runs if run.record is None and run.candidate.busy), default=None)


def _is_since(resource: Resource, since: datetime | None) -> bool:
    return since is not None and resource.created_at >= since


def worlds_in(document: Any) -> set[str]:
    """Returns the ARNs of worlds that occur anywhere in a JSON document."""
    return {world for text in texts_in(document) for world in _WORLD.findall(text)}


def texts_in(document: Any) -> Iterator[str]:
    """Yields all texts that occur anywhere in a JSON document, without keys."""
    if isinstance(document, str):
        yield document
    parts = document.values() if isinstance(document, dict) else document if isinstance(document, list) else ()
    for part in parts:
        yield from texts_in(part)


def why_busy(jobs: Mapping[str, Resource], service: Service) -> str:
    """Returns why jobs cannot be deleted now; empty if they can."""
    for job in jobs.values():
        if not is_terminal(job.kind, job.status):
            return f"{job.kind} {job.id} is {job.status}"
        owner, has_run_out = service.catalog.lease_of(job.arn)
        if owner is not None and not has_run_out:
            return f"{job.kind} {job.id} is in use by {owner}"
    return ""


def _run(folder: Path, service: Service) -> Unit:
    begun = not (folder / RECORD).exists() and (folder / REMOVING).exists()
    try:
        record = RunRecord.stored_in(folder, (folder / (REMOVING if begun else RECORD)).read_bytes())
    except FileNotFoundError:
        return _unrecorded(folder, service)
    except (ValidationError, OSError) as error:
        busy = f"its record cannot be read: {type(error).__name__}"
        return Unit(Candidate(folder.name, service.clock(), busy=busy), "unknown", folder)
    arns = [*(step.arn for step in record.steps), *(job.arn for job in record.jobs)]
    orders = tuple(dict.fromkeys(arn for arn in arns if arn and _kind(arn) in (JOB, BATCH, EXPORT)))
    jobs = _with_children(orders, service)
    candidate = Candidate(
        folder.name,
        record.ended_at,
        record.name,
        failed=record.state != "succeeded",
        busy=why_busy(jobs, service),
        begun=begun,
    )
    return Unit(candidate, shown_state(record), folder, record, orders, jobs)


def _unrecorded(folder: Path, service: Service) -> Unit:
    changed = datetime.fromtimestamp(folder.stat().st_mtime, UTC)
    fresh = changed > service.clock() - _UNRECORDED_FOR
    busy = f"it has no record and may be running; after {_UNRECORDED_FOR.days} days it counts as dead" if fresh else ""
    return Unit(Candidate(folder.name, changed, failed=True, busy=busy), "unfinished", folder)


def _begun(run: Unit) -> datetime:
    """Returns the time at which a run without a record began, from its folder's name, or else an early guess."""
    try:
        return datetime.strptime(began(run.candidate.id) + "000", "%Y%m%dT%H%M%S%f").replace(tzinfo=UTC)
    except ValueError:
        return run.candidate.ended_at - _UNRECORDED_FOR


def _order(resource: Resource, service: Service) -> Unit:
    jobs = _with_children([resource.arn], service)
    failed = resource.status != "Completed"
    candidate = Candidate(resource.arn, resource.updated_at, failed=failed, busy=why_busy(jobs, service))
    return Unit(candidate, resource.status, orders=(resource.arn,), jobs=jobs)


def with_failure(unit: Unit) -> Unit:
    """Returns a copy of the unit marked as failed."""
    return replace(unit, candidate=replace(unit.candidate, failed=True))


def _with_children(orders: tuple[str, ...] | list[str], service: Service) -> dict[str, Resource]:
    found: dict[str, Resource] = {}
    for arn, resource in service.catalog.get_many(orders).items():
        if resource.kind == BATCH:
            found |= {job.arn: job for job in service.catalog.children(arn, JOB)}
    return found | service.catalog.get_many(orders)


def _content(job: Resource) -> dict[str, Any]:
    """Returns a job's stored document, which has its request and results, as a JSON object."""
    return DOCUMENTS[job.kind].of(job).to_json()


def _origin(job: Resource) -> ReusedFrom | None:
    return SimulationJobDocument.of(job).reused_from if job.kind == JOB else None


def _kind(arn: str) -> str:
    return arn.split(":", 5)[-1].partition("/")[0]


def _all(service: Service, kinds: tuple[str, ...]) -> Iterator[Resource]:
    after = None
    while True:
        page = service.catalog.list(kinds, limit=_PAGE, after=after, scope="gc")
        yield from page.resources
        if (after := page.next_token) is None:
            return
