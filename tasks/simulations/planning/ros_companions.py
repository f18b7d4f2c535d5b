"""Programs that a run starts beside a launch of ROS: the node of the job's services, and what records all topics."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from ....schemas.runs.programs import ProgramPlan
from ..environment.folders import TEMPORARY, remove
from ..environment.overlays import own_program
from ..environment.run_environment import RunEnvironment
from ..ros.job_services import FOLDER, NODE, make_message_package, message_variables
from .launching import Code, Program, in_ros

TOPICS = "ros-topics"
"""The bag of a run's topics is called so, and so is the log that says why there is none."""


@dataclass(frozen=True)
class RosLaunch:
    """An application that ROS launches."""

    code: Code
    launch: Program
    program: ProgramPlan


def with_ros_companions(
    programs: Sequence[ProgramPlan], ros: RosLaunch | None, run_environment: RunEnvironment, *, wants_topics: bool
) -> list[ProgramPlan]:
    """A run's programs, and those that it starts beside them for ROS.

    Args:
        programs: the applications that are programs, and tools.
        ros: the first of them that ROS launches; `None`: none is.
        run_environment: what they find.
        wants_topics: whether all ROS topics are to be recorded.
    """
    found = list(programs)
    if ros is not None and ros.launch.ros is not None:
        found = _with_services(found, ros, run_environment)
    if wants_topics and found:
        recorder = _recorder(ros, run_environment)
        if isinstance(recorder, str):
            log = run_environment.plan.output_dir / "logs" / f"{TOPICS}.log"
            log.parent.mkdir(exist_ok=True)
            log.write_text(f"loggingConfig.recordAllRosTopics: no ROS topics are recorded: {recorder}\n")
        else:
            found.append(recorder)
    return found


def _with_services(programs: list[ProgramPlan], ros: RosLaunch, run_environment: RunEnvironment) -> list[ProgramPlan]:
    """The job's services, where its ROS has what nodes in Python need; all programs find the package of messages."""
    folder = run_environment.sandbox.root / FOLDER
    folder.mkdir(parents=True)

    def node(task: str) -> tuple[str, ...]:
        assert ros.launch.launcher is not None
        return in_ros(ros.code, ros.launch.launcher, ("python3", str(NODE), task, str(ros.launch.ros), str(folder)))

    if not make_message_package(node("make"), ros.program.environment):
        remove(folder)
        return programs
    found = [
        program
        if program.image_id
        else program.model_copy(
            update={"environment": {**program.environment, **message_variables(folder, program.environment)}}
        )
        for program in programs
    ]
    variables = message_variables(folder, ros.program.environment)
    return [*found, _companion(ros, "ros-services", node("serve"), run_environment, variables)]


def _recorder(ros: RosLaunch | None, run_environment: RunEnvironment) -> ProgramPlan | str:
    """Returns the program that records all topics of a run, or why there is none."""
    if ros is None or ros.launch.launcher is None:
        return "no application is started by a launch file of ROS; record in the application, or in a tool of it"
    bag = run_environment.plan.output_dir / TOPICS
    name, argv = {
        1: ("rosbag", ("record", "--all", "--output-name", f"{bag}.bag")),
        2: ("ros2", ("bag", "record", "--all", "--output", str(bag))),
    }[ros.launch.ros or 1]
    program = own_program(ros.code.folder, name) or run_environment.which(name)
    if program is None:
        return f"{name} is not installed where the job runs"
    return _companion(ros, TOPICS, in_ros(ros.code, ros.launch.launcher, (str(program), *argv)), run_environment, {})


def _companion(
    ros: RosLaunch, name: str, argv: Sequence[str], run_environment: RunEnvironment, variables: Mapping[str, str]
) -> ProgramPlan:
    """A program beside a launch; its own log is none of the application's, which are uploaded from the job's home."""
    logs: Path = run_environment.sandbox.place(f"{TEMPORARY}/{name}")
    return ProgramPlan(
        name=f"{ros.program.role}.{name}",  # a tool's name has a dash there
        role=ros.program.role,
        kind="tool",
        argv=list(argv),
        folder=ros.program.folder,
        environment={**ros.program.environment, **variables, "ROS_LOG_DIR": str(logs)},
        exit_behavior="RESTART",
    )
