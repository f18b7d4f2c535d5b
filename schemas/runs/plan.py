"""Run plan and outcome: the contract between the caller of a simulation run and the process that runs it.

`RunPlan` goes in; a folder of outputs and a `RunOutcome` come out. `RunResult` is the content of
`result.json` in that folder.

| file in the output folder | content |
| --- | --- |
| `result.json` | `RunResult` |
| `recording.mcap`, `metadata.yaml` | ROS 2 messages, as a rosbag2 |
| `foxglove-layout.json` | how Foxglove shows them |
| `provenance.json`, `digest.bin` | what its numbers depend on, the digest of its states |
| `actions.bin` | what a robot application that is a program did, step by step |
| `timeline.json` | margins and lengths of logs by simulated time, and the times that videos show |
| `logs/stdout.log`, `logs/stderr.log` | what the applications printed |
| `logs/<program>.stdout.log`, `….stderr.log` | what a program of the run printed |
| `video.mp4`, `poster.png` | when asked for |
| `last-10s.mp4` | of a run that failed, when asked for |
| `trials.parquet` | of a job with trials: a row for each (`TrialRow`) |
| `trials/000012` | outputs of a trial that was recorded |
| `failure-state.json`, `.npy`, `failure-model.mjb` | the physics of a run that broke after MuJoCo had warned |
"""

import math
from collections.abc import Callable, Mapping
from datetime import datetime
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field

from ..wire.base import Model, ShapeName, optional
from .axes import AxisSetting
from .programs import ApplicationRole, ComputeLimits, FailureBehavior, FoundFiles, PortPlan, ProgramPlan, ToolEnds
from .requirement_kinds.kind import Requirement
from .requirement_kinds.off import NO_HARD_COLLISION, ROOMS_VISITED
from .requirements import JobRequirements
from .ros_options import RosPlan
from .trials import Trials

Verdict = Literal["PASS", "FAIL", "ERROR", "NONE"]
VideoPolicy = Annotated[Literal["none", "on-failure", "always"], ShapeName("VideoPolicy")]


class ApplicationPlan(Model):
    """An application of a simulation run, resolved to an importable Python object or to one of the plan's programs."""

    role: ApplicationRole = Field(description="Robot application (makes an agent) or simulation application.")
    name: str = Field(description="Name of the application in the catalog.")
    attribute: str | None = optional(
        "Dotted path of the factory, `package.module.make_environment` or `….make_agent`; "
        "absent: the application is a program of the plan."
    )
    path: Path | None = optional(
        "Folder to import it from (an unpacked bundle), or that its program is from; absent: installed."
    )
    package: str | None = optional(
        "Installed package that contains the program; absent: it is in an archive or image, or there is no program."
    )
    policy: str | None = optional("Policy of the agent that the factory `attribute` makes; absent: none.")
    environment_variables: dict[str, str] = Field(
        default={},
        description="Launch variables of the application; for a container, only those that configure the run.",
    )


class RecordedActions(Model):
    """Recorded robot actions that are played back in a rerun instead of running the robot application."""

    path: Path = Field(description="Path of the run's `actions.bin`.")
    ended_by: Literal["agent", "duration limit"] | None = optional(
        "Cause that ends the rerun after the last action; absent: the rerun fails then, as the run did."
    )


class RunPlan(Model):
    """Complete plan of one simulation run on this machine: world, applications, programs, limits and folders."""

    job_id: str = Field(description="Id of the simulation job, `sim-…`.")
    job_arn: str = Field(description="ARN of the simulation job.")
    run_id: str = Field(description="Id of this run of the job.")
    seed: int = Field(ge=0, description="Seed of the run's random generators.")
    max_duration_s: float = Field(
        gt=0, description="Wall-clock time limit in seconds; reaching it ends the job normally."
    )
    world_dir: Path | None = optional("Folder of the world's files, read-only.")
    data_dir: Path | None = optional("Folder of the job's data sources, read-only.")
    root_dir: Path | None = optional(
        "The job's own root: its `/home/robomaker/x` is `<root_dir>/home/robomaker/x` here; "
        "absent: applications get none."
    )
    work_dir: Path = Field(description="Scratch folder, which is the process's working directory.")
    output_dir: Path = Field(description="Folder for the run's outputs.")
    checkpoint_dir: Path | None = optional(
        "Folder for checkpoints, from which the run is resumed if there are any; absent: no checkpoints."
    )
    checkpoint_every_s: float | None = Field(
        default=5.0, gt=0, description="Simulated seconds between two checkpoints; absent: none are made."
    )
    simulation_application: ApplicationPlan | None = optional(
        "Application that makes the environment; absent: `indoor-navigation`."
    )
    robot_application: ApplicationPlan | None = optional("Application that makes the agent; absent: `scout`.")
    environment: dict[str, str] = Field(
        default={},
        description="Variables of every process of the run, over those that the launcher keeps of its own and under "
        "those of launch configurations.",
    )
    programs: list[ProgramPlan] = Field(
        default=[], description="Programs of the run: applications that are processes, and all tools."
    )
    ports: list[PortPlan] = Field(default=[], description="Forwarded ports.")
    compute: ComputeLimits = Field(default=ComputeLimits(), description="Resource limits of the run.")
    found: FoundFiles | None = optional(
        "Files that exist in the run's folders before it begins; absent: measured at the begin."
    )
    failure_behavior: FailureBehavior = Field(
        default="Fail",
        description="Whether a crash ends the run (`Fail`), or its other programs continue (`Continue`).",
    )
    record: bool = Field(default=True, description="Whether `recording.mcap` is written.")
    video: VideoPolicy = Field(default="none", description="Whether `video.mp4` is written.")
    live_view_port: int | None = Field(
        default=None,
        ge=0,
        le=65535,
        description="Port on 127.0.0.1 of a page that shows the run while it goes on; 0: any free one; absent: none.",
    )
    requirements: JobRequirements = Field(
        default=[], description="Requirements by which the run is judged, as in the job's request."
    )

    ros: RosPlan | None = optional(
        "ROS bridge, if the robot application is a program that may be ROS nodes; absent: none."
    )
    trials: Trials | None = optional("Trials, which run one after the other; absent: a single episode.")
    trial: int | None = Field(default=None, ge=0, description="Number of the trial that is run; absent: the whole job.")
    axes: dict[str, AxisSetting] = Field(
        default={},
        description="Numeric axis values of the trial, by name; values of variables are in `variables`.",
    )
    recorded_actions: RecordedActions | None = optional(
        "Actions that replace the robot application's program in a rerun."
    )
    end_at_s: float | None = Field(
        default=None,
        ge=0,
        description="Simulated time in seconds at which a rerun ends if the original run was stopped from outside.",
    )

    @property
    def has_episode(self) -> bool:
        """Whether a process of the run steps a `dm_env` environment; otherwise it only has programs.

        A job without a simulation application means `indoor-navigation`, unless its robot application is a
        program, which then runs alone.
        """
        if self.simulation_application is not None:
            return self.simulation_application.attribute is not None
        return self.robot_application is None or self.robot_application.attribute is not None

    @property
    def has_robot_program(self) -> bool:
        """Whether the robot application is a separate program, which drives the environment over a socket."""
        return self.has_episode and self.robot_application is not None and self.robot_application.attribute is None

    @property
    def is_rerun(self) -> bool:
        """Whether the run repeats another run and ends at that run's last step, even if that one was stopped early."""
        return self.end_at_s is not None or self.recorded_actions is not None

    def with_paths(self, change: Callable[[Path], Path]) -> "RunPlan":
        """Returns a copy of the plan in which a function has changed every path.

        Args:
            change: Called with each path that the plan has.
        """
        folders = ("world_dir", "data_dir", "root_dir", "work_dir", "output_dir", "checkpoint_dir")
        changes: dict[str, Any] = {name: change(path) for name in folders if (path := getattr(self, name)) is not None}
        for name in ("simulation_application", "robot_application"):
            application = getattr(self, name)
            if application is not None and application.path is not None:
                changes[name] = application.model_copy(update={"path": change(application.path)})
        programs = [program.model_copy(update={"folder": change(program.folder)}) for program in self.programs]
        return self.model_copy(update={**changes, "programs": programs})


class JudgedCounts(Model):
    """Numbers of requirements, or of trials, by how they were judged."""

    passed: int = Field(default=0, description="Number of those that were met, or passed.")
    failed: int = Field(default=0, description="Number of those that were missed, or failed.")
    errors: int = Field(default=0, description="Number of those that could not be judged.")


class Judged(Model):
    """Numbers behind the verdict of a run: of its requirements, or where it has trials, of these."""

    requirements: JudgedCounts | None = optional("Requirements that count; absent: the run has trials.")
    trials: JudgedCounts | None = optional("Trials; absent: the run has none.")


class RunOutcome(Model):
    """End of a simulation run: status, verdict, failure code and reason."""

    status: Literal["Completed", "Failed", "Canceled"] = Field(description="Final status of the job.")
    failure_code: str | None = optional("Failure code of the job; absent if it did not fail.")
    failure_reason: str | None = optional("Reason of the failure as text, ending with the last log lines.")
    started_at: datetime = Field(description="Time at which the run's process began.")
    ended_at: datetime = Field(description="Time at which all processes of the run had ended.")
    video_s: float | None = optional("Wall-clock seconds for rendering videos of the failure; absent: none.")
    cpu_time_s: float | None = optional(
        "CPU seconds of the run's processes, without containers; absent: the supervisor was killed."
    )
    verdict: Verdict | None = optional("Verdict of a completed run with a result.")
    verdict_reason: str | None = optional("Reason of the verdict FAIL or ERROR, as text.")
    judged: Judged | None = optional("Numbers behind the verdict; absent: there is none.")
    timed_out: bool = Field(default=False, description="Whether the run ended at its duration limit.")
    finished: bool = Field(
        default=False,
        description="Whether the outputs are complete; not after a crash or kill.",
    )
    was_killed: bool = Field(
        default=False,
        description=(
            "Whether the run was killed from outside and will be tried again, so that its files were left unchanged."
        ),
    )


class RoomVisit(Model):
    """Whether, and at which simulated time, the robot was in a room of the world."""

    name: str = Field(description="Name of the room.")
    visited: bool = Field(description="Whether the robot's centre was inside the room.")
    first_visit_s: float | None = optional("Simulated time of the first visit.")


class Collision(Model):
    """One collision of the robot with something other than the floor, from first contact to separation."""

    time_s: float = Field(description="Simulated time of the first contact, in seconds.")
    duration_s: float = Field(description="Duration of the collision in seconds.")
    x: float = Field(description="Robot position x at first contact, in metres.")
    y: float = Field(description="Robot position y at first contact, in metres.")
    other: str = Field(description="Object that was touched: a furniture id, `wall`, or a body's name.")
    max_force_N: float = Field(description="Largest normal force, in newtons.")


ENVIRONMENT_VERDICT = "environment_verdict"
"""Entry of `extra`: the environment's own FAIL, where none of its own requirements tells of it."""

_WENT_ON_WITHOUT = {"video_error": "no video", "camera_error": "no camera in the recording"}
"""Entries of `extra` with the reason for a missing output, each with a description of the output."""


def _missed_at(requirement: Requirement) -> float:
    """Returns the simulated time at which a requirement was missed; infinite if that showed at the end."""
    return math.inf if requirement.first_violation_s is None else requirement.first_violation_s


class RunResult(Model):
    """Content of a simulation run's `result.json`: verdict, requirements, metrics, rooms and collisions."""

    schema_version: Literal[1] = Field(default=1, description="Format version of this document.")
    verdict: Verdict = Field(
        description="PASS, FAIL (the robot did badly), ERROR (something broke, so that it could not be judged), or "
        "NONE when nothing is judged, as in a run that was cancelled."
    )
    summary: str = Field(default="", description="One-sentence summary for people.")
    notes: list[str] = Field(default=[], description="Notes that are shown with the verdict.")
    requirements: list[Requirement] = Field(default=[], description="Requirements by which the run was judged.")
    metrics: dict[str, float] = Field(
        default={}, description="Metrics by name with unit: `distance_m`, `sim_time_s`, `collisions`, …"
    )
    rooms: list[RoomVisit] = Field(default=[], description="Rooms, in the world's order.")
    collisions: list[Collision] = Field(default=[], description="Collisions in order, at most 200.")
    path: list[tuple[float, float, float]] = Field(
        default=[], description="(simulated time in s, x, y) of the robot, at most 600 points."
    )
    sim_time_s: float = Field(description="Simulated time at the end, in seconds.")
    wall_time_s: float = Field(description="Wall-clock time of the simulation steps, in seconds.")
    real_time_factor: float = Field(description="Real-time factor: `sim_time_s / wall_time_s`.")
    ended_by: str = Field(
        description="`environment`, `agent`, `requirements`, `application` (a program, in a run without an episode), "
        "`duration limit` or `canceled`."
    )
    seed: int = Field(description="Seed of the run.")
    versions: dict[str, str] = Field(default={}, description="Versions of mujoco, dm_control and this package.")
    state_digest: str | None = optional(
        "Digest of all states, of the physics or as the environment gives them; absent when there is none."
    )
    tools: list[ToolEnds] = Field(default=[], description="Tools that ended during the run.")
    extra: dict[str, Any] = Field(default={}, description="Other values that environment or agent reported.")

    @property
    def missed(self) -> list[Requirement]:
        """Requirements that made the verdict FAIL or ERROR: errors, then in the order in which they were missed.

        Of those missed at the same time, or at the end, the job's own come before the environment's.
        """
        missed = [item for item in self.requirements if item.counts and not item.satisfied]
        return sorted(missed, key=lambda item: (item.error is None, _missed_at(item), item.kind is None))

    @property
    def reason(self) -> str | None:
        """Reason for the verdict FAIL or ERROR: the measured and the required value; `None` for other verdicts."""
        if self.verdict not in ("FAIL", "ERROR"):
            return None
        told = [item for item in self.missed if not self._goes_without_saying(item)] or self.missed
        return "; ".join(f"{item.name}: {item.detail}" for item in told) or self.summary

    def _goes_without_saying(self, item: Requirement) -> bool:
        """Returns whether a missed requirement of the environment follows from what the job's own requirements say.

        The job's ended the run before all rooms could be visited, or tell of its hardest collision.
        """
        if item.kind is not None or item.error is not None:
            return False
        if item.name == ROOMS_VISITED:
            return self.ended_by == "requirements"
        return item.name == NO_HARD_COLLISION and any(map(self._tells_hardest, self.missed))

    def _tells_hardest(self, item: Requirement) -> bool:
        """Returns whether a missed requirement of the job tells of the hardest collision of the run.

        It has that force, or is about the thing that was hit; `others` and `ignore` may leave that out.
        """
        hardest = max(self.collisions, key=lambda each: each.max_force_N, default=None)
        if item.kind != "no_collision" or hardest is None:
            return False
        has_force = item.unit == "N" and item.value is not None and round(item.value, 2) >= hardest.max_force_N
        return has_force or item.other == hardest.other

    def unjudged(self) -> "RunResult":
        """Returns the result without a verdict, for a run that was cancelled."""
        requirements = [item.model_copy(update={"counts": False}) for item in self.requirements]
        summary = f"Canceled at {self.sim_time_s:.1f} s, so that nothing was judged."
        return self.model_copy(update={"verdict": "NONE", "requirements": requirements, "summary": summary})

    @property
    def remarks(self) -> list[str]:
        """Lines to show beside the verdict: notes, and requested outputs that could not be produced."""
        without = [f"{what}: {self.extra[name]}" for name, what in _WENT_ON_WITHOUT.items() if self.extra.get(name)]
        return [*self.notes, *without]

    @property
    def runs_free(self) -> bool:
        """Whether simulated time did not wait for each answer of the robot program, so that a rerun may differ."""
        match self.extra:
            case {"ros": {"time": time, **figures}}:
                return time != "lockstep" or bool(figures.get("unanswered"))
            case {"agent": {"mode": "free"}}:
                return True
            case _:
                return False


_NEEDS_WORLD: Mapping[str, str] = {
    "indoor-navigation": "indoor-navigation drives through a world",
    "scout": "scout plans on the map of a world",
}
_REMEDY = 'name one in the simulation application: worldConfigs: [{"world": "<ARN of a world>"}]'


def why_a_world(application: str) -> str | None:
    """Returns why a job with an application has to name a world, and how; `None`: it brings its own, or needs none.

    Args:
        application: Name of a robot or simulation application.
    """
    need = _NEEDS_WORLD.get(application)
    return need and f"{need} and the job names none; {_REMEDY}"
