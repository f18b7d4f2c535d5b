"""Turning a simulation job's request into a plan that this machine can carry out."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ..schemas.errors import InvalidParameterException, LaunchError, ResourceNotFoundException, StorageError
from ..schemas.requirement_orders import unknown_room
from ..schemas.requirements import JobRequirement, parse_requirements, rooms_of
from ..schemas.simulation_run import ApplicationPlan, ApplicationRole, RunPlan
from ..schemas.world import World
from .applications import LATEST, find_application, python_package
from .bundles import application_bundle, world_bundle
from .catalog import Resource
from .data_sources import fetch_data_sources
from .service import Service

_FACTORIES: Mapping[ApplicationRole, str] = {"robot": "make_agent", "simulation": "make_environment"}


def run_plan(job: Resource, run_id: str, folder: Path, service: Service) -> RunPlan:
    """Fetches everything a run needs and says where it is.

    Args:
      job: the simulation job.
      run_id: id of this run of it.
      folder: the run's own folder, empty.
      service: where worlds, applications and data are stored.

    Raises:
      LaunchError: something cannot be had; carries the job's failure code.
    """
    request = job.document["request"]
    work_dir, output_dir = folder / "work", folder / "output"
    work_dir.mkdir(parents=True)
    output_dir.mkdir()
    world_dir = _world_dir(request, service)
    return RunPlan(
        job_id=job.id,
        job_arn=job.arn,
        run_id=run_id,
        seed=job.document["seed"],
        max_duration_s=float(request["maxJobDurationInSeconds"]),
        world_dir=world_dir,
        data_dir=fetch_data_sources(job.document.get("dataSources") or [], folder / "data", service),
        work_dir=work_dir,
        output_dir=output_dir,
        simulation_application=_application("simulation", request.get("simulationApplications"), service),
        robot_application=_application("robot", request.get("robotApplications"), service),
        record=request.get("loggingConfig", {}).get("recordAllRosTopics", True),
        video=job.document["video"],
        requirements=_requirements(job, world_dir),
    )


def _world_dir(request: Mapping[str, Any], service: Service) -> Path | None:
    arn = world_arn(request)
    if arn is None:
        return None
    try:
        return world_bundle(service.catalog.get(arn, kind="world"), service)
    except (ResourceNotFoundException, StorageError) as error:
        raise LaunchError(f"world {arn}: {error}", "ResourceNotFound") from error


def _requirements(job: Resource, world_dir: Path | None) -> list[JobRequirement]:
    """What the job orders, all of which can be judged in this world."""
    requirements = parse_requirements(job.document.get("requirements", []), "requirements")
    if world_dir is not None and rooms_of(requirements):
        world = World.model_validate_json((world_dir / "world.json").read_bytes())
        if problem := unknown_room(requirements, [room.name for room in world.floorplan.rooms]):
            raise LaunchError(problem, "InvalidInput")
    return requirements


def world_arn(request: Mapping[str, Any]) -> str | None:
    """ARN of the world a request drives in, if it names one."""
    applications = request.get("simulationApplications") or [{}]
    worlds = applications[0].get("worldConfigs") or [{}]
    return worlds[0].get("world")


def _application(
    role: ApplicationRole, configs: list[dict[str, Any]] | None, service: Service
) -> ApplicationPlan | None:
    if not configs:
        return None
    config, launch = configs[0], configs[0]["launchConfig"]
    try:
        application = find_application(config["application"], role, config.get("applicationVersion"), service)
    except ResourceNotFoundException as error:
        raise LaunchError(str(error), "ResourceNotFound") from error
    path = None
    package, version = launch.get("packageName"), application.document["version"]
    if sources := application.document.get("sources"):
        source, is_pinned = _for_this_machine(sources), version != LATEST
        path = application_bundle(source, role.capitalize(), service, is_pinned=is_pinned)
    else:
        module = _package_of(application)
        package = f"{module}.{package}" if package else module
    return ApplicationPlan(
        role=role,
        name=application.name,
        attribute=f"{package}.{launch.get('launchFile') or _FACTORIES[role]}",
        path=path,
        environment_variables=launch.get("environmentVariables") or {},
    )


def _package_of(application: Resource) -> str:
    try:
        return python_package(application)
    except InvalidParameterException as error:  # it was made one after the job had been ordered
        raise LaunchError(str(error), "InvalidInput") from error


def _for_this_machine(sources: list[dict[str, Any]]) -> dict[str, Any]:
    """The source for 64-bit x86; one without an architecture serves all."""
    for source in sources:
        if source.get("architecture", "X86_64") == "X86_64":
            return source
    return sources[0]
