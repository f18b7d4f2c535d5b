"""One attempt at a run: loads applications and observers, runs the loop, writes `result.json`, reports failures."""

import os
import random
import sys
import traceback
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np

from ....schemas.runs.plan import ApplicationPlan, RunPlan
from ....schemas.runs.recording_sources import RECORDED_RUN
from ....schemas.runs.requirement_kinds.kind import RequirementError
from ....schemas.runs.ros_options import RosOptions
from ....schemas.wire.errors import LaunchError
from ....schemas.worlds.world import World
from ..agents.recorded_robot import RecordedRobot
from ..agents.remote_robot import RemoteRobot
from ..axes.variation import Variation
from ..episode.context import RobotProgramError, SimulationContext
from ..episode.health import PhysicsHealth
from ..episode.loading import LoadError, load_factory
from ..episode.progress import Phase, Progress, Stop
from ..episode.run_results import (
    RESULT_FILE,
    Episode,
    Findings,
    Observer,
    ReportingEnvironment,
    make_result,
    write_result,
)
from ..recording.recording import McapRecorder, Recorder, RecordingError
from ..ros.ros_robot import RosBridge
from ..states.checkpoints import Checkpointer
from ..states.failure_state import FailureRecorder
from ..video.camera_recorder import INFO_TOPIC, TOPIC, CameraRecorder
from ..video.video_settings import camera_recording
from .observers import make_observers
from .run_loop import run_episode
from .run_request import RunRequest

_RUNTIME_FOLDER = Path(__file__).parents[1]
_APPLICATIONS = tuple(str(_RUNTIME_FOLDER / name) + os.sep for name in ("applications", "robots"))
_MAX_ERROR_CHARACTERS = 2000
_SAY_ALL = LoadError | LaunchError | RobotProgramError
"""Errors whose message says enough; a traceback would not help users."""


def report_failure(error: BaseException, plan: RunPlan, progress: Progress) -> None:
    """Writes an error's traceback to the error log, and its short form to memory shared with the supervisor.

    Deletes `result.json`, as a failed run has none.
    """
    log_failure(error)
    progress.write_report(report_of(error, progress))
    (plan.output_dir / RESULT_FILE).unlink(missing_ok=True)


def log_failure(error: BaseException) -> None:
    """Writes an error's traceback, from the application's code on, to standard error; a failure to do so is ignored."""
    trace = _without_runtime(error.__traceback__)
    with suppress(Exception):  # the disk may be full, and the application may have closed or replaced the stream
        if isinstance(error, _SAY_ALL) and _is_told_whole(error):
            sys.stderr.write(f"{error}\n")
        else:
            traceback.print_exception(type(error), error, trace)


def _is_told_whole(error: BaseException) -> bool:
    """Returns whether an error has no cause whose traceback would help, as one in an application's code would."""
    if error.__cause__ is None:
        return True
    frames = traceback.extract_tb(error.__traceback__)
    # What this package says of a file, such as robot.yaml, has the words of its cause.
    return isinstance(error, LaunchError) and frames[-1].filename.startswith(f"{_RUNTIME_FOLDER}{os.sep}")


def report_of(error: BaseException, progress: Progress) -> dict[str, Any]:
    """Converts an error to the report that the supervisor receives: its text, the phase at fault, and its failure code.

    Args:
        error: Error that ended the run.
        progress: Phase that the run had reached.
    """
    faults = {RecordingError: Phase.FINISHING, RequirementError: Phase.JUDGING}
    phase = next((phase for kind, phase in faults.items() if isinstance(error, kind)), progress.phase)
    if isinstance(error, LaunchError) and error.failure_code.startswith("RobotApplication"):
        phase = Phase.AGENT  # some of what a robot lacks is known at the end only
    what = _describe(error, _without_runtime(error.__traceback__))
    report: dict[str, Any] = {"error": what[:_MAX_ERROR_CHARACTERS], "phase": int(phase)}
    if isinstance(error, LaunchError):
        report["code"] = error.failure_code
    return report


def _describe(error: BaseException, trace: TracebackType | None) -> str:
    if isinstance(error, RobotProgramError):
        return ", ".join([str(error), *getattr(error, "__notes__", ())])  # they say in which step and trial
    if isinstance(error, _SAY_ALL):
        return str(error)
    if isinstance(error, SystemExit):
        text = f"called sys.exit({error.code!r})"
    else:
        text = "".join(traceback.format_exception_only(type(error), error)).strip().replace("\n", ", ")
    place = next(iter(traceback.extract_tb(trace)[-1:]), None)
    return f"{text} ({Path(place.filename).name}, line {place.lineno})" if place else text


def _without_runtime(trace: TracebackType | None) -> TracebackType | None:
    """Returns a traceback without this package's leading frames, so that it begins in an application's code.

    A traceback that has no other frames stays as it is.
    """
    start = trace
    while start is not None and _is_of_runtime(start.tb_frame.f_code.co_filename):
        start = start.tb_next
    return start or trace


def _is_of_runtime(path: str) -> bool:
    """Returns whether a source file belongs to the runtime, and not to an application."""
    return path.startswith(f"{_RUNTIME_FOLDER}{os.sep}") and not path.startswith(_APPLICATIONS)


RECORDING_FILE = "recording.mcap"
BUILT_IN_ENVIRONMENT = ApplicationPlan(
    role="simulation",
    name="indoor-navigation",
    attribute="prefect_robomaker.tasks.runtime.applications.indoor_navigation.make_environment",
)
BUILT_IN_AGENT = ApplicationPlan(
    role="robot", name="scout", attribute="prefect_robomaker.tasks.runtime.applications.scout.make_agent"
)
_RECORDED_RUN = "prefect_robomaker.tasks.runtime.applications.recorded_run"
RECORDED_AGENT = ApplicationPlan(role="robot", name=RECORDED_RUN, attribute=f"{_RECORDED_RUN}.make_agent")
"""Robot application of a run that is judged from its recording: nothing is driven any more."""

_OF_THE_CAMERA = {TOPIC, INFO_TOPIC, "/tf_static"}
"""Topics that the camera of a run writes for an environment; `/tf` is missing, as it may be the environment's own."""


def seed_globals(seed: int) -> None:
    """Seeds the global random generators of Python and NumPy, for applications that use them."""
    random.seed(seed)
    np.random.seed(seed % 2**32)  # noqa: NPY002


def attempt(run: RunRequest, progress: Progress, stop: Stop) -> None:
    """Runs a simulation, from its start or from its last checkpoint, until `result.json` is written.

    Args:
        run: Request with the run's plan.
        progress: Memory for the run's progress and final report.
        stop: Tells whether the run has to stop.

    Raises:
        CheckpointError: The last checkpoint cannot be continued from.
        Exception: Any exception of the applications.
    """
    plan = run.plan
    rng = np.random.default_rng(plan.seed)
    checkpoints = Checkpointer(plan, rng) if plan.checkpoint_dir and plan.checkpoint_every_s else None
    resumes = checkpoints is not None and checkpoints.resumes
    recording = McapRecorder(plan.output_dir / RECORDING_FILE, resume=resumes) if plan.record else Recorder()
    bridge = _bridge(plan, recording)
    recorder = bridge.recorder if bridge is not None else recording
    remote = _remote_robot(plan, stop, bridge)
    variation = Variation({name: setting.kind for name, setting in plan.axes.items()})
    seen_by = make_observers(plan, run.video_backend, applications_of(plan), remote.actions if remote else None)
    observers = [variation, *seen_by]
    camera = camera_recording(plan)
    if camera is not None and (camera.is_recorded or bridge is not None):
        options = (lambda: bridge.options) if bridge is not None else RosOptions
        observers.append(CameraRecorder(recorder, camera, run.video_backend, options))
    if remote is not None:
        observers.insert(0, remote)  # told of the end before others take their time for it
    health = PhysicsHealth()
    try:
        simulation, robot = applications_of(plan)
        context, robot_context = contexts_of(plan, rng, read_world(plan.world_dir), recorder)
        episode = run_episode(
            lambda: variation.applied(watched_environment(factory_of(simulation)(context), progress), plan.axes),
            lambda environment: (remote.make_agent if remote else factory_of(robot))(robot_context, environment),
            mark=progress.mark,
            count_step=progress.count_step,
            stop=stop,
            recorder=recorder,
            watchers=observers,
            health=health,
            checkpoints=checkpoints,
        )
    except BaseException as error:
        for observer in observers:
            if isinstance(observer, FailureRecorder) and (where := observer.explain()):
                error.add_note(where)
        # Reported before the robot's program is told, whose end would seem to be the failure.
        progress.write_report(report_of(error, progress))
        _close_broken(observers, recorder)
        if checkpoints is not None:
            checkpoints.close()
        raise
    progress.mark(Phase.FINISHING)
    try:
        findings = [observer.close(episode.ended_by) for observer in (health, *observers)]
    except LaunchError:  # what was seen of a run without commands is what one wants to look at
        _close_broken(observers, recorder)
        raise
    recorder.close()
    write_result(make_result(episode, plan.seed, [*findings, recording_findings(episode, recording)]), plan.output_dir)
    progress.write_report({"ended_by": episode.ended_by})


def _close_broken(observers: Iterable[Observer], recorder: Recorder) -> None:
    """Closes what a broken run has open; the first failure counts, and a full disk may keep the rest from closing."""
    for observer in observers:
        with suppress(Exception):
            observer.close(None)
    with suppress(RecordingError):
        recorder.close()


def recording_findings(episode: Episode, recorder: Recorder) -> Findings:
    """Returns findings with a remark if an environment records topics itself but has recorded none; else empty ones.

    Args:
        episode: Outcome of the simulation loop.
        recorder: Recorder of the run, which is closed.
    """
    if not (episode.records_itself and recorder.enabled) or recorder.topics - _OF_THE_CAMERA:
        return Findings()
    return Findings(notes=["the environment says records_itself, and wrote nothing to the recording"])


def watched_environment(environment: Any, progress: Progress) -> Any:
    """Returns an environment unchanged, after noting in shared memory whether it judges its run.

    The supervisor reads that if the process dies.
    """
    if isinstance(environment, ReportingEnvironment) or hasattr(environment, "requirements"):
        progress.begin_to_judge()
    return environment


def contexts_of(
    plan: RunPlan, rng: np.random.Generator, world: World | None, recorder: Recorder
) -> tuple[SimulationContext, SimulationContext]:
    """Makes the contexts for the factories of environment and agent, each with its application's variables.

    In each, the application's own variables replace those of the other. The world is `None` for a run without one.
    """
    simulation, robot = applications_of(plan)
    context = SimulationContext(
        plan=plan,
        rng=rng,
        world=world,
        world_dir=plan.world_dir,
        data_dir=plan.data_dir,
        output_dir=plan.output_dir,
        environment={**robot.environment_variables, **simulation.environment_variables},
        recorder=recorder,
    )
    environment = {**simulation.environment_variables, **robot.environment_variables}
    return context, replace(context, environment=environment)


def _bridge(plan: RunPlan, recording: Recorder) -> RosBridge | None:
    """Returns the ROS bridge of a run whose robot application may be ROS nodes; `None` for other runs."""
    robot = applications_of(plan)[1]
    if plan.ros is None or robot.attribute is not None or plan.recorded_actions is not None:
        return None
    return RosBridge(plan, robot.name, recording)


def _remote_robot(plan: RunPlan, stop: Stop, bridge: RosBridge | None) -> RemoteRobot | RecordedRobot | None:
    """Returns the robot of a run whose robot application is a separate program; None: it is a factory function."""
    robot = applications_of(plan)[1]
    if robot.attribute is not None:
        return None
    if plan.recorded_actions is not None:
        return RecordedRobot(plan.recorded_actions, robot.name)
    return RemoteRobot(plan, robot.name, stop, bridge)


def applications_of(plan: RunPlan) -> tuple[ApplicationPlan, ApplicationPlan]:
    """Returns the applications that make the environment and the agent of a run: the plan's, else built-in ones."""
    simulation = plan.simulation_application or BUILT_IN_ENVIRONMENT
    if (simulation.attribute or "").startswith(f"{_RECORDED_RUN}."):
        return simulation, RECORDED_AGENT  # the robot has driven already
    return simulation, plan.robot_application or BUILT_IN_AGENT


def factory_of(application: ApplicationPlan) -> Callable[..., Any]:
    """Imports and returns the factory function of an application that is no separate program.

    Raises:
        LoadError: The function cannot be imported.
    """
    assert application.attribute is not None, "programs are not imported"
    # The factory of a policy is built in; what it loads is the application's.
    return load_factory(application.attribute, None if application.policy is not None else application.path)


def read_world(world_dir: Path | None) -> World | None:
    """Reads the description of a run's world; `None` if the run has none."""
    return World.model_validate_json((world_dir / "world.json").read_bytes()) if world_dir else None
