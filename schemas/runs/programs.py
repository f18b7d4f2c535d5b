"""Programs of a simulation run (applications that are processes, and tools beside them), and what confines them."""

from pathlib import Path
from typing import Literal

from pydantic import Field

from ..wire.base import Model, optional
from ..wire.job_configs import ExitBehavior

ApplicationRole = Literal["robot", "simulation"]
ProgramKind = Literal["application", "tool"]
FailureBehavior = Literal["Fail", "Continue"]
SandboxMode = Literal["auto", "require", "off"]
BoxLevel = Literal["box", "landlock", "none"]
"""`box`: namespaces of its own; `landlock`: rules of the kernel for files; `none`: nothing."""
BoxNetwork = Literal["full", "local", "none"]
"""`full`: the machine's; `none`: one of its own, in which only processes of the run are; `local`: the same, with the
service's own servers on this machine."""
DISK_BYTES = 128 * 10**9
"""The disk that a job of the service had."""


class ProgramPlan(Model):
    """One program, resolved to something that can be executed on this machine."""

    name: str = Field(
        pattern=r"^[A-Za-z0-9_.-]+$",
        description="Unique in the run; names its logs: `robot`, `simulation`, `robot-<tool>`.",
    )
    role: ApplicationRole = Field(description="The application that it is, or beside which it runs.")
    kind: ProgramKind = Field(description="An application, whose end ends the job, or a tool.")
    argv: list[str] = Field(min_length=1, description="Program and arguments, as for `execvpe`.")
    folder: Path = Field(description="Its working directory.")
    image_id: str | None = optional(
        "SHA-256 by which the engine knows the image of an application that is a container."
    )
    environment: dict[str, str] = Field(
        default={}, description="Variables besides those that every process of the run has."
    )
    exit_behavior: ExitBehavior = Field(default="FAIL", description="Effect that the end of a tool has on the run.")
    cleanup_argv: list[str] | None = optional(
        "Ends what killing the process does not reach, such as `docker rm -f NAME`."
    )


class ToolEnds(Model):
    """A tool that ended while its run went on, and was started again."""

    role: ApplicationRole = Field(description="The application beside which it ran.")
    name: str = Field(description="Its name in the request.")
    ends: int = Field(ge=1, description="How often it ended, or could not be started.")
    last_end: str = Field(description="How it ended the last time, in words: `exited with code 1`.")

    def __str__(self) -> str:
        """All of it in words, without whose tool it is: `ended 14 times, and last exited with code 1`."""
        return self.last_end if self.ends == 1 else f"ended {self.ends} times, and last {self.last_end}"


class PortPlan(Model):
    """One port of an application that is reachable under another number, on this machine only."""

    job_port: int = Field(ge=1, le=65535, description="Port on 127.0.0.1.")
    application_port: int = Field(ge=1024, le=65535, description="Port that the application listens on.")


class ComputeLimits(Model):
    """Limits on a run's use of the machine."""

    cpus: int | None = Field(default=None, ge=1, description="Processor cores at most; absent: all there are.")
    memory_bytes: int | None = Field(default=None, gt=0, description="Memory of all its processes; absent: no limit.")
    processes: int | None = Field(default=1024, ge=1, description="Processes and threads at once; absent: no limit.")
    disk_bytes: int | None = Field(
        default=DISK_BYTES, gt=0, description="Bytes that it may write into its folders; absent: no limit."
    )
    nice: int = Field(default=0, ge=0, le=19, description="Its niceness at least: how far all else comes first.")
    gpu: bool = Field(default=False, description="Whether it may use the machine's first GPU.")


class BoxPlan(Model):
    """Confinement of a run's processes."""

    level: BoxLevel = Field(default="none", description="How its processes are confined.")
    network: BoxNetwork = Field(
        default="full",
        description="Network that they reach: the machine's, each other and the service, or only each other.",
    )
    services: list[int] = Field(
        default=[], description="With `local`: ports of 127.0.0.1 at which the machine's servers are reached."
    )
    shown: list[Path] = Field(default=[], description="Files and folders that they may read besides their own.")
    hidden: list[Path] = Field(default=[], description="Files and folders that they must not see, wherever these are.")


class FoundFiles(Model):
    """Files in a run's folders before anything of it ran: data sources, copied bundles, files of images."""

    size_bytes: int = Field(ge=0, description="Disk space that they took, in bytes, which is not what the run used.")
    at_s: float = Field(description="When that was, in seconds since 1970.")
