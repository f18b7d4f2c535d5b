"""Resources as the catalog stores and returns them, and pages of lists."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from typing import Any

from ...schemas.documents.document_base import Document


@dataclass(frozen=True, kw_only=True)
class NewResource:
    """A resource (job, world, application, ...) that is to be added to the catalog."""

    arn: str
    kind: str
    """Kind of the resource: the part of the ARN before the id, such as `simulation-job`."""

    id: str
    name: str = ""
    """Name of the new resource; empty if it has none."""

    status: str = ""
    """Status of the new resource in its lifecycle; kinds without a lifecycle may have any text."""

    parent: str | None = None
    """ARN of the generation job or batch that created the resource."""

    tags: Mapping[str, str] = field(default_factory=dict[str, str])

    labels: Mapping[str, Sequence[str]] = field(default_factory=dict[str, Sequence[str]])
    """Labels of the new resource: values that lists filter by, such as the names of a job's applications."""

    document: Mapping[str, Any] = field(default_factory=dict[str, Any])
    """Plain JSON: the request, and what is recorded later. It is read by its kind's type in `schemas.documents`."""


@dataclass(frozen=True, kw_only=True)
class Resource(NewResource):
    """A resource of the catalog (job, world, application, ...) as it was when it was read."""

    created_at: datetime
    updated_at: datetime
    """Time of the last change of a resource's status, name or document."""

    revision: int
    """Revision of a resource: the number of its changes (also of tags), from 1."""

    @staticmethod
    def new(
        *,
        arn: str,
        kind: str,
        id: str,  # noqa: A002 - the name it has everywhere else
        name: str = "",
        status: str = "",
        parent: str | None = None,
        tags: Mapping[str, str] | None = None,
        labels: Mapping[str, Sequence[str]] | None = None,
        document: Document | Mapping[str, Any] | None = None,
    ) -> NewResource:
        """Returns a new resource for the catalog, which sets its times when it is added; omitted members are empty."""
        return NewResource(
            arn=arn,
            kind=kind,
            id=id,
            name=name,
            status=status,
            parent=parent,
            tags=tags or {},
            labels={key: list(values) for key, values in (labels or {}).items()},
            document=document.to_json() if isinstance(document, Document) else document or {},
        )


@dataclass(frozen=True)
class FirstLease:
    """Lease (time-limited lock) of a new job that is held from the moment the job is stored, and for which process."""

    owner: str
    """Name of the process that ordered a job for itself; no other process has that name."""

    lease_s: float
    """Time without renewal after which another process may take the lease, in seconds."""

    needed_environment: Mapping[str, Any]
    """Environment that another process needs to run the job instead; see `schemas.job_owners`."""


@dataclass(frozen=True)
class Ownership:
    """Owner of a job's lease (lock), whether it holds it or gave it up, and the last job worker that was lost."""

    owner: str | None
    """Name of the lease's current or last owner; `None`: no process has held it."""

    since: datetime | None
    """Time at which the current or last owner took a job's lease."""

    is_held: bool
    """Whether the owner holds the job's lease and it has not expired."""

    is_released: bool
    """Whether the owner has released the job's lease."""

    lost_owner: str | None
    """Previous owner whose lease expired before another took it; `None`: there is none."""

    needed_environment: Mapping[str, Any] | None
    """Environment of the process that ordered the job for itself; `None`: a client ordered it."""


@dataclass(frozen=True)
class Page:
    """One page of a list of resources, with the token for the next page."""

    resources: tuple[Resource, ...]
    """Catalog resources of a list's page, newest first."""

    next_token: str | None
    """Token that requests the next page of a list; `None` on the last."""
