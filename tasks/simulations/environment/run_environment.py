"""Environment of a run: environment variables, compute limits, tools."""

import os
import shutil
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from urllib.parse import quote

from ....schemas.runs.plan import ApplicationRole, RunPlan
from ....schemas.runs.programs import ComputeLimits, ProgramPlan
from ....schemas.runs.variables import ENDPOINT_VARIABLE, OF_JOB
from ....schemas.settings import Settings
from ....schemas.wire.errors import LaunchError
from ...service.service import Service
from .folders import TEMPORARY, Sandbox, WorldPackages


def process_variables(
    sandbox: Sandbox, settings: Settings, environ: Mapping[str, str], caller: str = ""
) -> dict[str, str]:
    """Returns the environment variables that every process of a run has.

    Args:
        sandbox: Folders of the run.
        settings: Settings of the service.
        environ: Environment variables of this process.
        caller: Id and key of the job, separated by a slash, by which the endpoint recognises its calls.
    """
    return {
        "TMPDIR": str(sandbox.place(TEMPORARY)),
        "PATH": search_path(environ),
        **service_variables(settings, environ, caller),
    }


def service_variables(settings: Settings, environ: Mapping[str, str], caller: str = "") -> dict[str, str]:
    """Returns the environment variables with which a job calls this service.

    The job's own key is the only secret in them. SDKs get the endpoint if this process knows one, and placeholder
    credentials if signatures are not checked. The command line tool gets the data home, unless the catalog is a remote
    database, whose URL may contain a password.

    Args:
        settings: Settings of the service.
        environ: Environment variables of this process.
        caller: Id and key of the job, separated by a slash, by which the endpoint recognises its calls.
    """
    variables = {"AWS_REGION": settings.region, "AWS_DEFAULT_REGION": settings.region}
    if endpoint := environ.get(ENDPOINT_VARIABLE):
        is_open = settings.access_keys_file is None
        variables[ENDPOINT_VARIABLE] = f"{endpoint.rstrip('/')}{OF_JOB}{caller}" if caller and is_open else endpoint
        if models := environ.get("AWS_DATA_PATH"):
            variables["AWS_DATA_PATH"] = models
        if is_open:
            variables |= {"AWS_ACCESS_KEY_ID": "local", "AWS_SECRET_ACCESS_KEY": "local"}
    if _keeps_catalog_at_home(settings):
        variables |= {
            "ROBOMAKER_HOME": str(settings.home),
            "ROBOMAKER_REGION": settings.region,
            "ROBOMAKER_ACCOUNT": settings.account,
        }
    return variables


def _keeps_catalog_at_home(settings: Settings) -> bool:
    plain = quote(str(settings.home), safe="/:@!$&'()*+,;=~")
    return settings.catalog_url in (f"sqlite:///{settings.home}/catalog.db", f"sqlite:///{plain}/catalog.db")


def search_path(environ: Mapping[str, str]) -> str:
    """Returns the PATH on which programs of jobs are found; this Python's folder comes first."""
    return os.pathsep.join([str(Path(sys.executable).parent), environ.get("PATH") or os.defpath])


ROLES: tuple[ApplicationRole, ...] = ("simulation", "robot")


@dataclass(frozen=True)
class RunEnvironment:
    """Environment of a run's applications on this machine: folders, variables and limits."""

    plan: RunPlan
    """Plan of the run, without its applications."""

    folder: Path
    """Folder of the run."""

    sandbox: Sandbox
    destinations: tuple[str, ...]
    """Folders of the job that contain data of its data sources."""

    service: Service
    stopped: Callable[[], bool] = lambda: False
    """Function called during long operations; true cancels them."""

    environ: Mapping[str, str] = field(default_factory=lambda: os.environ)

    keeper: Service | None = None
    """The service with its own access to the store, which keeps archives by digest; `None`: none is kept."""

    as_ran: Mapping[str, str] = field(default_factory=dict[str, str])
    """ETags of the archives that an earlier run had, by role, which is to be repeated; empty: those of now."""

    world_packages: Callable[[], WorldPackages | None] = lambda: None
    """Function that creates the ROS packages of the job's world on the first call; `None`: the job has no world."""

    def which(self, name: str) -> str | None:
        """Returns the path of a program on the PATH of the job's processes; `None` if there is none."""
        return shutil.which(name, path=search_path(self.environ))


def application_configs(
    request: Mapping[str, Any], roles: Sequence[ApplicationRole] = ROLES
) -> Iterator[tuple[ApplicationRole, Mapping[str, Any]]]:
    """Yields the configured applications of a simulation job request, with their roles.

    Args:
        request: Request of the job.
        roles: Roles in the order in which they are yielded.
    """
    for role in roles:
        for config in request.get(f"{role}Applications") or ():
            yield role, config


def run_sandbox(folder: Path) -> Sandbox:
    """Returns the folders of a run's processes."""
    return Sandbox(folder / "root")


def container_sandbox(folder: Path, role: ApplicationRole) -> Sandbox:
    """Returns the folders of an application that runs in a container, separate from the other application's.

    Args:
        folder: Folder of the run.
        role: Role of the application.
    """
    return Sandbox(folder / f"{role}-root")


def tool_plan(
    role: ApplicationRole,
    tool: Mapping[str, Any],
    argv: list[str],
    folder: Path,
    environment: Mapping[str, str],
) -> ProgramPlan:
    """Returns the plan of a tool: a program beside an application, by default started again whenever it ends.

    Args:
        role: Role of the application.
        tool: The tool as the request describes it: `name`, and perhaps `exitBehavior`.
        argv: Command line of the tool.
        folder: Working folder of the tool.
        environment: Environment variables of the tool.
    """
    return ProgramPlan(
        name=f"{role}-{tool['name']}",
        role=role,
        kind="tool",
        argv=argv,
        folder=folder,
        environment=dict(environment),
        exit_behavior=tool.get("exitBehavior") or "RESTART",
    )


DEFAULT_COMPUTE: Mapping[str, Any] = {"simulationUnitLimit": 15, "computeType": "CPU", "gpuUnitLimit": 0}
"""Compute settings of a job whose request has none."""

_BYTES_PER_UNIT = 2 << 30
_SHARE_OF_DISK = 0.4
"""Share of the free disk space that a run may fill: its outputs are copied for storing, often to the same disk."""
_LEAST_DISK_BYTES = 64 * 10**6
"""Minimum size limit of a run in bytes; a disk with less free space causes errors of its own."""
_GPU = Path("/dev/nvidia0")


def has_gpu(gpu: Path = _GPU) -> bool:
    """Whether this machine has a GPU for jobs."""
    return gpu.exists()


def gpu_of(environ: Mapping[str, str]) -> str:
    """Returns the number or UUID of the GPU for jobs: the first in `CUDA_VISIBLE_DEVICES`, else the first."""
    return environ.get("CUDA_VISIBLE_DEVICES", "").split(",")[0].strip() or "0"


def compute_limits(
    request: Mapping[str, Any], *, gpu: Path = _GPU, cpus: int | None = None, nice: int = 0
) -> ComputeLimits:
    """Computes a job's CPU and memory limits: a simulation unit is one processor and 2 GiB.

    Args:
        request: Request of the job.
        gpu: Device file of the first GPU, whose existence is checked if the job needs a GPU.
        cpus: Number of processors of this machine; absent: those that this process may use.
        nice: Niceness of the run's processes.

    Raises:
        LaunchError: The job needs a GPU, and this machine has none.
    """
    compute = {**DEFAULT_COMPUTE, **(request.get("compute") or {})}
    wants_gpu = compute["computeType"] == "GPU_AND_CPU" or compute["gpuUnitLimit"] > 0
    if wants_gpu and not has_gpu(gpu):
        raise LaunchError(
            f"compute.computeType is {compute['computeType']} with gpuUnitLimit {compute['gpuUnitLimit']}, but this "
            f"machine has no GPU ({gpu} is not there); request CPU, or run the job where there is one"
        )
    units = compute["simulationUnitLimit"]
    there = cpus or len(os.sched_getaffinity(0))
    return ComputeLimits(cpus=min(units, there), memory_bytes=units * _BYTES_PER_UNIT, nice=nice, gpu=wants_gpu)


def disk_limit(folder: Path, most_bytes: int) -> int:
    """Computes how many bytes a job may write below a folder, so that it cannot fill the disk.

    It is called after all inputs were downloaded, as their space is no longer free.

    Args:
        folder: Folder that the job writes to.
        most_bytes: Limit in bytes if the disk is large enough.
    """
    free = int(_SHARE_OF_DISK * shutil.disk_usage(folder).free)
    return min(most_bytes, max(free, _LEAST_DISK_BYTES))
