"""Makes the request for a run: its plan and its run environment."""

import os
import sys
from pathlib import Path

from ....schemas.runs.plan import RunPlan
from ....schemas.runs.programs import BoxPlan, ProgramPlan
from ....schemas.runs.variables import variables_of
from ..agents.agent_client import SOCKET_VARIABLE
from ..agents.agent_socket import agent_socket_path
from ..process.run_request import RunRequest
from ..rendering.backends import best_video_backend
from ..sandbox.views import paths_in
from ..video.recorded_camera_settings import camera_recording
from ..video.video_settings import settings_of

DEFAULT_VARIABLES = {
    # Runs are parallel to each other; threads inside numpy would only fight over the cores.
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    # Mesa's software renderer draws in the thread that asks.
    "LP_NUM_THREADS": "0",
    # The order of sets of strings is part of what a seed has to repeat.
    "PYTHONHASHSEED": "0",
    "MUJOCO_GL": "disable",
}
_INHERITED_VARIABLES = frozenset(
    {
        *("PATH", "HOME", "USER", "LOGNAME", "SHELL", "LANG", "LANGUAGE", "TZ", "TMPDIR", "XDG_RUNTIME_DIR"),
        *("LD_LIBRARY_PATH", "VIRTUAL_ENV", "PYTHONPATH", "PYTHONDONTWRITEBYTECODE"),
        *("CUDA_VISIBLE_DEVICES", "NVIDIA_VISIBLE_DEVICES", "NVIDIA_DRIVER_CAPABILITIES"),
        *("MUJOCO_EGL_DEVICE_ID", "__EGL_VENDOR_LIBRARY_DIRS", "LIBGL_DRIVERS_PATH"),
        "MENAGERIE_ROOT",
    }
)
_GPU_VARIABLES = ("CUDA_VISIBLE_DEVICES", "NVIDIA_VISIBLE_DEVICES")


def make_request(plan: RunPlan, cores: list[int] | None, box: BoxPlan | None = None) -> RunRequest:
    """Adds to a plan what this process knows: its import path, its environment, how to render.

    Args:
        plan: The run. Relative paths are those of this process.
        cores: Processor cores it may use; None: all.
        box: What it is confined to; None: to nothing.

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
    box = box.model_copy(update={"shown": [*box.shown, *paths_in(os.environ)]})
    home = {"HOME": str(plan.root_dir / "home" / "robomaker")} if plan.root_dir else {}
    if box.level == "box":
        home["TMPDIR"] = "/tmp"  # noqa: S108 - the box's own
    return RunRequest(
        plan=plan,
        environment={
            **DEFAULT_VARIABLES,
            **inherited_environment(),
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
    """This process's variables that runs may see: no credentials, no settings of services."""
    return {key: value for key, value in os.environ.items() if key in _INHERITED_VARIABLES or key.startswith("LC_")}


def program_environment(request: RunRequest, program: ProgramPlan) -> dict[str, str]:
    """The whole environment of one of the plan's programs."""
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
    return environment


def _fixed_variables(plan: RunPlan) -> dict[str, str]:
    """Variables that an application cannot set otherwise."""
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
