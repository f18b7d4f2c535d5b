"""Recorder of all ROS topics of a job: `rosbag` for ROS 1, this package's topic recorder for ROS 2."""

import importlib.util
import sys
from collections.abc import Mapping
from pathlib import Path

from ....schemas.extras import how_to_install
from ....schemas.runs.plan import RunPlan
from ....schemas.runs.programs import TOPIC_RECORDER, ApplicationRole, ProgramPlan
from ...runtime.ros.topic_report import MODULE, LogTimes, RecorderRequest
from ..ros.ros_domains import DOMAIN_VARIABLE

_DISK_SHARE = 8
"""Divisor of the job's disk limit that gives the recorder's limit, so that the recording never ends the run."""
_OURS = ("PYTHONPATH", "PYTHONHOME", "LD_LIBRARY_PATH", "LD_PRELOAD")
"""Names of variables that applications set for themselves, and that would affect this package's Python."""


_ROS_FOLDERS = Path("/opt/ros")
"""Folder in which ROS distributions are installed."""


def with_topic_recorder(plan: RunPlan, launched_by: int | None, environ: Mapping[str, str], most_bytes: int) -> RunPlan:
    """Returns a run's plan with a program added that records all ROS 2 topics, or logs why it cannot.

    A run without programs has nothing to record.

    Args:
        plan: The run.
        launched_by: Version of ROS of the first launch file; `None`: there is none. A launch of ROS 1 has its own
            recorder.
        environ: Environment variables of this process.
        most_bytes: Maximum size of all recorded messages in bytes.
    """
    if not plan.programs or launched_by == 1:
        return plan
    recorder = _recorder(plan, environ, most_bytes)
    if isinstance(recorder, str):
        note_no_recorder(plan.output_dir, recorder)
        return plan
    return plan.model_copy(update={"programs": [*plan.programs, recorder]})


def _recorder(plan: RunPlan, environ: Mapping[str, str], most_bytes: int) -> ProgramPlan | str:
    if plan.ros is not None and plan.ros.suite == 1:
        return "of ROS 1 they are recorded where a launch file starts the nodes; record in a tool of the application"
    if importlib.util.find_spec("cyclonedds") is None:
        return f"cyclonedds is not installed where the job runs: {how_to_install('ros')}"
    options = plan.ros.options if plan.ros is not None else None
    times: LogTimes = "clock" if options is not None else "elapsed" if plan.has_episode else "sent"
    disk_bytes = plan.compute.disk_bytes
    most = most_bytes if disk_bytes is None else min(most_bytes, disk_bytes // _DISK_SHARE)
    # Of a container the folder is its home, which has what the job put there and not what is in the image.
    packages = [*dict.fromkeys(each.folder for each in plan.programs), _ROS_FOLDERS]
    request = RecorderRequest(
        output_dir=plan.output_dir,
        times=times,
        max_bytes=max(1, most),
        packages=packages,
        interface=options.interface if options else None,
        peers=options.peers if options else [],
    )
    role: ApplicationRole = "robot" if any(program.role == "robot" for program in plan.programs) else "simulation"
    return ProgramPlan(
        name=f"{role}.{TOPIC_RECORDER}",  # a tool's name has a dash there
        role=role,
        kind="tool",
        argv=[sys.executable, "-P", "-m", MODULE, request.model_dump_json()],
        folder=plan.work_dir,
        # Of a container its variables are not those of programs beside it; its domain is in the plan.
        environment={
            **{name: environ.get(name, "") for name in _OURS},
            **({DOMAIN_VARIABLE: str(plan.ros.domain)} if plan.ros is not None else {}),
        },
        exit_behavior="RESTART",
    )


def note_no_recorder(output_dir: Path, why: str) -> None:
    """Writes the recorder's log file into the run's outputs, which says why no ROS topics are recorded."""
    log = output_dir / "logs" / f"{TOPIC_RECORDER}.log"
    log.parent.mkdir(exist_ok=True)
    log.write_text(f"loggingConfig.recordAllRosTopics: no ROS topics are recorded: {why}\n")
