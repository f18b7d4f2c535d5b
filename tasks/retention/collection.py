"""Deletes unneeded runs, jobs and worlds: selects them, measures their size, and deletes them, or only reports."""

import fcntl
from collections.abc import Callable, Iterator, Mapping, Sequence, Set
from contextlib import contextmanager
from dataclasses import dataclass, field, replace

from pydantic import ValidationError

from ...schemas.documents.worlds import WorldDocument
from ...schemas.reports.retention import GcAction, GcItem, GcReport, RetentionPolicy
from ...schemas.runs.plan import RunResult
from ...schemas.wings import parts_of_wings
from ...schemas.wire.errors import ConfigurationError, StorageError
from ..catalog import Resource
from ..runtime.episode.run_results import RESULT_FILE
from ..service.service import Service
from ..storage.object_store import join_key
from .cached_copies import collect_copies
from .inventory import (
    Unit,
    find_orders,
    find_runs,
    find_worlds,
    is_imported,
    takers_over,
    with_failure,
    with_jobs_of,
    worlds_of_jobs,
)
from .kept_archives import collect_archives
from .policy import named_by, why_kept
from .recordings import collect_recordings
from .removal import (
    Amount,
    job_places,
    measure,
    measure_world,
    problem_of,
    remove_unit,
    remove_world,
    spared_jobs,
    thin_unit,
)
from .stored_specifications import Named, StoredSpecification, named_in, stored_orders


@dataclass(frozen=True)
class _Chosen:
    """Selection of a garbage collection: runs and jobs to delete, and reasons for keeping others."""

    units: list[Unit]
    reasons: Mapping[str, str]
    """Reasons for keeping units (runs, orders), by the unit's id."""
    holders: Mapping[str, str]
    """Holder of a resource, by the resource's ARN: the kept job, run or deployment that names it."""
    worlds: list[Resource]
    """Worlds that a garbage collection deletes."""
    notes: list[str]
    deployed: Named
    """Everything that the specifications of deployments name."""
    held_worlds: list[Resource] = field(default_factory=list[Resource])
    """Worlds that go but for such a specification."""


def plan_collection(
    policy: RetentionPolicy, service: Service, deployed: Sequence[StoredSpecification | str] = ()
) -> GcReport:
    """Returns a report of what `robomaker gc` would delete under a policy; deletes nothing.

    Args:
        policy: The rules.
        service: The service, with its catalog and object store.
        deployed: Specifications of deployments, which keep what they name; a text says why they are not known.

    Raises:
        ConfigurationError: The policy would remove everything.
    """
    return _collect(policy, service, deployed, act=False)


def collect(policy: RetentionPolicy, service: Service, deployed: Sequence[StoredSpecification | str] = ()) -> GcReport:
    """Deletes runs, jobs and worlds that no rule of the policy keeps, and returns a report, which has the errors.

    Args:
        policy: The rules.
        service: The service, with its catalog and object store.
        deployed: Specifications of deployments, which keep what they name; a text says why they are not known.

    Raises:
        ConfigurationError: The policy would remove everything, or another collection is going on.
    """
    with _alone(service):
        return _collect(policy, service, deployed, act=True)


def _collect(
    policy: RetentionPolicy, service: Service, deployed: Sequence[StoredSpecification | str], *, act: bool
) -> GcReport:
    policy.check()
    chosen = _choose(policy, service, deployed)
    units = sorted(chosen.units, key=lambda unit: (unit.candidate.ended_at, unit.candidate.id))
    counted: set[str] = set()
    items = [_item(unit, policy, chosen, service, counted, act=act) for unit in units]
    items += [_world_item(world, service, act=act) for world in chosen.worlds]
    items += [_held_item(world, chosen.holders[world.arn]) for world in chosen.held_worlds]
    if policy.older_than is not None:
        with_worlds = {bundle.last_part for world in chosen.worlds if (bundle := WorldDocument.of(world).bundle)}
        items += collect_copies(policy.older_than, with_worlds, service, act=act)
    items += collect_archives(
        policy.older_than, frozenset[str]() if act else _removed(policy, chosen), service, act=act
    )
    if policy.orphaned_recordings and policy.older_than is not None and not chosen.deployed.unreadable:
        ends = {unit.candidate.id for unit in _gone(policy, chosen)} | _removed(policy, chosen)
        gone = frozenset[str]() if act else ends  # what could not be removed still names its own
        items += collect_recordings(policy.older_than, gone, service, chosen.deployed.texts, act=act)
    notes = list(chosen.notes)
    for part in parts_of_wings("tasks", "retention"):
        more, told = part.collect(policy, service, act=act)
        items, notes = [*items, *more], [*notes, *told]
    return GcReport(dry_run=not act, policy=policy, items=items, notes=notes)


def _choose(policy: RetentionPolicy, service: Service, deployed: Sequence[StoredSpecification | str]) -> _Chosen:
    runs, notes = find_runs(service), list[str]()
    units = list(runs)
    names = named_in(deployed, service)
    of_runs = named_in(stored_orders(service, _ended_runs(runs, policy, service)), service)
    stored = {**of_runs.holders, **names.holders}
    # A run whose record cannot be read may name anything.
    readable = all(run.record is not None or run.state != "unknown" for run in runs)
    if not readable and (policy.sdk_jobs or policy.orphaned_worlds or policy.imported_worlds):
        notes.append("a run's record cannot be read, so jobs of SDKs and worlds are left: it may name them")
    notes += _why_left(policy, names, of_runs)
    readable = readable and not (names.unreadable or of_runs.unreadable)
    if policy.sdk_jobs and readable:
        units += [_judged(unit, policy, service) for unit in find_orders(service, runs)]
    required = dict[str, str]()
    names_it = {arn: f"{holder} names it" for arn, holder in stored.items()}
    for part in parts_of_wings("tasks", "retention"):
        required |= with_jobs_of(part.needed_orders(service), service)
    needed = names_it | {arn: f"{deployment} requires it" for arn, deployment in required.items()}
    reasons = why_kept((unit.candidate for unit in units), policy, service.clock()) | needed
    in_units = {unit.candidate.id: unit.names for unit in units}
    # Jobs of runs that go on, or whose records cannot be read, are in no unit.
    takers = takers_over(service, {arn for unit in units for arn in unit.jobs})
    holders = takers | named_by(in_units, reasons.keys()) | stored | required
    chosen = _Chosen(units, reasons, holders, [], notes, names)
    if not readable:
        return chosen
    orphans = _orphans(policy, service, runs, chosen)
    imported = [world for world in orphans if is_imported(world) and world.arn not in stored]
    if imported and not policy.imported_worlds:
        notes.append(
            f"imported worlds stay ({len(imported)}), as no seed makes them again; --imported-worlds removes them"
        )
    asked = {True: policy.imported_worlds, False: policy.orphaned_worlds}
    worlds = [world for world in orphans if asked[is_imported(world)]]
    return replace(
        chosen,
        worlds=[world for world in worlds if world.arn not in stored],
        held_worlds=[world for world in worlds if world.arn in stored],
    )


def _ended_runs(runs: list[Unit], policy: RetentionPolicy, service: Service) -> set[str]:
    """Returns the ids of the runs that no rule keeps: the orders of those that never ended go with them."""
    kept = why_kept((run.candidate for run in runs), policy, service.clock()).keys()
    return {run.candidate.id for run in runs} - kept


def _why_left(policy: RetentionPolicy, deployed: Named, of_runs: Named) -> list[str]:
    """Says which specifications are not known, so that what they may name stays; empty if that never goes."""
    if not (policy.sdk_jobs or policy.orphaned_worlds or policy.imported_worlds or policy.orphaned_recordings):
        return []
    left = "so jobs of SDKs, worlds and recordings are left: it may name them"
    told = [f"{why}, {left}" for why in deployed.unreadable]
    return [*told, *(f"{why}, so jobs of SDKs and worlds are left: it may name them" for why in of_runs.unreadable)]


def _thins(unit: Unit, policy: RetentionPolicy) -> bool:
    """Whether a unit that no rule keeps is only thinned, so that its results stay; else it is deleted."""
    return policy.keep_results and not unit.candidate.begun and (unit.record is not None or unit.folder is None)


def _gone(policy: RetentionPolicy, chosen: _Chosen) -> list[Unit]:
    return [unit for unit in chosen.units if unit.candidate.id not in chosen.reasons and not _thins(unit, policy)]


def _removed(policy: RetentionPolicy, chosen: _Chosen) -> Set[str]:
    """Returns the ARNs of the jobs that are deleted: those of deleted units, without jobs that kept items name."""
    return {arn for unit in _gone(policy, chosen) for arn in unit.jobs} - chosen.holders.keys()


def _orphans(policy: RetentionPolicy, service: Service, runs: list[Unit], chosen: _Chosen) -> list[Resource]:
    """Returns worlds that are older than the policy's age, and that no kept run, job or deployment uses.

    Imported worlds are among them, whether the policy asks for these or for others. Returns none if it asks for neither
    or sets no age.
    """
    if not (policy.orphaned_worlds or policy.imported_worlds) or policy.older_than is None:
        return []
    gone, removed = _gone(policy, chosen), _removed(policy, chosen)
    stay = {unit.candidate.id for unit in chosen.units} - {unit.candidate.id for unit in gone}
    named = named_by({unit.candidate.id: unit.names for unit in chosen.units}, stay).keys()
    spared = named | worlds_of_jobs(service, removed)
    before = service.clock() - policy.older_than
    return [world for world in find_worlds(service, runs) if world.created_at < before and world.arn not in spared]


def _judged(unit: Unit, policy: RetentionPolicy, service: Service) -> Unit:
    """Returns the unit, marked as failed if a stored result of one of its jobs has the verdict FAIL or ERROR.

    Results that cannot be read are skipped. Results are read only if the policy keeps failures.
    """
    if not policy.keep_failures or unit.candidate.failed:
        return unit
    for job in unit.jobs.values():
        for place in job_places(job, service):
            try:
                result = service.store.get_bytes(place.bucket, join_key(place.prefix, RESULT_FILE))
                if RunResult.model_validate_json(result).verdict in ("FAIL", "ERROR"):
                    return with_failure(unit)
            except (StorageError, ValidationError):
                continue
    return unit


def _item(
    unit: Unit, policy: RetentionPolicy, chosen: _Chosen, service: Service, counted: set[str], *, act: bool
) -> GcItem:
    """Deletes, thins or keeps a unit (a run or jobs), and returns the report's entry on it.

    Args:
        unit: The run or the jobs.
        policy: Rules that decide whether to keep it.
        chosen: Decisions on all units.
        service: The service, with its catalog and object store.
        counted: ARNs of jobs whose size another unit has counted; this unit's jobs are added.
        act: Whether to delete; if false, the entry only says what would be deleted.
    """
    candidate = unit.candidate
    about = GcItem(
        kind="run" if unit.folder is not None else "jobs",
        id=candidate.id,
        name=candidate.group or "",
        ended_at=candidate.ended_at,
        state=unit.state,
        action="keep",
    )
    if reason := chosen.reasons.get(candidate.id):
        return about.model_copy(update={"reason": reason})
    thins = _thins(unit, policy)
    spared = spared_jobs(unit, chosen.holders)
    action: GcAction = "thin" if thins else "remove"
    amount, problem = _done(
        lambda: measure(unit, spared.keys() | counted, service, results_stay=thins),
        (lambda: (thin_unit if thins else remove_unit)(unit, spared.keys(), service)) if act else None,
    )
    counted.update(unit.jobs)
    if thins and amount == Amount() and not problem:
        return about.model_copy(update={"reason": "only its results are left"})
    holder = next(iter(spared.values()), "")
    reason = f"{len(spared)} of its jobs stay: {holder} names them" if spared else ""
    return about.model_copy(update={"action": action, "reason": reason, "problem": problem, **_sizes(amount)})


def _world_item(world: Resource, service: Service, *, act: bool) -> GcItem:
    amount, problem = _done(
        lambda: measure_world(world, service), (lambda: remove_world(world, service)) if act else None
    )
    about = GcItem(kind="world", id=world.arn, ended_at=world.created_at, action="remove", problem=problem)
    return about.model_copy(update=_sizes(amount))


def _held_item(world: Resource, holder: str) -> GcItem:
    return GcItem(kind="world", id=world.arn, ended_at=world.created_at, action="keep", reason=f"{holder} names it")


def _sizes(amount: Amount) -> dict[str, int]:
    return {"objects": amount.objects, "size_bytes": amount.size_bytes}


def _done(measured: Callable[[], Amount], remove: Callable[[], None] | None) -> tuple[Amount, str | None]:
    """Measures something, and deletes it unless `remove` is `None`; returns the amount, and an error text or `None`.

    Raises `ServiceUnavailableException` if the catalog does not answer; other errors become the text.
    """
    amounts: list[Amount] = []
    problem = problem_of(lambda: amounts.append(measured()), *([remove] if remove else []))
    return sum(amounts, Amount()), problem


@contextmanager
def _alone(service: Service) -> Iterator[None]:
    with (service.settings.home / "gc.lock").open("w") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise ConfigurationError(f"another `robomaker gc` is going on in {service.settings.home}") from None
        yield
