"""Requests that start runs: plan, environment variables, sandbox and processor cores."""

import logging
import os
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from urllib.parse import urlsplit

from ....schemas.runs.plan import RunPlan
from ....schemas.runs.programs import BoxPlan, ProgramPlan
from ....schemas.runs.variables import variables_of
from ....schemas.settings import Settings
from ....schemas.wire.errors import LaunchError
from ..agents.agent_client import SOCKET_VARIABLE
from ..agents.agent_socket import ROS1_SOCKET, agent_socket_path
from ..process.run_request import RunRequest
from ..rendering.backends import best_video_backend
from ..ros.ros1_bridge import SOCKET_VARIABLE as ROS1_SOCKET_VARIABLE
from ..sandbox.levels import Confinement
from ..sandbox.visible_files import paths_in
from ..video.video_settings import camera_recording, settings_of

DEFAULT_VARIABLES = {
    # Runs are parallel to each other; threads inside numpy would only fight over the cores.
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    # Mesa's software renderer draws in the thread that asks.
    "LP_NUM_THREADS": "0",
    # In a sandbox Mesa cannot write its cache of shaders, and says so in each log.
    "MESA_SHADER_CACHE_DISABLE": "true",
    # The order of sets of strings is part of what a seed has to repeat.
    "PYTHONHASHSEED": "0",
    "MUJOCO_GL": "disable",
    # The wheels of onnxruntime send what they are used for to their makers, and keep a number of the machine.
    "ORT_DISABLE_TELEMETRY": "1",
}
_INHERITED_VARIABLES = frozenset(
    {
        *("PATH", "HOME", "USER", "LOGNAME", "SHELL", "LANG", "LANGUAGE", "TZ", "TMPDIR", "XDG_RUNTIME_DIR"),
        *("LD_LIBRARY_PATH", "VIRTUAL_ENV", "PYTHONPATH", "PYTHONDONTWRITEBYTECODE"),
        *("CUDA_VISIBLE_DEVICES", "NVIDIA_VISIBLE_DEVICES", "NVIDIA_DRIVER_CAPABILITIES"),
        *("MUJOCO_EGL_DEVICE_ID", "__EGL_VENDOR_LIBRARY_DIRS", "LIBGL_DRIVERS_PATH"),
        *("MENAGERIE_ROOT", "MENAGERIE_CACHE_DIR"),
    }
)
_GPU_VARIABLES = ("CUDA_VISIBLE_DEVICES", "NVIDIA_VISIBLE_DEVICES")


def make_request(plan: RunPlan, cores: list[int] | None, box: BoxPlan | None = None) -> RunRequest:
    """Makes the request that starts a run: its plan, with import path, environment and rendering.

    Args:
        plan: Plan of the run. Relative paths refer to this process's working directory.
        cores: Numbers of the processor cores that the run may use; None: all.
        box: Sandbox of the run; None: no sandbox.

    Raises:
        LaunchError: The variables ask for an impossible video or recording.
    """
    plan = plan.with_paths(Path.absolute)  # here, where relative ones still mean what the caller meant
    # Trials are filmed when they are run once more, at the end of the run.
    records_video = plan.video == "always" or (plan.trials is not None and plan.video == "on-failure")
    if plan.video != "none":
        settings_of(plan)  # what is wrong with them is said before anything is started
    renders_now = records_video or camera_recording(plan) is not None
    backend = best_video_backend() if renders_now or plan.live_view_port is not None else None
    variables = dict(variables_of(plan))
    if renders_now and backend in ("egl", "osmesa"):
        variables.setdefault("MUJOCO_GL", backend)
    box = box or BoxPlan()
    # What this process finds by its variables now; processes that wait for runs may know earlier ones.
    inherited = inherited_environment()
    box = box.model_copy(update={"shown": [*box.shown, *paths_in({**os.environ, **inherited})]})
    home = {"HOME": str(plan.root_dir / "home" / "robomaker")} if plan.root_dir else {}
    if box.level == "box":
        home["TMPDIR"] = "/tmp"  # noqa: S108 - the box's own
    return RunRequest(
        plan=plan,
        environment={
            **DEFAULT_VARIABLES,
            **inherited,
            **home,
            **variables,
            "PWD": str(plan.work_dir),
            **_fixed_variables(plan),
        },
        import_path=[str(Path(entry).absolute()) for entry in sys.path],
        video_backend=backend,
        box=box,
        cores=cores,
    )


def inherited_environment() -> dict[str, str]:
    """Returns this process's environment variables that runs may see: no credentials, no service settings."""
    found = {key: value for key, value in os.environ.items() if key in _INHERITED_VARIABLES or key.startswith("LC_")}
    return {**_menagerie_cache(), **found}


def _menagerie_cache() -> dict[str, str]:
    """Returns the variable with the folder of downloaded robots, whose default depends on hidden variables."""
    try:
        from mujoco_menagerie import Cache  # an extra
    except ImportError:
        return {}
    return {"MENAGERIE_CACHE_DIR": str(Cache().dir)}


def program_environment(request: RunRequest, program: ProgramPlan) -> dict[str, str]:
    """Returns the complete environment variables for one of a run's programs.

    The program's own variables override the run's, except those that name the job, its folders and its seed.
    """
    plan = request.plan
    of_role = plan.robot_application if program.role == "robot" else plan.simulation_application
    environment = {
        **request.environment,
        **(of_role.environment_variables if of_role else {}),
        **program.environment,
        "PWD": str(program.folder),
        **_fixed_variables(plan),
    }
    if plan.has_episode and program.role == "robot":
        environment.setdefault(SOCKET_VARIABLE, str(agent_socket_path(plan)))
        if plan.ros is not None and plan.ros.suite == 1:
            environment[ROS1_SOCKET_VARIABLE] = str(agent_socket_path(plan, ROS1_SOCKET))
    return environment


def _fixed_variables(plan: RunPlan) -> dict[str, str]:
    """Returns the environment variables that an application cannot override: job, seed, folders, and visible GPUs."""
    variables = {
        "AWS_ROBOMAKER_SIMULATION_JOB_ID": plan.job_id,
        "AWS_ROBOMAKER_SIMULATION_JOB_ARN": plan.job_arn,
        "AWS_ROBOMAKER_SIMULATION_RUN_ID": plan.run_id,
        "ROBOMAKER_SEED": str(plan.seed),
        "ROBOMAKER_OUTPUT_DIR": str(plan.output_dir),
    }
    folders = {
        "ROBOMAKER_JOB_ROOT": plan.root_dir,
        "ROBOMAKER_DATA_DIR": plan.data_dir,
        "ROBOMAKER_WORLD_DIR": plan.world_dir,
    }
    variables |= {name: str(folder) for name, folder in folders.items() if folder is not None}
    if not plan.compute.gpu:
        variables |= dict.fromkeys(_GPU_VARIABLES, "")
    elif not os.environ.get(_GPU_VARIABLES[0]):
        variables[_GPU_VARIABLES[0]] = "0"
    return variables


_CODE = "InternalServiceError"
_OF_USERS = (".aws", ".ssh", ".gnupg", ".prefect", ".docker", ".kube", ".netrc", ".config", ".s3cfg")
_SQLITE = "sqlite:///"
_DEFAULT_PORTS = {"http": 80, "https": 443}

_logger = logging.getLogger(__name__)


@cache
def _warn_once(text: str) -> None:
    _logger.warning("%s", text)


def plan_box(
    settings: Settings,
    confinement: Confinement,
    user_home: Path | None = None,
    warn: Callable[[str], None] = _warn_once,
    endpoint: str | None = None,
) -> BoxPlan:
    """Decides how a run's processes are sandboxed, and returns the plan of that.

    Args:
        settings: Settings of the service.
        confinement: Strongest sandbox level that this machine supports.
        user_home: Home folder of this process's user; None: the system's.
        warn: Function that is called once with a warning about a weaker sandbox.
        endpoint: URL of the service's endpoint, if this process knows one.

    Raises:
        LaunchError: The settings require more than this machine has.
    """
    if settings.sandbox == "off":
        return BoxPlan()
    level, why = confinement
    lacks = ""
    if level == "none":
        lacks = f"simulation jobs are not confined on this machine: {why}"
    elif level != "box" and settings.sandbox_network != "full":
        lacks = f"the network of simulation jobs cannot be {settings.sandbox_network!r} on this machine: {why}"
    if lacks and settings.sandbox == "require":
        raise LaunchError(
            f"{lacks}; ROBOMAKER_SANDBOX=require refuses to run them so: allow user namespaces, or set it to auto",
            _CODE,
        )
    if lacks:
        warn(f"{lacks} (see `robomaker doctor`)")
    network = settings.sandbox_network if level == "box" else "full"
    servers = (settings.object_store, endpoint or "") if network == "local" else ()
    return BoxPlan(
        level=level,
        network=network,
        services=sorted({port for url in servers if (port := _local_port(url)) is not None}),
        shown=list(settings.sandbox_show),
        hidden=_hidden(settings, user_home or Path.home()),
    )


def _local_port(url: str) -> int | None:
    """Returns the port of a URL's server on this machine; `None`: it is elsewhere, or the URL has no server."""
    with suppress(ValueError):  # it is no URL
        parts = urlsplit(url)
        if parts.hostname in ("127.0.0.1", "localhost"):
            return parts.port or _DEFAULT_PORTS.get(parts.scheme)
    return None


def _hidden(settings: Settings, user_home: Path) -> list[Path]:
    """Returns paths of the service and the user that are hidden even inside visible folders."""
    hidden = [settings.home, *(user_home / name for name in _OF_USERS)]
    hidden += [file for file in (settings.access_keys_file, settings.roles_file) if file is not None]
    if settings.object_store.startswith("/"):
        hidden.append(Path(settings.object_store))
    if settings.catalog_url.startswith(_SQLITE):
        catalog = settings.catalog_url.removeprefix(_SQLITE)
        hidden += [Path(catalog + end) for end in ("", "-wal", "-shm", "-journal")]
    return hidden


class Cores:
    """Assigns processor cores to runs: counts how many runs use each core; threads may share it.

    Args:
        available: Numbers of the cores; absent: those that this process may use.
        first: Index of the first core to assign, so that job workers on one machine do not all begin with the same
            core; absent: depends on the process id.
    """

    def __init__(self, available: list[int] | None = None, first: int | None = None) -> None:
        cores = sorted(os.sched_getaffinity(0)) if available is None else available
        start = (os.getpid() if first is None else first) % len(cores)
        self._runs = dict.fromkeys(cores[start:] + cores[:start], 0)
        self._lock = threading.Lock()

    @contextmanager
    def taken(self, count: int | None) -> Iterator[list[int] | None]:
        """Yields the least used cores, and counts them as used inside the `with` block.

        Args:
            count: Number of cores; None: all available ones.

        Yields:
            Numbers of the cores; None for all cores.
        """
        if count is None or count >= len(self._runs):
            yield None
            return
        with self._lock:
            chosen = sorted(self._runs, key=self._runs.__getitem__)[:count]
            self._add(chosen, 1)
        try:
            yield chosen
        finally:
            with self._lock:
                self._add(chosen, -1)

    def _add(self, cores: list[int], runs: int) -> None:
        for core in cores:
            self._runs[core] += runs
