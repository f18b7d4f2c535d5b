"""Applications that are container images: pulled, given folders, run by docker or podman."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ..schemas.run_programs import ProgramPlan
from ..schemas.simulation_run import ApplicationRole
from .catalog import Resource
from .container_argv import Container, Mount, remove_argv, run_argv, tool_argv
from .containers import Engine, copy_out, engine_environment, find_engine, get_image
from .runtime.agent_client import SOCKET_VARIABLE
from .runtime.agent_socket import agent_socket_path
from .sandbox import DATA_SOURCES, HOME, LOGS, Sandbox
from .surroundings import Surroundings, container_sandbox, tool_plan

OUTPUT_IN_CONTAINERS = "/opt/robomaker/output"
WORLD_IN_CONTAINERS = "/opt/robomaker/world"
AGENT_IN_CONTAINERS = "/opt/robomaker/agent"


def plan_container(
    role: ApplicationRole, application: Resource, uri: str, config: Mapping[str, Any], surroundings: Surroundings
) -> list[ProgramPlan]:
    """Gets an application's image and says how it and its tools are run.

    Args:
      role: the application's.
      application: it, or the version of it.
      uri: its image.
      config: its entry in the job's request.
      surroundings: what it finds.

    Raises:
      LaunchError: there is no engine, or the image cannot be had or may not be run.
    """
    container = _container(role, application, uri, config["launchConfig"], surroundings)
    # The engine is called as whoever performs the job calls it: its sockets and credentials are theirs.
    environment = engine_environment(surroundings.environ)
    folder = surroundings.folder
    program = ProgramPlan(
        name=role,
        role=role,
        kind="application",
        argv=run_argv(container),
        folder=folder,
        environment=environment,
        cleanup_argv=remove_argv(container),
    )
    tools = [
        tool_plan(role, tool, tool_argv(container, tool["command"]), folder, environment)
        for tool in config.get("tools") or []
    ]
    return [program, *tools]


def _container(
    role: ApplicationRole,
    application: Resource,
    uri: str,
    launch: Mapping[str, Any],
    surroundings: Surroundings,
) -> Container:
    """Gets an image and says how it is run."""
    engine = find_engine(surroundings.environ, surroundings.which)
    digest = application.document.get("imageDigest")
    get_image(engine, uri, role, digest=digest, stopped=surroundings.stopped)
    name = f"robomaker-{surroundings.plan.job_id}-{surroundings.plan.run_id.lower()}-{role}"
    sandbox = _seeded_sandbox(engine, uri, name, role, surroundings)
    command = launch.get("command") or [launch[key] for key in ("packageName", "launchFile") if launch.get(key)]
    return Container(
        engine=engine.program,
        name=name,
        image=uri,
        command=command,
        environment={**_container_variables(role, surroundings), **(launch.get("environmentVariables") or {})},
        mounts=_mounts(role, sandbox, surroundings),
        limits=surroundings.plan.compute,
    )


def _seeded_sandbox(engine: Engine, uri: str, name: str, role: ApplicationRole, surroundings: Surroundings) -> Sandbox:
    """Folders for a container, with what its image has there; whoever `USER` is may write to them."""
    sandbox = container_sandbox(surroundings.folder, role).create()
    folders = {path: sandbox.place(path) for path in (HOME, LOGS)}
    copy_out(engine, uri, f"{name}-image", folders)
    for folder in (*folders.values(), surroundings.plan.output_dir):
        folder.chmod(0o777)
    return sandbox


def _mounts(role: ApplicationRole, sandbox: Sandbox, surroundings: Surroundings) -> list[Mount]:
    shared = surroundings.sandbox
    mounts = [Mount(sandbox.place(path), path) for path in (HOME, LOGS)]
    mounts.append(Mount(shared.place(DATA_SOURCES), DATA_SOURCES, read_only=True))
    mounts += [Mount(shared.place(path), path, read_only=True) for path in surroundings.destinations]
    mounts.append(Mount(surroundings.plan.output_dir, OUTPUT_IN_CONTAINERS))
    if surroundings.plan.world_dir is not None:
        mounts.append(Mount(surroundings.plan.world_dir, WORLD_IN_CONTAINERS, read_only=True))
    if role == "robot":
        mounts.append(Mount(_agent_folder(surroundings), AGENT_IN_CONTAINERS))
    return mounts


def _agent_folder(surroundings: Surroundings) -> Path:
    """The folder of the socket that a robot drives the simulation by, made before an engine makes it as root."""
    folder = agent_socket_path(surroundings.plan).parent
    folder.parent.mkdir(0o700, exist_ok=True)
    folder.mkdir(0o755, exist_ok=True)
    return folder


def _container_variables(role: ApplicationRole, surroundings: Surroundings) -> dict[str, str]:
    """What a container has in its environment: nothing that is about folders of this machine."""
    variables = {
        "AWS_ROBOMAKER_SIMULATION_JOB_ID": surroundings.plan.job_id,
        "AWS_ROBOMAKER_SIMULATION_JOB_ARN": surroundings.plan.job_arn,
        "AWS_ROBOMAKER_SIMULATION_RUN_ID": surroundings.plan.run_id,
        "ROBOMAKER_DATA_DIR": DATA_SOURCES,
        "ROBOMAKER_OUTPUT_DIR": OUTPUT_IN_CONTAINERS,
    }
    if role == "robot":
        variables[SOCKET_VARIABLE] = f"{AGENT_IN_CONTAINERS}/{agent_socket_path(surroundings.plan).name}"
    if surroundings.plan.world_dir is not None:
        variables["ROBOMAKER_WORLD_DIR"] = WORLD_IN_CONTAINERS
    service = {name: value for name, value in surroundings.plan.environment.items() if name.startswith("AWS_")}
    return variables | {name: value for name, value in service.items() if name != "AWS_DATA_PATH"}
