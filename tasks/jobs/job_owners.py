"""Processes that run jobs: orders that a process runs itself, the environment they need, and who runs a job."""

import logging
import os
import re
import socket
import sys
import threading
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import TracebackType
from typing import Any, Self, cast

from ...schemas.job_owners import PYTHON_PATH, JobOwner, JobStanding, NeededEnvironment, OwnerState
from ...schemas.lifecycles import is_terminal
from ...schemas.settings import Settings
from ...schemas.wire.errors import ServiceUnavailableException
from ..catalog import FirstLease, Ownership, Resource
from ..execution.leases.held_leases import HELD, HeldLeases, died_here, new_owner
from ..service.service import Service
from ..simulations.planning.job_contents import CurrentApplications, imported_packages, package_content

_SIMULATION = (
    *("sandbox", "sandbox_network", "sandbox_show", "nice", "max_job_disk_gb"),
    *("max_output_gb", "max_output_files"),
)
SETTINGS: Mapping[str, Sequence[str]] = {
    "CreateSimulationJob": _SIMULATION,
    "StartSimulationJobBatch": (*_SIMULATION, "backend"),
    "CreateWorldGenerationJob": ("max_worlds_per_job",),
}
"""Settings that affect a job, by the operation that creates it."""

OTHER_VARIABLES = ("ROBOMAKER_CONTAINER_ENGINE", "MENAGERIE_ROOT", "MENAGERIE_CACHE_DIR")
"""Environment variables that affect simulations and are not settings."""

_OF_PREFECT_RUN = re.compile(r"tmp\w+prefect|prefect-flow-run-\w+")
"""Pattern of temporary folder names that Prefect's workers make, or `prefect flow-run execute` in containers."""


def environment_needed(operation: str, request: Mapping[str, Any], service: Service) -> NeededEnvironment:
    """Returns the settings and packages of this process that a job needs to run in another process.

    Args:
        operation: The operation that orders it.
        request: The request's members.
        service: Service with the job's applications, and the settings of this process.
    """
    requests = _simulations(operation, request)
    packages = imported_packages(requests, CurrentApplications(service))
    names = list(SETTINGS.get(operation, ()))
    if any(each.get("iamRole") for each in requests):
        names.append("roles_file")
    return environment_with(names, packages, service.settings, simulates=bool(requests))


def environment_with(
    names: Iterable[str], packages: Mapping[str, str] | None, settings: Settings, *, simulates: bool
) -> NeededEnvironment:
    """Returns this process's environment, reduced to some settings and packages.

    Args:
        names: The settings.
        packages: Digests of the packages that are imported; `None`: nothing but what is built in.
        settings: Settings of this process.
        simulates: Whether simulation jobs run in it.
    """
    variables = {variable(name): written(getattr(settings, name)) for name in dict.fromkeys(names)}
    if simulates:
        variables |= {name: os.environ.get(name, "") for name in OTHER_VARIABLES}
    return NeededEnvironment(
        machine=socket.gethostname(),
        python=sys.prefix,
        python_path=None if packages is None else python_path(os.environ),
        variables=variables,
        packages=dict(packages or {}),
    )


def environment_here(needed: NeededEnvironment, settings: Settings, environ: Mapping[str, str]) -> NeededEnvironment:
    """Returns this process's environment, reduced to the parts that a job needs.

    Args:
        needed: Names of the environment variables and settings that the job needs.
        settings: Settings of this process.
        environ: Environment variables of this process.
    """
    settings_of = {variable(name): name for name in type(settings).model_fields}
    variables = {
        name: written(getattr(settings, settings_of[name])) if name in settings_of else environ.get(name, "")
        for name in needed.variables
    }
    return NeededEnvironment(
        machine=socket.gethostname(),
        python=sys.prefix,
        python_path=python_path(environ),
        variables=variables,
        packages={name: package_content(name) for name in needed.packages},
    )


def _simulations(operation: str, request: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    """Returns the requests of simulation jobs in a request: those of a batch, or the request itself; else none."""
    if operation == "StartSimulationJobBatch":
        return list(request.get("createSimulationJobRequests") or ())
    return [request] if operation == "CreateSimulationJob" else []


def variable(setting: str) -> str:
    """Returns the name of the environment variable of a setting, such as `ROBOMAKER_HOME` for `home`."""
    return f"ROBOMAKER_{setting.upper()}"


def written(value: object) -> str:
    """Formats a setting's value as its environment variable is written; an empty text for `None`."""
    if value is None:
        return ""
    return os.pathsep.join(map(str, cast("tuple[object, ...]", value))) if isinstance(value, tuple) else str(value)


def python_path(environ: Mapping[str, str]) -> tuple[str, ...]:
    """Returns the folders of PYTHONPATH, absolute, without the temporary folder that Prefect adds.

    No other run has that folder. A package that is imported from it is noticed as missing elsewhere.
    """
    folders = (Path(path).absolute() for path in environ.get(PYTHON_PATH, "").split(os.pathsep) if path)
    return tuple(str(folder) for folder in folders if not _OF_PREFECT_RUN.fullmatch(folder.name))


def standing_of(job: Resource, service: Service) -> JobStanding | None:
    """Returns which process runs a job, and how the job continues if that process has died.

    Args:
        job: The job or batch.
        service: The service, with its catalog and object store.

    Returns:
        Owner and state of the job; `None`: no process has begun with it.
    """
    return standings_of([job], service).get(job.arn)


def standings_of(jobs: Iterable[Resource], service: Service) -> dict[str, JobStanding]:
    """Returns which process runs each of some jobs, by ARN.

    Args:
        jobs: Jobs and batches. Of a batch's job the environment that the batch needs counts.
        service: The service, with its catalog and object store.
    """
    wanted = list(jobs)
    found = service.catalog.ownerships([arn for job in wanted for arn in (job.arn, job.parent) if arn])
    return {
        job.arn: _standing(job, ownership, found.get(job.parent or ""), service)
        for job in wanted
        if (ownership := found.get(job.arn)) is not None and ownership.owner is not None
    }


def needs_elsewhere(needed: Mapping[str, object] | None, service: Service) -> list[str]:
    """Lists the needs of a job that this process does not meet; empty if it may run the job.

    Args:
        needed: Environment that was recorded with the order; `None`: a client ordered it.
        service: Service of this process.
    """
    if needed is None:
        return []
    wanted = NeededEnvironment.of_stored(needed)
    return wanted.differences(environment_here(wanted, service.settings, os.environ))


def left_jobs(service: Service) -> list[tuple[Resource, JobStanding]]:
    """Lists the unfinished jobs, each with its standing, whose process has died and which only a command continues."""
    jobs = service.catalog.ordered_for_oneself()
    standings = standings_of(jobs, service)
    return [(job, standings[job.arn]) for job in jobs if standings[job.arn].state in ("died", "left")]


def _standing(job: Resource, ownership: Ownership, above: Ownership | None, service: Service) -> JobStanding:
    standing = JobStanding(
        owner=JobOwner.of_lease(ownership.owner or ""),
        since=ownership.since,
        state=_state(job, ownership),
        lost=JobOwner.of_lease(ownership.lost_owner) if ownership.lost_owner else None,
    )
    needed = ownership.needed_environment or (above.needed_environment if above else None)
    if needed is None or standing.state not in ("died", "left"):
        return standing
    wanted = NeededEnvironment.of_stored(needed)
    here = environment_here(wanted, service.settings, os.environ)
    arn = job.arn if ownership.needed_environment else job.parent or job.arn
    return standing.model_copy(
        update={
            "differences": tuple(wanted.differences(here)),
            "command": wanted.command(arn, here),
            "machine": wanted.machine,
        }
    )


def _state(job: Resource, ownership: Ownership) -> OwnerState:
    if is_terminal(job.kind, job.status):
        return "ended"
    if ownership.is_released:
        return "left"
    return "works" if ownership.is_held and not died_here(ownership.owner or "") else "died"


_logger = logging.getLogger(__name__)


class OwnOrder:
    """Context manager in which this process creates a job and runs it itself, so that no other process takes the job.

    `through` gives the service that stores the job together with its lease (lock); `keep` then renews the lease in
    the background. The end of the `with` block gives it back; an interruption (Ctrl-C) also requests the job's
    cancellation.

    Args:
        service: The service, with its catalog and object store.
        held: Record of the leases that this process holds.
    """

    def __init__(self, service: Service, held: HeldLeases = HELD) -> None:
        self._service = service
        self._held = held
        self._owner = new_owner()
        self._arn: str | None = None
        self._ended = threading.Event()

    def __enter__(self) -> Self:
        """Returns this object; the job is created and run inside the `with` block."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Gives the lease (lock) of the job back; an interruption (Ctrl-C, a signal) also requests its cancellation.

        If the catalog is away, that is logged, and the lease runs out by itself; errors of the `with` block are not
        suppressed.
        """
        self._ended.set()
        if self._arn is None:
            return
        try:
            if kind is not None and not issubclass(kind, Exception):
                self._service.catalog.request_cancel(self._arn)  # it may not have begun; one that has ended stays
            self._held.cancel_reservation(self._arn, self._service.catalog)
        except ServiceUnavailableException as unavailable:
            _logger.warning("the lease of %s runs out by itself: %s", self._arn, unavailable)

    def through(self, operation: str, request: Mapping[str, Any]) -> Service:
        """Returns a service that stores the job together with its lease (lock), held by this process.

        Args:
            operation: The operation that orders the job.
            request: The request's members, which have been checked.
        """
        needed = environment_needed(operation, request, self._service)
        lease = FirstLease(self._owner, self._service.timing.lease_s, needed.model_dump(mode="json"))
        return replace(self._service, first_lease=lease)

    def keep(self, arn: str) -> None:
        """Keeps and renews the lease (lock) of the stored job, in a thread, if this process holds it.

        A job that an equal earlier call had stored may belong to another process; running it here then waits for its
        lease. A lease that cannot be kept is released.
        """
        if self._service.catalog.lease_of(arn)[0] != self._owner:
            return
        if not self._held.adopt(arn, self._owner):
            self._service.catalog.release(arn, self._owner)  # this process ends
        else:
            self._arn = arn
            threading.Thread(target=self._renew, args=(arn,), name=f"order of {arn}", daemon=True).start()

    def _renew(self, arn: str) -> None:
        timing = self._service.timing
        while not self._ended.wait(timing.renew_lease_every_s):
            try:
                self._held.renew_reservation(arn, self._service.catalog, timing.lease_s)
            except ServiceUnavailableException as error:
                _logger.warning("the lease of %s is not renewed: %s", arn, error)
