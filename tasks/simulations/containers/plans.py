"""Plans of applications that are container images: pulls the image, creates the container, mounts folders."""

import hashlib
import logging
import os
from collections.abc import Mapping
from functools import cache
from pathlib import Path, PurePosixPath
from tempfile import NamedTemporaryFile
from typing import Any

from ....schemas.documents.applications import ApplicationDocument
from ....schemas.runs.plan import ApplicationRole
from ....schemas.runs.programs import ProgramPlan
from ....schemas.runs.ros_options import RosPlan
from ....schemas.settings import Settings
from ....schemas.wire.errors import LaunchError
from ...catalog import Resource
from ...runtime.agents.agent_client import SOCKET_VARIABLE
from ...runtime.agents.agent_socket import ROS1_SOCKET, agent_socket_path
from ...runtime.ros.ros1_bridge import BRIDGE
from ...runtime.ros.ros1_bridge import SOCKET_VARIABLE as ROS1_SOCKET_VARIABLE
from ..environment.aws_endpoints import brings_keys, without_refusal
from ..environment.folders import (
    AGENT,
    AWS,
    DATA_SOURCES,
    HOME,
    LOGS,
    OUTPUT,
    SHARED_MEMORY,
    WORLD,
    WORLD_PACKAGES,
    Sandbox,
    make_shared_memory,
)
from ..environment.role_access import container_variables
from ..environment.run_environment import RunEnvironment, container_sandbox, gpu_of, tool_plan
from ..inputs.world_packages import put_world_into_copies, world_variables
from ..ros.ros_domains import DOMAIN_VARIABLE
from .cleanup import ContainerNote, noted_container
from .command_lines import (
    NO_PROGRAM,
    Container,
    Mount,
    create_arguments,
    env_file,
    gpu_probe_arguments,
    remove_argv,
    start_argv,
    tool_argv,
)
from .engines import CREATE_TIMEOUT_S, Engine, EngineError, copy_out, find_engine, get_image

_logger = logging.getLogger(__name__)


def plan_container(
    role: ApplicationRole,
    application: Resource,
    uri: str,
    config: Mapping[str, Any],
    run_environment: RunEnvironment,
    *,
    drives: bool,
    variables: Mapping[str, str],
    bridge: RosPlan | None,
) -> list[ProgramPlan]:
    """Pulls an application's container image, creates the container, and plans how it and its tools run.

    Args:
        role: Role of the application.
        application: The application or application version.
        uri: Name of the application's image.
        config: Entry of the application in the job's request.
        run_environment: Folders, variables and limits of the run.
        drives: Whether the application is a robot application that drives a simulation over a socket.
        variables: Default environment variables, which the launch configuration may override.
        bridge: ROS bridge of the job, if it has one.

    Raises:
        LaunchError: No container engine answers, the image cannot be pulled or may not be run, or the container cannot
            be created.
    """
    launch = config["launchConfig"]
    _check_network(run_environment.service.settings)
    engine = find_engine(run_environment.environ, run_environment.which)
    digest = ApplicationDocument.of(application).image_digest
    image = get_image(engine, uri, role, digest=digest, stopped=run_environment.stopped)
    note = ContainerNote(engine.program, _container_name(role, run_environment), uri, role)
    sandbox = _seeded_sandbox(engine, note, run_environment)
    has_ros1 = bridge is not None and bridge.suite == 1
    bridge_mounts = [Mount(BRIDGE, _BRIDGE, read_only=True)] if has_ros1 else []
    usual, own = run_environment.plan.environment, launch.get("environmentVariables") or {}
    world = run_environment.world_packages()
    if world is not None:
        put_world_into_copies(sandbox.place(HOME), world)
    container = Container(
        engine=engine,
        name=note.name,
        image=uri,
        command=launch.get("command") or [launch[key] for key in ("packageName", "launchFile") if launch.get(key)],
        environment={
            DOMAIN_VARIABLE: run_environment.plan.environment[DOMAIN_VARIABLE],
            **container_variables(without_refusal(usual) if brings_keys(own) else usual),
            **variables,
            **own,
            **(world_variables(world, {**image.environment, **own}, in_container=True) if world else {}),
            **_container_variables(run_environment, drives),
        },
        mounts=[*_mounts(sandbox, run_environment, drives), *bridge_mounts],
        limits=run_environment.plan.compute,
        gpu=gpu_of(run_environment.environ),
    )
    _make(container, note, run_environment.folder)
    environment = dict(engine.environment)  # its sockets and credentials are those of the user who calls it
    program = ProgramPlan(
        name=role,
        role=role,
        kind="application",
        argv=start_argv(container),
        folder=sandbox.root,  # what the container writes is measured there
        image_id=image.id,
        environment=environment,
        cleanup_argv=remove_argv(container),
    )
    tools = [
        tool_plan(role, tool, tool_argv(container, tool["command"]), sandbox.root, environment)
        for tool in config.get("tools") or []
    ]
    if has_ros1:
        argv = tool_argv(container, _RUN_BRIDGE)
        planned = tool_plan(role, {"name": "ros-bridge"}, argv, sandbox.root, environment)
        tools.append(planned.model_copy(update={"name": f"{role}.ros-bridge"}))  # a tool's name has a dash there
    return [program, *tools]


def _check_network(settings: Settings) -> None:
    """Raises an error, or warns, if jobs may not use the machine's network, which all containers use.

    Raises:
        LaunchError: The settings require a restricted network.
    """
    if settings.sandbox == "off" or settings.sandbox_network == "full":
        return
    lacks = f"containers have the machine's network; it cannot be {settings.sandbox_network!r} for them"
    if settings.sandbox == "require":
        raise LaunchError(
            f"{lacks}, and ROBOMAKER_SANDBOX=require refuses to run them so: let job workers with "
            "ROBOMAKER_SANDBOX_NETWORK=full run this job, or set it to auto",
            "InternalServiceError",
        )
    _warn_once(lacks)


@cache
def _warn_once(text: str) -> None:
    _logger.warning("%s", text)


_BRIDGE = "/opt/robomaker/ros1_bridge.py"
_RUN_BRIDGE = (
    'for setup in /opt/ros/*/setup.bash; do if [ -f "$setup" ]; then . "$setup"; fi; done; '
    f"export {ROS1_SOCKET_VARIABLE}={AGENT}/{ROS1_SOCKET}; exec python3 {_BRIDGE}"
)
"""Shell command that starts the bridge to ROS 1 nodes with the ROS installation of the image."""


def _make(container: Container, note: ContainerNote, folder: Path) -> None:
    """Creates a container, which is started later; raises `LaunchError` if the engine refuses.

    If the client is killed while creating a container, nothing tells whether the engine completes it. So this is not
    cancelled, and is separate from starting the container.
    """
    if container.limits.gpu:
        with noted_container(folder, note, "-gpu") as name:
            check_gpu(container, name)
    # Command lines are for all users of a machine to read, and variables may be secrets.
    with (
        NamedTemporaryFile("w", encoding="utf-8", dir=folder, suffix=".env") as variables,
        noted_container(folder, note),
    ):
        variables.write(env_file(container.environment))
        variables.flush()
        try:
            container.engine.call(*create_arguments(container, Path(variables.name)), timeout_s=CREATE_TIMEOUT_S)
        except EngineError as error:
            raise LaunchError(f"the container of the image {note.image} cannot be made: {error}") from error


def _container_name(role: ApplicationRole, run_environment: RunEnvironment) -> str:
    """Returns a unique container name; it includes the folder, as reruns of a stored run have the same run id."""
    digest = hashlib.sha256(os.fsencode(run_environment.folder.absolute())).hexdigest()[:10]
    return f"robomaker-{run_environment.plan.job_id}-{run_environment.plan.run_id.lower()}-{digest}-{role}"


def check_gpu(container: Container, name: str) -> None:
    """Checks with a test container whether the engine can give a GPU to containers.

    Raises:
        LaunchError: The engine cannot give containers a GPU; the message says why.
    """
    engine = container.engine
    try:
        engine.call(*gpu_probe_arguments(container, name), timeout_s=CREATE_TIMEOUT_S)
        engine.call("start", "--attach", name, timeout_s=CREATE_TIMEOUT_S)
    except EngineError as error:
        if NO_PROGRAM not in str(error):  # which is the last that is looked at
            needed = "a description by `nvidia-ctk cdi generate`" if engine.is_podman else "NVIDIA's container toolkit"
            raise LaunchError(
                f"{engine.program} cannot give the container GPU {container.gpu}; it needs {needed}: {error}"
            ) from error


def _seeded_sandbox(engine: Engine, note: ContainerNote, run_environment: RunEnvironment) -> Sandbox:
    """Creates a container's folders, filled with what the image has in them; any user may write to them.

    Raises LaunchError if the engine refuses, or the run was stopped.
    """
    sandbox = container_sandbox(run_environment.folder, note.role).create()
    sandbox.root.chmod(0o700)  # programs of an image that are root's stay out of the reach of other users
    folders = {path: sandbox.place(path) for path in (HOME, LOGS)}
    with noted_container(run_environment.folder, note, "-image") as name:
        copy_out(engine, note.image, name, folders, stopped=run_environment.stopped)
    output = sandbox.place(OUTPUT)
    output.mkdir(parents=True, exist_ok=True)
    for folder in (*folders.values(), output):
        folder.chmod(0o777)
    return sandbox


def _mounts(sandbox: Sandbox, run_environment: RunEnvironment, drives: bool) -> list[Mount]:
    for path in run_environment.destinations:
        if path.startswith((f"{HOME}/", f"{LOGS}/")):
            _make_mount_point(sandbox, path)
    mounts = [Mount(sandbox.place(path), path) for path in (HOME, LOGS, OUTPUT)]
    mounts += [
        Mount(run_environment.sandbox.place(path), path, read_only=True)
        for path in (DATA_SOURCES, *run_environment.destinations)
    ]
    mounts.append(Mount(make_shared_memory(run_environment.folder), SHARED_MEMORY))
    if (access := run_environment.sandbox.place(AWS)).is_dir():
        mounts.append(Mount(access, AWS, read_only=True))
    if run_environment.plan.world_dir is not None:
        mounts.append(Mount(run_environment.plan.world_dir, WORLD, read_only=True))
    if (packages := run_environment.sandbox.place(WORLD_PACKAGES)).is_dir():
        mounts.append(Mount(packages, WORLD_PACKAGES, read_only=True))
    if drives:
        # Read-only: it may still connect to the socket.
        mounts.append(Mount(_agent_folder(run_environment), AGENT, read_only=True))
    return mounts


def _make_mount_point(sandbox: Sandbox, path: str) -> None:
    """Creates a mount point in a container's folder, since one that the engine creates would belong to root.

    Raises:
        LaunchError: The image has something else at that path; links are refused, as they could lead anywhere.
    """
    place = sandbox.root
    for part in PurePosixPath(path).parts[1:]:
        place /= part
        if place.is_symlink() or (place.exists() and not place.is_dir()):
            raise LaunchError(
                f"the data source's destination {path} cannot be there: the image has something at "
                f"/{place.relative_to(sandbox.root)} that is no folder"
            )
        place.mkdir(exist_ok=True)


def _agent_folder(run_environment: RunEnvironment) -> Path:
    """Creates and returns the folder of the agent socket, before the engine would create it as root."""
    folder = agent_socket_path(run_environment.plan).parent
    folder.parent.mkdir(0o700, exist_ok=True)
    folder.mkdir(0o755, exist_ok=True)
    return folder


def _container_variables(run_environment: RunEnvironment, drives: bool) -> dict[str, str]:
    """Returns the job's environment variables for a container, with paths as they are inside it.

    Without a GPU in the job, GPUs are hidden.
    """
    variables = {
        "AWS_ROBOMAKER_SIMULATION_JOB_ID": run_environment.plan.job_id,
        "AWS_ROBOMAKER_SIMULATION_JOB_ARN": run_environment.plan.job_arn,
        "AWS_ROBOMAKER_SIMULATION_RUN_ID": run_environment.plan.run_id,
        "ROBOMAKER_JOB_ROOT": "/",
        "ROBOMAKER_DATA_DIR": DATA_SOURCES,
        "ROBOMAKER_OUTPUT_DIR": OUTPUT,
        "ROBOMAKER_SEED": str(run_environment.plan.seed),
    }
    if not run_environment.plan.compute.gpu:  # also where an image or the engine would give it all there are
        variables |= {"CUDA_VISIBLE_DEVICES": "", "NVIDIA_VISIBLE_DEVICES": ""}
    if drives:
        variables[SOCKET_VARIABLE] = f"{AGENT}/{agent_socket_path(run_environment.plan).name}"
    if run_environment.plan.world_dir is not None:
        variables["ROBOMAKER_WORLD_DIR"] = WORLD
    return variables
