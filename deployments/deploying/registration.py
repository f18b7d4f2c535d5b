"""Tells a Prefect server of deployments: makes those that are new, changes the others in place.

One after another: writes at the same time only wait for each other on a server with SQLite, and take seven times as
long.
"""

import importlib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Literal
from uuid import UUID

import httpx
from prefect import Flow
from prefect.client.orchestration import SyncPrefectClient, get_client
from prefect.client.schemas.actions import DeploymentScheduleCreate
from prefect.client.schemas.objects import WorkPool
from prefect.client.schemas.responses import DeploymentResponse
from prefect.client.schemas.schedules import CronSchedule
from prefect.exceptions import ObjectNotFound, PrefectException, PrefectHTTPStatusError

from ...schemas.wire.errors import ConfigurationError
from ...schemas.wire.request_problems import nearest
from ...tasks.execution.dead_flow_runs import ensure_automation
from ...tasks.execution.schedule_overlaps import OVERLAP, RUNS_AT_ONCE
from .deployables import Deployable
from .forms import form_schema
from .job_variables import environment_of_blocks

_PAGE = 200  # the most that the server gives at once


class NoSuchPoolError(ConfigurationError):
    """The Prefect server has no work pool of that name; the message says how to make one."""


@dataclass(frozen=True)
class Target:
    """Work pool and schedule of deployments, and the image and environment of their runs."""

    pool: str
    schedule: CronSchedule | None = None
    """Absent: a schedule that a deployment has stays."""

    unscheduled: bool = False
    """Whether a schedule that a deployment has is taken away."""

    image: str | None = None
    environment: tuple[tuple[str, str], ...] = ()
    blocks: tuple[str, ...] = ()
    """`TYPE/NAME` of each block that gives settings."""


@dataclass(frozen=True)
class Registered:
    """A deployment that the server has now."""

    name: str
    """Full name for `prefect deployment run`: the flow's name and the deployment's."""

    id: str
    change: Literal["created", "updated"]
    pool: str
    schedules: tuple[str, ...]
    """Cron expressions with their time zones, of active schedules."""


def register(deployables: Sequence[Deployable], target: Target) -> list[Registered]:
    """Makes or changes deployments on the server that Prefect's settings name.

    Raises:
        NoSuchPoolError: there is no such work pool.
        ConfigurationError: there is no such block, or the server does not answer or refuses.
    """
    with _told(), get_client(sync_client=True) as client:
        pool = _pool(target.pool, client)
        variables = _job_variables(pool, target, client)
        there = {(str(each.flow_id), each.name): each for each in _deployments(client)}
        return [_register(each, target, variables, there, client) for each in deployables]


def close_dead_runs() -> None:
    """Has the server close runs whose machine has died; our own server does so by itself, others have to be told.

    Raises:
        ConfigurationError: the server does not answer or refuses.
    """
    with _told(), get_client(sync_client=True) as client:
        ensure_automation(client)


def read_block(client: SyncPrefectClient, slug: str, name: str) -> Mapping[str, Any] | None:
    """The content of a block, without secrets; `None` if there is none of that name."""
    try:
        return client.read_block_document_by_name(name=name, block_type_slug=slug, include_secrets=False).data
    except ObjectNotFound:
        return None


def _register(
    deployable: Deployable,
    target: Target,
    variables: dict[str, Any],
    there: Mapping[tuple[str, str], DeploymentResponse],
    client: SyncPrefectClient,
) -> Registered:
    flow_id: UUID = client.create_flow_from_name(deployable.flow)
    before = there.get((str(flow_id), deployable.name))
    # The server forgets the schedules of a deployment that it is told of again.
    schedules = _schedules(target, before)
    made = client.create_deployment(
        flow_id,
        deployable.name,
        version=deployable.version,
        entrypoint=deployable.entrypoint,
        description=deployable.description,
        tags=list(deployable.tags),
        parameters=dict(deployable.parameters),
        parameter_openapi_schema=form_schema(_flow(deployable.entrypoint)),
        enforce_parameter_schema=True,
        work_pool_name=target.pool,
        job_variables=variables,
        schedules=schedules,
        # Nights that overlap wait for each other; what is ordered by hand may run at any time.
        concurrency_limit=RUNS_AT_ONCE if schedules else None,
        concurrency_options=OVERLAP if schedules else None,
        pull_steps=[],
    )
    return Registered(
        name=deployable.full_name,
        id=str(made),
        change="updated" if before else "created",
        pool=target.pool,
        schedules=tuple(_in_words(each) for each in schedules if each.active is not False),
    )


def _schedules(target: Target, before: DeploymentResponse | None) -> list[DeploymentScheduleCreate]:
    if target.schedule:
        return [DeploymentScheduleCreate(schedule=target.schedule, active=True)]
    if target.unscheduled or before is None:
        return []
    kept = ("schedule", "active", "max_scheduled_runs", "parameters", "slug")
    return [DeploymentScheduleCreate(**{name: getattr(each, name) for name in kept}) for each in before.schedules]


def _in_words(schedule: DeploymentScheduleCreate) -> str:
    found = schedule.schedule
    return f"{found.cron} {found.timezone or 'UTC'}" if isinstance(found, CronSchedule) else str(found)


def _flow(entrypoint: str) -> Flow[..., Any]:
    module, _, name = entrypoint.rpartition(".")
    return getattr(importlib.import_module(module), name)


def _deployments(client: SyncPrefectClient) -> Iterator[DeploymentResponse]:
    offset = 0
    while page := client.read_deployments(limit=_PAGE, offset=offset):
        yield from page
        offset += len(page)


def _pool(name: str, client: SyncPrefectClient) -> WorkPool:
    try:
        return client.read_work_pool(name)
    except ObjectNotFound as error:
        known = sorted(pool.name for pool in client.read_work_pools())
        raise NoSuchPoolError(
            f"--pool is {name!r}; the Prefect server at {str(client.api_url).rstrip('/')} has no such work pool; "
            f"`prefect work-pool create {name} --type process` makes one{nearest(name, known)}"
        ) from error


def _job_variables(pool: WorkPool, target: Target, client: SyncPrefectClient) -> dict[str, Any]:
    variables: dict[str, Any] = {}
    if target.image:
        known = pool.base_job_template.get("variables", {}).get("properties", {})
        if "image" not in known:
            raise ConfigurationError(
                f"--image is {target.image!r}; the work pool {pool.name!r} is of type {pool.type}, whose runs have no "
                "image: leave --image out, or name a pool of type docker or kubernetes"
            )
        variables["image"] = target.image
    environment = environment_of_blocks(target.blocks, lambda slug, name: read_block(client, slug, name))
    environment |= dict(target.environment)
    if environment:
        variables["env"] = environment
    return variables


@contextmanager
def _told() -> Iterator[None]:
    """Makes what the server refuses, and that it does not answer, errors of ours."""
    try:
        yield
    except PrefectHTTPStatusError as error:
        answer = error.response
        raise ConfigurationError(
            f"the Prefect server refuses {answer.request.method} {answer.request.url}: {answer.status_code} "
            f"{answer.text[:300]}"
        ) from error
    except (httpx.HTTPError, PrefectException) as error:
        raise ConfigurationError(f"the Prefect server does not answer: {type(error).__name__}: {error}") from error
