"""Plans of runs: from a job's request, or from the checkpoints of a run that was killed."""

import logging
import math
import os
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

from ....schemas.documents.simulation_jobs import SimulationJobDocument
from ....schemas.runs.plan import ApplicationPlan, RunPlan
from ....schemas.runs.requirements import JobRequirement, parse_requirements, rooms_of, unknown_room
from ....schemas.runs.trial_rows import plan_of_trial
from ....schemas.runs.trials import Trials
from ....schemas.runs.variables import number_in
from ....schemas.wire.errors import LaunchError, ResourceNotFoundException, StorageError, StorageUnavailableError
from ....schemas.worlds.world import WORLD_FILE, World
from ...catalog import Resource
from ...runtime.states.checkpoint_files import CheckpointError, last_checkpoint, resumable_plan
from ...service.service import Service
from ..environment.aws_endpoints import brings_keys, without_refusal
from ..environment.folders import Sandbox, WorldPackages
from ..environment.role_access import access_variables, acting_service
from ..environment.run_environment import (
    RunEnvironment,
    application_configs,
    compute_limits,
    disk_limit,
    process_variables,
    run_sandbox,
)
from ..inputs.bundles import world_bundle
from ..inputs.data_sources import fetch_data_sources
from ..inputs.world_packages import place_world_packages
from ..ros.ros_domains import DOMAIN_VARIABLE
from .application_plans import plan_applications
from .topic_recording import with_topic_recorder

CHECKPOINTS_FOLDER = "checkpoints"
EVERY_VARIABLE = "ROBOMAKER_CHECKPOINT_EVERY_S"

_DEFAULT_S = 5.0
_SHOWN = 200

_Found = TypeVar("_Found")

_logger = logging.getLogger(__name__)


def checkpoint_every_s(application: ApplicationPlan | None) -> float | None:
    """Returns the simulated seconds between checkpoints of a run; `None` for no checkpoints.

    Args:
        application: Simulation application, whose launch configuration may set the interval in seconds, or 0 for none.

    Raises:
        LaunchError: The launch variable is not a number of seconds.
    """
    variables: Mapping[str, str] = application.environment_variables if application else {}
    text = variables.get(EVERY_VARIABLE)
    if text is None:
        return _DEFAULT_S
    every_s = number_in(text)
    if not 0 <= every_s < math.inf:
        raise LaunchError(
            f"{EVERY_VARIABLE} is {text!r}; seconds of simulated time, or 0 for no checkpoints, would be right"
        )
    return every_s or None


def plan_to_resume(job: Resource, folder: Path) -> RunPlan | None:
    """Returns the plan of an interrupted run if it can be resumed on this machine, else logs why not.

    Then it returns `None`.

    Args:
        job: Simulation job.
        folder: Folder of the interrupted run.
    """
    if job.status != "Running":
        return None
    try:
        plan, last = resumable_plan(folder / CHECKPOINTS_FOLDER)
        _check_own(plan, job, folder)
    except CheckpointError as error:
        _logger.warning("%s is run from the start again: %s", job.arn, error)
        return None
    _logger.info("%s goes on from %.3f s of simulated time, where its last checkpoint is", job.arn, last.sim_time_s)
    return plan


def reached_s(folder: Path) -> float:
    """Returns the simulated time in seconds of a run's last checkpoint; 0 without one.

    Args:
        folder: Folder of the run.
    """
    last = last_checkpoint(folder / CHECKPOINTS_FOLDER)
    return last[1].sim_time_s if last else 0.0


def _check_own(plan: RunPlan, job: Resource, folder: Path) -> None:
    """Checks that a stored plan belongs to the run, since applications could have written to its folder.

    Raises:
        CheckpointError: The plan names another run, other folders, a longer time, or programs, with which no run is
            resumed.
    """
    folder = folder.absolute()
    expected = {
        "job_id": job.id,
        "run_id": folder.name,
        "max_duration_s": float(SimulationJobDocument.of(job).request["maxJobDurationInSeconds"]),
        "work_dir": folder / "work",
        "output_dir": folder / "output",
        "root_dir": run_sandbox(folder).root,
        "checkpoint_dir": folder / CHECKPOINTS_FOLDER,
        "programs": [],
    }
    for name, value in expected.items():
        if (found := getattr(plan, name)) != value:
            raise CheckpointError(
                f"its plan was changed: {name} is {str(found)[:_SHOWN]!r} and has to be {str(value)!r}"
            )


def run_plan(
    job: Resource,
    run_id: str,
    folder: Path,
    service: Service,
    ros_domain: int,
    stopped: Callable[[], bool] = lambda: False,
    as_ran: Mapping[str, str] | None = None,
) -> RunPlan:
    """Downloads everything a simulation run needs, and returns the run's plan.

    Args:
        job: The simulation job.
        run_id: Id of the run.
        folder: Empty folder of the run.
        service: Service that stores worlds, applications and data; the last two are read as the role of the request.
        ros_domain: The run's own domain of ROS 2; see `ros_domains.own_domain`.
        stopped: Function called during long operations; true cancels them.
        as_ran: ETags of the archives, by role, of an earlier run that is to be repeated; those that are nowhere any
            more are taken as they are now. Absent: all are as they are now, and are kept.

    Raises:
        LaunchError: An input cannot be downloaded; the error carries the job's failure code.
        StorageUnavailableError: The object store does not answer.
    """
    document = SimulationJobDocument.of(job)
    request = document.request
    acting = acting_service(request, service)
    work_dir, output_dir = folder / "work", folder / "output"
    work_dir.mkdir(parents=True)
    output_dir.mkdir()
    limits = compute_limits(request, nice=service.settings.nice)
    sandbox = run_sandbox(folder).create()
    world_dir = _of_world(request, service, lambda world: world_bundle(world, service))
    sources = document.data_sources or []
    plan = RunPlan(
        job_id=job.id,
        job_arn=job.arn,
        run_id=run_id,
        seed=document.seed,
        max_duration_s=float(request["maxJobDurationInSeconds"]),
        world_dir=world_dir,
        data_dir=fetch_data_sources(sources, sandbox, acting),
        root_dir=sandbox.root,
        work_dir=work_dir,
        output_dir=output_dir,
        checkpoint_dir=folder / CHECKPOINTS_FOLDER,
        compute=limits,
        environment={DOMAIN_VARIABLE: str(ros_domain), **_variables(document, sandbox, service, job.id)},
        failure_behavior=request.get("failureBehavior") or "Fail",
        record=request.get("loggingConfig", {}).get("recordAllRosTopics", True),
        video=document.video,
        live_view_port=_live_view_port(request),
        requirements=_requirements(document, world_dir),
        trials=Trials.model_validate(document.trials) if document.trials else None,
    )
    destinations = tuple(each.destination for each in sources if each.destination)
    run_environment = RunEnvironment(
        plan,
        folder,
        sandbox,
        destinations,
        acting,
        stopped,
        keeper=service,
        as_ran=as_ran or {},
        world_packages=_world_packages(request, sandbox, service),
    )
    applications = plan_applications(request, run_environment)
    disk_bytes = disk_limit(folder, service.settings.max_job_disk_gb * 10**9)
    with_keys = any(brings_keys(each.environment_variables) for each in applications.plans.values())
    planned = plan.model_copy(
        update={
            "environment": without_refusal(plan.environment) if with_keys else plan.environment,
            "compute": limits.model_copy(update={"disk_bytes": disk_bytes}),
            "checkpoint_every_s": checkpoint_every_s(applications.plans.get("simulation")),
            "simulation_application": applications.plans.get("simulation"),
            "robot_application": applications.plans.get("robot"),
            "programs": applications.programs,
            "ports": applications.ports,
            "ros": applications.bridge,
        }
    )
    planned = _with_begun_once(planned)
    _check_trials(planned)
    if request.get("loggingConfig", {}).get("recordAllRosTopics"):
        launched_by = applications.ros and applications.ros.launch.ros
        most_bytes = service.settings.max_ros_topics_gb * 10**9
        planned = with_topic_recorder(planned, launched_by, os.environ, most_bytes)
    return planned


def _variables(document: SimulationJobDocument, sandbox: Sandbox, service: Service, job_id: str) -> dict[str, str]:
    """Returns the environment variables of all processes of a run, and writes the files that some of them name."""
    request, caller = document.request, f"{job_id}/{document.call_key}" if document.call_key else ""
    usual = process_variables(sandbox, service.settings, os.environ, caller)
    return access_variables(usual, request, sandbox, service, os.environ)


def _with_begun_once(plan: RunPlan) -> RunPlan:
    """Returns a plan in which the only trial of a robot program is an ordinary run with the values of its axes.

    The axes act in the simulation that the program drives; nothing has to be begun anew.
    """
    if plan.trials is None or plan.trials.count > 1 or not plan.has_robot_program:
        return plan
    return plan_of_trial(plan, plan.trials.trial(0, plan.seed)).model_copy(update={"trial": None})


def _check_trials(plan: RunPlan) -> None:
    """Raises `LaunchError` for trials of programs, which cannot be reset between trials."""
    if plan.trials is not None and (plan.has_robot_program or not plan.has_episode):
        role = "robot" if plan.has_robot_program or plan.simulation_application is None else "simulation"
        raise LaunchError(
            f"trials: the {role} application is a program, which cannot be begun anew for each trial; "
            "trials need applications that are factories (make_environment, make_agent), or a job for each seed"
        )


def _live_view_port(request: Mapping[str, Any]) -> int | None:
    """Returns 0 (any free port) for the run's live view if an application's `streamUI` asks for it, else `None`."""
    return 0 if any(config["launchConfig"].get("streamUI") for _, config in application_configs(request)) else None


def _world_packages(
    request: Mapping[str, Any], sandbox: Sandbox, service: Service
) -> Callable[[], WorldPackages | None]:
    """Returns a function that creates the ROS packages of the job's world at its first call: many jobs need none.

    The function returns `None` if the job has no world, and raises `LaunchError` if the world cannot be read.
    """

    @cache
    def place() -> WorldPackages | None:
        return _of_world(request, service, lambda world: place_world_packages(world, sandbox, service))

    return place


def _of_world(request: Mapping[str, Any], service: Service, get: Callable[[Resource], _Found]) -> _Found | None:
    """Calls a function with the world that a request names, and returns its result; `None` if the request names none.

    Raises `LaunchError` if the world does not exist or is damaged, and `StorageUnavailableError` if the store is away.
    """
    arn = world_arn(request)
    if arn is None:
        return None
    try:
        return get(service.catalog.get(arn, kind="world"))
    except StorageUnavailableError:
        raise
    except (ResourceNotFoundException, StorageError) as error:
        raise LaunchError(f"world {arn}: {error}", "ResourceNotFound") from error


def _requirements(document: SimulationJobDocument, world_dir: Path | None) -> list[JobRequirement]:
    """Returns the job's requirements, after checking that the rooms that they name are in the world, if there is one.

    Raises `LaunchError` if a room is not.
    """
    requirements = parse_requirements(document.requirements, "requirements")
    if world_dir is not None and rooms_of(requirements):
        world = World.model_validate_json((world_dir / WORLD_FILE).read_bytes())
        asked = [(f"requirements[{index}].room", room) for index, room in rooms_of(requirements)]
        if problem := unknown_room(asked, [room.name for room in world.floorplan.rooms]):
            raise LaunchError(problem)
    return requirements


def world_arn(request: Mapping[str, Any]) -> str | None:
    """Returns the ARN of the world that a request names; `None` if it names none."""
    applications = request.get("simulationApplications") or [{}]
    worlds = applications[0].get("worldConfigs") or [{}]
    return worlds[0].get("world")
