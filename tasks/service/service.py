"""The service object that every operation uses: settings, catalog, object store, clock, random numbers.

A `Service` is opened once per process and passed along explicitly. Flow functions that Prefect itself calls (in a
worker, from a schedule) find it through `Service.current`.
"""

import os
import random
import time
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from functools import cache
from pathlib import Path
from typing import Any

from ...schemas.documents.applications import ApplicationDocument
from ...schemas.documents.document_base import Document
from ...schemas.lifecycles import is_terminal
from ...schemas.runs.programs import Wait
from ...schemas.runs.recording_sources import RECORDED_RUN
from ...schemas.runs.trials import TrialCounts
from ...schemas.settings import DEFAULT_STORE_PATIENCE_MIN, Settings
from ...schemas.wire.arns import IdPrefix, application_arn, new_id, resource_arn
from ...schemas.wire.errors import ResourceAlreadyExistsException
from ..backends.backend import Backend, open_backend
from ..catalog import Catalog, ClientToken, FirstLease, Resource
from ..storage import open_store
from ..storage.object_store import ObjectStore, Stopped
from ..storage.roles import ReadBlock, Roles, open_roles
from .data_home import prepare_home
from .store_retries import Patience, PatientStore, at_once


@dataclass(frozen=True)
class Timing:
    """Time intervals of the service, in seconds."""

    lease_s: float = 30.0
    """Seconds without a heartbeat after which a job worker counts as dead."""

    renew_lease_every_s: float = 5.0
    """Seconds between two renewals of a lease by its holder."""

    upload_every_s: float = 5.0
    """Seconds between two polls for finished files by a job with rolling uploads."""

    store_pause_s: float = 1.0
    """Seconds until the first retry after a store did not answer; later retries wait longer, see `store_retries.py`."""

    store_patience_s: float = 60.0 * DEFAULT_STORE_PATIENCE_MIN
    """Time for which a job waits for an object store that does not answer, in seconds."""

    store_grace_s: float = 15.0
    """Time for which a job that has to stop waits for the object store with its outputs, in seconds."""

    after_kill_s: float = 1.0
    """Seconds until a run that was killed from outside is tried again: memory may be short just now."""

    after_outage_s: float = 1.0
    """Time until the next attempt after the catalog did not answer, in seconds."""

    longest_retry_pause_s: float = 60.0
    """Longest pause before a job is retried whose flow run raised an error, in seconds."""


PACKAGE = "prefect_robomaker.tasks.runtime.applications"
# When the service they were made for was announced; any fixed time would do, so that their ARNs never change.
_CREATED_AT = datetime(2018, 11, 26, tzinfo=UTC)

BUILTINS: Mapping[str, tuple[str, Mapping[str, Any]]] = {
    "scout": (
        "robot-application",
        {
            "robotSoftwareSuite": {"name": "General"},
            "environment": {"uri": f"python://{PACKAGE}.scout"},
        },
    ),
    "walker": (
        "robot-application",
        {
            "robotSoftwareSuite": {"name": "General"},
            "environment": {"uri": f"python://{PACKAGE}.walker"},
        },
    ),
    "indoor-navigation": (
        "simulation-application",
        {
            "robotSoftwareSuite": {"name": "General"},
            "simulationSoftwareSuite": {"name": "SimulationRuntime"},
            "environment": {"uri": f"python://{PACKAGE}.indoor_navigation"},
        },
    ),
    RECORDED_RUN: (
        "simulation-application",
        {
            "robotSoftwareSuite": {"name": "General"},
            "simulationSoftwareSuite": {"name": "SimulationRuntime"},
            "environment": {"uri": f"python://{PACKAGE}.recorded_run"},
        },
    ),
}


def is_builtin(application: Resource) -> bool:
    """Whether an application of the catalog is one that comes with this package."""
    kind, _ = BUILTINS.get(application.name, (None, None))
    return application.kind == kind


def register_builtins(catalog: Catalog, settings: Settings) -> None:
    """Adds the built-in applications to the catalog if they are missing; existing ones are left as they are."""
    for name, (kind, definition) in BUILTINS.items():
        if catalog.find(kind, name) is not None:
            continue
        arn = application_arn(settings.region, settings.account, kind, name, _CREATED_AT)
        resource = Resource.new(
            arn=arn,
            kind=kind,
            id=arn.split("-application/")[1],
            name=name,
            status="Active",
            document=ApplicationDocument.model_validate(
                {**definition, "version": "$LATEST", "revisionId": "builtin-1"}
            ),
        )
        try:
            catalog.create(resource, token=None, unique_name=True)
        except ResourceAlreadyExistsException:
            continue  # another process was quicker


@dataclass(frozen=True)
class Progress:
    """Progress of a job: how many of its parts (worlds, simulation jobs) are in which state."""

    counts: Mapping[str, int]
    total: int
    waits_for: Wait | None = None
    """Scarce machine resource that the next part of a job waits for; `None`: it waits for none."""

    trials: TrialCounts | None = None
    """Counts of the trials of a job's parts; `None`: there are none."""


def _ignore(progress: Progress) -> None:
    """Ignores progress, when there is no listener."""


def _ignore_note(text: str) -> None:
    """Ignores a note, when there is no listener."""


def _utc_now() -> datetime:
    return datetime.now(UTC)


@dataclass(frozen=True)
class SpecRun:
    """Run of a specification that calls operations of this service."""

    run_id: str
    reuse: bool = False
    """Whether a run reuses existing worlds and results that have the same inputs."""

    in_campaign: bool = False
    """Whether the run orders several batches for the same step."""

    mixed: bool = False
    """Whether requests of batches become jobs in a mixed order."""


@dataclass(frozen=True)
class Service:
    """The RoboMaker service in this process: catalog, object store, account, region and settings."""

    settings: Settings
    catalog: Catalog
    store: ObjectStore
    roles: Roles | None = None
    """Credentials of the roles that requests name; `None`: all jobs act with this process's own credentials."""

    backend: Backend | None = None
    """Backend that starts the job workers of batches; `None`: jobs run in the process that carries out the batch."""

    clock: Callable[[], datetime] = _utc_now
    chance: random.Random = field(default_factory=random.SystemRandom)
    """Random source of resource ids, and of seeds that requests do not give."""

    timing: Timing = field(default_factory=Timing)
    """Time intervals for waiting and retrying with stores and servers."""

    report_progress: Callable[[Progress], None] = _ignore
    """Function that is called after every change while a job operation runs; from several threads."""

    report_note: Callable[[str], None] = _ignore_note
    """Function that is called with messages for a person who watches, such as that a job waits.

    It is called from several threads.
    """

    spec_run: SpecRun | None = None
    """Run of a specification that uses this service; `None`: none."""

    first_lease: FirstLease | None = None
    """Lease of the job that this process orders and runs itself; `None`: any job worker may take it."""

    @classmethod
    def open(cls, settings: Settings, environ: Mapping[str, str] | None = None) -> "Service":
        """Opens the catalog and the object store, creates missing parts, and returns the service with them.

        Raises:
            ConfigurationError: A setting leads nowhere.
            StorageError: The object store does not answer.
        """
        backend = open_backend(settings.backend)
        prepare_home(settings)
        catalog = Catalog.open(settings.catalog_url, clock=_utc_now)
        variables = os.environ if environ is None else environ
        store = open_store(settings, variables)
        roles = open_roles(settings, store, variables)
        register_builtins(catalog, settings)
        timing = Timing(store_patience_s=60.0 * settings.store_patience_min)
        return cls(settings=settings, catalog=catalog, store=store, roles=roles, timing=timing, backend=backend)

    @classmethod
    @contextmanager
    def opened(cls, settings: Settings) -> Generator["Service"]:
        """Opens the service inside the `with` block, and closes its catalog after it; see `open`."""
        service = cls.open(settings)
        try:
            yield service
        finally:
            service.catalog.close()

    @classmethod
    def current(cls) -> "Service":
        """Returns the active service, or else one that the environment variables describe, which is opened then."""
        return _active.get() or _from_environment()

    @contextmanager
    def activated(self) -> Generator["Service"]:
        """Makes this service the current one for flows and tasks called inside the `with` block."""
        token = _active.set(self)
        try:
            yield self
        finally:
            _active.reset(token)

    def watched_by(self, listener: Callable[[Progress], None], told: Callable[[str], None] | None = None) -> "Service":
        """Returns a copy of the service that reports progress to `listener`, and notes to `told` if given."""
        return replace(self, report_progress=listener, report_note=told or self.report_note)

    def patient(
        self,
        job_id: str,
        stopped: Stopped,
        *,
        patience_s: float | None = None,
        sleep: Callable[[float], None] = time.sleep,
    ) -> "Service":
        """Returns the same service for a job's work: it waits while the object store does not answer.

        Args:
            job_id: The job that waits, for notes.
            stopped: Called several times a second; true ends waiting.
            patience_s: Longest wait, in seconds; absent: that of the settings.
            sleep: Waits, in seconds.
        """
        patience = Patience(
            self.timing.store_patience_s if patience_s is None else patience_s,
            self.timing.store_pause_s,
            stopped,
            lambda text: self.report_note(f"{job_id}: {text}"),
            sleep,
        )
        return replace(self, store=PatientStore(at_once(self.store), patience))

    def acting_as(self, role: str | None) -> "Service":
        """Returns the service with the object-store credentials of an access role.

        Returns this service unchanged if it has no roles, or the role is `None`.

        Args:
            role: ARN of the role, as a request names it.

        Raises:
            CredentialsRefusedError: The role does not exist, or its credentials are refused.
            StorageUnavailableError: The server does not answer.
        """
        if self.roles is None or role is None:
            return self
        store = self.roles.store_of(role)
        return replace(self, store=self.store.over(store) if isinstance(self.store, PatientStore) else store)

    def with_blocks(self, read_block: ReadBlock) -> "Service":
        """Returns a copy of the service in which Prefect blocks may hold the credentials of roles."""
        return self if self.roles is None else replace(self, roles=self.roles.with_blocks(read_block))

    @property
    def reuses(self) -> bool:
        """Whether jobs ordered now take over existing worlds and results with the same inputs."""
        return self.spec_run is not None and self.spec_run.reuse

    def ordered_by(
        self, run_id: str | None, *, reuse: bool, in_campaign: bool = False, mixed: bool = False
    ) -> "Service":
        """Returns a copy of the service for use by a run of a specification; `None` means by no run."""
        return replace(self, spec_run=None if run_id is None else SpecRun(run_id, reuse, in_campaign, mixed))

    def folder(self, *parts: str) -> Path:
        """Returns a folder below the data home, after creating it."""
        path = self.settings.home.joinpath(*parts)
        path.mkdir(parents=True, exist_ok=True)
        return path

    def arn(self, kind: str, resource_id: str) -> str:
        """Makes the ARN of a resource of this service."""
        return resource_arn(self.settings.region, self.settings.account, kind, resource_id)

    def store_job(
        self,
        kind: str,
        prefix: IdPrefix,
        document: Document | Mapping[str, Any],
        *,
        tags: Mapping[str, str] | None,
        token: ClientToken | None,
        parent: str | None = None,
        labels: Mapping[str, Sequence[str]] | None = None,
        status: str = "Pending",
    ) -> Resource:
        """Stores a new job under a new id in the catalog, and returns it.

        Args:
            kind: Kind of the job, as in its ARN.
            prefix: Prefix of the job's id.
            document: The request, and what its job worker needs besides.
            tags: Tags of the job.
            token: Makes the call repeatable.
            parent: ARN of the batch it belongs to.
            labels: Further values by which lists can be filtered.
            status: First status of the job: a terminal one if it reuses the results of another.

        Raises:
            IdempotentParameterMismatchException: The token was used for another request.
        """
        job_id = new_id(prefix, self.chance)
        job = Resource.new(
            arn=self.arn(kind, job_id),
            kind=kind,
            id=job_id,
            status=status,
            parent=parent,
            tags=tags,
            labels=labels,
            document=document,
        )
        lease = None if is_terminal(kind, status) else self.first_lease
        return self.catalog.create(job, token=token, lease=lease)

    def find_by_client_token(self, token: ClientToken | None) -> Resource | None:
        """Returns the resource that an earlier call with the same client token created, or `None` if there is none.

        Raises:
            IdempotentParameterMismatchException: The earlier call was another request.
        """
        return self.catalog.find_by_client_token(token, self.settings.account)

    def new_seed(self) -> int:
        """Returns a random seed for a job whose request gives none."""
        return self.chance.randrange(2**31)


_active: ContextVar[Service | None] = ContextVar("robomaker_service", default=None)


@cache
def _from_environment() -> Service:
    return Service.open(Settings.from_environment(os.environ))
