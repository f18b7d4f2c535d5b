"""Programs of a simulation run, their sandbox, the resources they wait for, and reasons to stop them."""

from collections.abc import Mapping
from enum import StrEnum
from pathlib import Path
from typing import Literal

from pydantic import Field

from ..wire.base import Model, optional
from ..wire.job_configs import ExitBehavior

ApplicationRole = Literal["robot", "simulation"]
ProgramKind = Literal["application", "tool"]
TOPIC_RECORDER = "ros-topics"
"""Name of the recorder of ROS topics among the programs of a run, after its application's role and a dot."""
FailureBehavior = Literal["Fail", "Continue"]
SandboxMode = Literal["auto", "require", "off"]
BoxLevel = Literal["box", "landlock", "none"]
"""Sandbox level: `box` is namespaces of its own, `landlock` is Landlock rules for files, `none` is no sandbox."""
BoxNetwork = Literal["full", "local", "none"]
"""Network of a sandbox: `full` is the machine's, `none` is a network with only processes of the run, `local` also has
the service's own servers on this machine.
"""
DISK_BYTES = 128 * 10**9
"""Disk size of a job in AWS RoboMaker, in bytes."""


class ProgramPlan(Model):
    """A program of a simulation run, resolved to an executable, arguments and environment on this machine."""

    name: str = Field(
        pattern=r"^[A-Za-z0-9_.-]+$",
        description="Name of the program, unique in the run, and of its logs: `robot`, `simulation`, `robot-<tool>`.",
    )
    role: ApplicationRole = Field(description="Role of the application that the program is, or beside which it runs.")
    kind: ProgramKind = Field(description="Kind of program: an application, whose end ends the job, or a tool.")
    argv: list[str] = Field(min_length=1, description="Program and arguments, as for `execvpe`.")
    folder: Path = Field(description="Working directory.")
    image_id: str | None = optional("SHA-256 id of the container image of an application that is a container.")
    environment: dict[str, str] = Field(
        default={}, description="Environment variables in addition to those of all processes of the run."
    )
    exit_behavior: ExitBehavior = Field(default="FAIL", description="Effect of a tool's end on the run.")
    cleanup_argv: list[str] | None = optional(
        "Command that ends what remains after the process is killed, such as `docker rm -f NAME`."
    )


class ToolEnds(Model):
    """Numbers of exits and restarts of a tool (a program beside the application) during the run."""

    role: ApplicationRole = Field(description="Role of the application beside which the tool ran.")
    name: str = Field(description="Name of the tool in the request.")
    ends: int = Field(ge=1, description="Number of times that it ended, or could not be started.")
    last_end: str = Field(description="Description of its last end: `exited with code 1`.")

    def __str__(self) -> str:
        """Describes exits and restarts, without the tool's name: `ended 14 times, and last exited with code 1`."""
        return self.last_end if self.ends == 1 else f"ended {self.ends} times, and last {self.last_end}"


class PortPlan(Model):
    """Mapping of an application's port to another port number on this machine."""

    job_port: int = Field(ge=1, le=65535, description="Port on 127.0.0.1.")
    application_port: int = Field(ge=1024, le=65535, description="Port that the application listens on.")


class ComputeLimits(Model):
    """CPU, GPU and memory limits of a simulation run."""

    cpus: int | None = Field(default=None, ge=1, description="Maximum number of processor cores; absent: all.")
    memory_bytes: int | None = Field(
        default=None, gt=0, description="Memory limit of all processes, in bytes; absent: no limit."
    )
    processes: int | None = Field(
        default=1024, ge=1, description="Maximum number of processes and threads at the same time; absent: no limit."
    )
    disk_bytes: int | None = Field(
        default=DISK_BYTES,
        gt=0,
        description="Maximum number of bytes written into the run's folders; absent: no limit.",
    )
    nice: int = Field(
        default=0,
        ge=0,
        le=19,
        description="Minimum niceness of the run's processes: how much other processes are preferred.",
    )
    gpu: bool = Field(default=False, description="Whether the run may use the machine's first GPU.")


class BoxPlan(Model):
    """Sandbox of a run's processes: the files and network that they may access."""

    level: BoxLevel = Field(default="none", description="Sandbox level of the processes.")
    network: BoxNetwork = Field(
        default="full",
        description="Network of the processes: the machine's, the run's and the service's, or only the run's.",
    )
    services: list[int] = Field(
        default=[], description="With `local`: ports of 127.0.0.1 at which the machine's servers are reached."
    )
    shown: list[Path] = Field(
        default=[], description="Files and folders that the processes may read besides their own."
    )
    hidden: list[Path] = Field(default=[], description="Files and folders that are hidden from the processes.")


class FoundFiles(Model):
    """Files in a run's folders before its programs started (data sources, bundles), which are not outputs."""

    size_bytes: int = Field(
        ge=0, description="Disk space of the files in bytes, which does not count as used by the run."
    )
    at_s: float = Field(description="Time of the measurement, in seconds since 1970.")


Scarce = Literal["slots", "memory", "disk"]
"""Resource of the machine that a job waits for."""

WAITS_FOR: Mapping[Scarce, str] = {"slots": "a slot", "memory": "memory", "disk": "disk"}
"""Descriptions of scarce resources, for texts after `waits for`."""

Wait = Scarce | Literal["worker"]
"""Resource that the jobs of a run wait for: one of this machine, or a job worker elsewhere."""

IN_WORDS: Mapping[Wait, str] = {**WAITS_FOR, "worker": "a job worker"}
"""Descriptions of all resources, for texts after `waits for`."""

NOTICED_S = 1.0
"""Minimum wait in seconds that is recorded."""


def noticed(waited_s: Mapping[Scarce, float]) -> dict[Scarce, float]:
    """Returns the waits for scarce resources that were long enough to be recorded, in seconds by resource.

    Args:
        waited_s: Seconds of waiting by resource.
    """
    return {scarce: round(time_s, 1) for scarce, time_s in waited_s.items() if time_s >= NOTICED_S}


class StopReason(StrEnum):
    """Reason why a simulation job has to stop. Reasons that concern a batch are failure codes of its jobs."""

    CANCELED = "Canceled"
    """The job itself was cancelled, or another worker has taken it over."""

    BATCH_CANCELED = "BatchCanceled"
    BATCH_TIMED_OUT = "BatchTimedOut"


STOPPING: Mapping[str, StopReason] = {
    "Canceling": StopReason.BATCH_CANCELED,
    "TimingOut": StopReason.BATCH_TIMED_OUT,
}
"""Reason why the jobs of a batch have to stop, by the batch's status."""

STOP_EVENTS: Mapping[str, str] = {StopReason.BATCH_CANCELED: "cancel", StopReason.BATCH_TIMED_OUT: "time_out"}
"""Event of the batch by the reason; the keys are the failure codes of its jobs."""


class RunStop(StrEnum):
    """Reason why a run was stopped from outside, with the values of `RunResult.ended_by`."""

    DURATION_LIMIT = "duration limit"
    CANCELED = "canceled"
