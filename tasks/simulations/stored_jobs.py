"""Storing a simulation job: its request is checked against the catalog first."""

from collections.abc import Mapping
from typing import Any

from ...schemas.documents.applications import ApplicationDocument
from ...schemas.documents.simulation_jobs import SimulationJobDocument
from ...schemas.operations.registry import seed_of, video_of
from ...schemas.operations.simulation_jobs import SimulationJobRequestMembers
from ...schemas.runs.plan import ApplicationRole
from ...schemas.runs.requested_requirements import requirements_of
from ...schemas.wire.errors import InvalidParameterException
from ..catalog import ClientToken, Resource
from ..service.service import Service
from .inputs.data_sources import resolve_data_sources
from .inputs.world_rooms import check_rooms
from .outputs.locations import check_output_location
from .planning.applications import find_application
from .planning.run_plans import world_arn

KIND = "simulation-job"
_ROLES: tuple[ApplicationRole, ...] = ("robot", "simulation")


def store_job(
    request: SimulationJobRequestMembers,
    service: Service,
    *,
    token: ClientToken | None,
    batch: tuple[str, int] | None = None,
) -> Resource:
    """Stores one job as Pending.

    Args:
        request: a job by itself, or one of a batch.
        service: where it is stored.
        token: makes the call repeatable.
        batch: ARN of the batch it belongs to, and the place of its request there.

    Raises:
        ResourceNotFoundException: an application or world does not exist.
        InvalidParameterException: data cannot be read, an application cannot be started so, or the world has no such
            room.
        IdempotentParameterMismatchException: the token was used for another request.
    """
    if (earlier := service.find_by_client_token(token)) is not None:
        return earlier
    wire = request.to_wire()
    robots, simulations = (_applications(wire, role, service) for role in _ROLES)
    if (world := world_arn(wire)) is not None:
        check_rooms(request, service.catalog.get(world, kind="world"), service)
    check_output_location(wire.get("outputLocation"))
    data_sources = resolve_data_sources(wire.get("dataSources") or [], service)
    seed = seed_of(request)
    return service.store_job(
        KIND,
        "sim",
        SimulationJobDocument(
            request=wire,
            request_index=batch[1] if batch else None,
            seed=service.new_seed() if seed is None else seed,
            video=video_of(request) or "none",
            requirements=[each.to_wire() for each in requirements_of(request)],
            data_sources=data_sources,
            robot_application_names=robots,
            simulation_application_names=simulations,
        ),
        tags=request.tags,
        token=token,
        parent=batch[0] if batch else None,
        labels={"robotApplicationName": robots, "simulationApplicationName": simulations},
    )


def _applications(request: Mapping[str, Any], role: ApplicationRole, service: Service) -> list[str]:
    """Names of the applications of a role, all of which can be started."""
    names = []
    for index, config in enumerate(request.get(f"{role}Applications") or []):
        application = find_application(config["application"], role, config.get("applicationVersion"), service)
        _check_launch(config["launchConfig"], application, f"{role}Applications[{index}].launchConfig")
        names.append(application.name)
    return names


def _check_launch(launch: Mapping[str, Any], application: Resource, place: str) -> None:
    """Refuses what cannot mean anything; whether it can be started is found out by its job worker."""
    has_archives = bool(ApplicationDocument.of(application).sources)
    if has_archives and not launch.get("command") and not (launch.get("packageName") and launch.get("launchFile")):
        raise InvalidParameterException(
            f"{place}: command, or packageName and launchFile, have to say what of the archive is started, "
            "such as my_nav and arena.make_environment"
        )
