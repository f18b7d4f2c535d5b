"""Registers deployments on a Prefect server: creates or updates them, with parameter forms and schedules."""

import asyncio
import importlib
import re
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
from prefect.utilities.callables import parameter_schema
from pydantic import ValidationError

from ...schemas.specs.parameters import PARAMETERS, Parameter
from ...schemas.wire.errors import ConfigurationError
from ...schemas.wire.request_problems import nearest
from ...tasks.execution.dead_flow_runs import ensure_automation
from ...tasks.execution.schedule_overlaps import OVERLAP, RUNS_AT_ONCE
from .deployables import Deployable
from .job_variables import environment_of_blocks

_NOTHING = {"type": "null"}
_AT_ONCE = frozenset({"string", "integer", "number", "array"})
"""JSON types whose form field may be left empty for no value; switches cannot be, and objects have many fields."""
_DEFAULT = re.compile(r"`?([\w.-]+)`? \(the default\)")


def form_schema(flow: Flow[..., Any], own: Mapping[str, Parameter] | None = None) -> dict[str, Any]:
    """Makes the JSON schema of a flow's parameters for Prefect's run form.

    Of an optional type, a form makes one tab for the type and one for nothing, and opens that of nothing. So an
    optional text, number, choice or list is given as its type alone: what is left empty is not sent. The default of
    a choice, which the service fills in, is chosen already.

    Args:
        flow: The flow.
        own: Parameters of the specification that it runs, which are asked for one by one, and first; `None`: it is the
            flow of no specification.
    """
    schema = _shown(parameter_schema(flow).model_dump_for_openapi())
    if own is None:
        return schema
    flows_own = {name: each for name, each in schema["properties"].items() if name != PARAMETERS}
    forms = {name: {**parameter.form, "title": name} for name, parameter in own.items()}
    properties = {**forms, **flows_own}
    for position, each in enumerate(properties.values()):
        each["position"] = position
    required = [name for name, parameter in own.items() if parameter.default is None]
    return {**schema, "properties": properties, **({"required": required} if required else {})}


def _shown(schema: Any) -> Any:
    """Converts a JSON schema, and those nested in it, to one for Prefect's form."""
    if isinstance(schema, list):
        return [_shown(each) for each in schema]
    if not isinstance(schema, dict):
        return schema
    shown = {key: _shown(value) for key, value in schema.items()}
    if isinstance(properties := shown.get("properties"), Mapping):
        shown["properties"] = {name: {**_field(each), "title": name} for name, each in properties.items()}
    return shown


def _field(schema: dict[str, Any]) -> dict[str, Any]:
    """Converts the JSON schema of one field for Prefect's run form: simple optional types without `null`.

    A default that only the field's description names is written into the schema.
    """
    types = schema.get("anyOf", [])
    if _NOTHING in types and len(types) == 2:
        (given,) = [each for each in types if each != _NOTHING]
        if given.get("type") in _AT_ONCE:
            schema = {**{key: value for key, value in schema.items() if key not in ("anyOf", "default")}, **given}
    named = _DEFAULT.search(schema.get("description", ""))
    if named and "default" not in schema and named[1] in schema.get("enum", ()):
        schema = {**schema, "default": named[1]}
    return schema


_PAGE = 200  # the most that the server gives at once


class NoSuchPoolError(ConfigurationError):
    """Raised when the Prefect server has no work pool of that name; says how to create one."""


@dataclass(frozen=True)
class Target:
    """Target of deployments: work pool, schedule, image and environment."""

    pool: str
    schedule: CronSchedule | None = None
    """Schedule to set for a deployment; `None`: an existing one is kept."""

    unscheduled: bool = False
    """Whether an existing schedule of a deployment is removed."""

    image: str | None = None
    environment: tuple[tuple[str, str], ...] = ()
    blocks: tuple[str, ...] = ()
    """Prefect blocks that provide settings, each `TYPE/NAME`."""


@dataclass(frozen=True)
class Registered:
    """A deployment that was created or updated on the Prefect server."""

    name: str
    """Full name for `prefect deployment run`: the flow's name and the deployment's."""

    id: str
    change: Literal["created", "updated"]
    pool: str
    parameters: Mapping[str, Any]
    """Default values of the specification's parameters in runs of a deployment."""

    missing: tuple[str, ...]
    """Parameters that each run of a deployment has to be given."""

    schedules: tuple[str, ...]
    """Cron expressions with their time zones, of active schedules."""


def register(deployables: Sequence[Deployable], target: Target) -> list[Registered]:
    """Creates or updates deployments on the Prefect server.

    Raises:
        NoSuchPoolError: The work pool does not exist.
        ConfigurationError: A block does not exist, or the server does not answer or refuses the deployment.
    """
    with _told(), get_client(sync_client=True) as client:
        pool = _pool(target.pool, client)
        variables = _job_variables(pool, target, client)
        there = {(str(each.flow_id), each.name): each for each in _deployments(client)}
        for each in deployables:
            _check_scheduled(each, target, there, client)
        return [_register(each, target, variables, there, client) for each in deployables]


def close_dead_runs() -> None:
    """Sets up a remote Prefect server to close runs whose machine has died.

    Raises:
        ConfigurationError: The server does not answer or refuses.
    """
    with _told(), get_client(sync_client=True) as client:
        ensure_automation(client)


def read_block(client: SyncPrefectClient, slug: str, name: str) -> Mapping[str, Any] | None:
    """Reads a Prefect block's content without secrets; `None` if it does not exist."""
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
        parameter_openapi_schema=form_schema(_flow(deployable.entrypoint), deployable.own_parameters),
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
        parameters=dict(deployable.values),
        missing=deployable.missing,
        schedules=tuple(_in_words(each) for each in schedules if each.active is not False),
    )


def _check_scheduled(
    deployable: Deployable,
    target: Target,
    there: Mapping[tuple[str, str], DeploymentResponse],
    client: SyncPrefectClient,
) -> None:
    """Checks that a deployment with a schedule has values for all parameters, as its runs start by themselves.

    Raises ConfigurationError, which names the parameters, if one is missing.
    """
    if not deployable.missing:
        return
    before = there.get((str(client.create_flow_from_name(deployable.flow)), deployable.name))
    if schedules := _schedules(target, before):
        when = ", ".join(_in_words(each) for each in schedules)
        named = " ".join(f"--set {name}=…" for name in deployable.missing)
        raise ConfigurationError(
            f"{deployable.full_name} runs by itself ({when}), and has no value for {', '.join(deployable.missing)}; "
            f"{named}, or defaults in the specification, would be right"
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
    """Raises ConfigurationError in place of the Prefect server's refusals and connection errors in the block."""
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


_FIELDS = 5


def cron_schedule(cron: str, timezone: str = "UTC") -> CronSchedule:
    """Makes a Prefect schedule from a cron expression.

    Args:
        cron: Five fields: minute, hour, day of the month, month, day of the week; or `@daily` and the like.
        timezone: An IANA name such as `Europe/Berlin`, whose summer time counts.

    Raises:
        ConfigurationError: The cron expression or the time zone is invalid.
    """
    try:
        schedule = CronSchedule(cron=cron, timezone=timezone)
    except ValidationError as error:
        wrong = {str(problem["loc"][0]) for problem in error.errors() if problem["loc"]}
        if "timezone" in wrong:
            raise ConfigurationError(
                f"--timezone is {timezone!r}; an IANA name such as UTC or Europe/Berlin would be right"
            ) from error
        if len(cron.split()) == _FIELDS:
            raise ConfigurationError(
                f"--schedule is {cron!r}; one of its fields is out of range: minute 0-59, hour 0-23, day of the month "
                "1-31, month 1-12, day of the week 0-7"
            ) from error
        raise ConfigurationError(
            f"--schedule is {cron!r}; five fields would be right (minute, hour, day of the month, month, day of the "
            "week), such as '0 2 * * *' for every night at two"
        ) from error
    if not _comes_due(cron, timezone):
        raise ConfigurationError(f"--schedule is {cron!r}, which never comes: no month that it names has such a day")
    return schedule


def _comes_due(cron: str, timezone: str) -> bool:
    """Whether the schedule has a next time that Prefect's server finds, within the next decades."""
    from prefect.server.schemas.schedules import CronSchedule as ServersSchedule

    try:
        return bool(asyncio.run(ServersSchedule(cron=cron, timezone=timezone).get_dates(1)))
    except ValueError:  # croniter's for a date that there is not
        return False
