"""The process of a run, from a clean fork to `result.json`."""

import os
import random
import signal
import sys
import traceback
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from types import FrameType, TracebackType
from typing import Any

import numpy as np

from ....schemas.runs.plan import ApplicationPlan, RunPlan
from ....schemas.wire.errors import LaunchError
from ....schemas.worlds.world import World
from ..agents.recorded_robot import RecordedRobot
from ..agents.remote_agent import RobotProgramError
from ..agents.remote_robot import RemoteRobot
from ..episode.context import SimulationContext
from ..episode.loading import LoadError, load_factory
from ..episode.progress import AGENT_GONE, Phase, Progress
from ..episode.results import RESULT_FILE, Episode, make_result, versions, write_result
from ..episode.stops import RunStopped
from ..limits.logs import redirect_output
from ..recording.recording import McapRecorder, NullRecorder, RecordingError
from ..rendering import gl
from ..requirements.measurements import RequirementError
from ..states.checkpoint_files import CheckpointError, RunTakenError, discard_checkpoints
from ..states.checkpoints import Checkpointer
from ..states.failure_state import FailureRecorder
from ..states.provenance import machine_facts
from ..video.camera_recorder import CameraRecorder
from ..video.recorded_camera_settings import camera_recording
from .loop import run_episode
from .observers import Observer, make_observers
from .run_request import RunRequest

RECORDING_FILE = "recording.mcap"
BUILT_IN_ENVIRONMENT = ApplicationPlan(
    role="simulation",
    name="indoor-navigation",
    attribute="prefect_robomaker.tasks.runtime.applications.indoor_navigation.make_environment",
)
BUILT_IN_AGENT = ApplicationPlan(
    role="robot", name="scout", attribute="prefect_robomaker.tasks.runtime.applications.scout.make_agent"
)
_RUNTIME_FOLDER = Path(__file__).parents[1]
_APPLICATIONS = tuple(str(_RUNTIME_FOLDER / name) + os.sep for name in ("applications", "robots"))
_MAX_ERROR_CHARACTERS = 2000
_SAY_ALL = LoadError | LaunchError | RobotProgramError
"""Errors whose message says all: a traceback would not help users."""
versions()  # read once, before forking
machine_facts()


def run_child(run: RunRequest, progress: Progress) -> int:
    """Runs a run in this process, which belongs to it alone.

    Args:
        run: What to do.
        progress: Where to say how far it is and how it ended.

    Returns:
        The process's exit code: 0 when the run ended as a run should.
    """
    stop = _StopSignal(progress)
    try:
        redirect_output(run.plan.output_dir)
        _take_on(run)
        _carry_out(run, progress, stop)
    except BaseException as error:
        _report_failure(error, run.plan, progress)
        return 1
    finally:
        for stream in (sys.stdout, sys.stderr):
            with suppress(Exception):  # the application may have closed or replaced it, or the disk is full
                stream.flush()
    return 0


class _StopSignal:
    """Turns SIGTERM into a stop request, and a second one into an exception in the application's code."""

    def __init__(self, progress: Progress) -> None:
        self.reason = ""
        self._progress = progress
        signal.signal(signal.SIGTERM, self._on_signal)

    def _on_signal(self, number: int, frame: FrameType | None) -> None:
        del number, frame
        if not self.reason:
            self.reason = self._progress.stop_reason or "canceled"
        elif self._progress.phase.role is not None:
            if self.reason == AGENT_GONE:  # a later stop of a run without its robot has another reason
                self.reason = self._progress.stop_reason or self.reason
            raise RunStopped


def _take_on(run: RunRequest) -> None:
    """Gives the process its folder, environment, import path and seeds."""
    os.environ.clear()
    os.environ.update(run.environment)
    os.chdir(run.plan.work_dir)
    sys.path[:] = run.import_path
    _seed(run.plan.seed)
    gl.follow_environment()


def _seed(seed: int) -> None:
    """Applications should use the context's generator; those that use the global ones are repeatable too."""
    random.seed(seed)
    np.random.seed(seed % 2**32)  # noqa: NPY002


def _carry_out(run: RunRequest, progress: Progress, stop: _StopSignal) -> None:
    """Continues the run from its last checkpoint if there is one, else begins it."""
    try:
        _attempt(run, progress, stop)
    except RunTakenError:
        raise  # its checkpoints are those of another process
    except CheckpointError as error:
        assert run.plan.checkpoint_dir is not None
        sys.stderr.write(f"The run begins anew: its last checkpoint cannot be continued from: {error}\n")
        discard_checkpoints(run.plan.checkpoint_dir)
        _seed(run.plan.seed)
        _attempt(run, progress, stop)


def _attempt(run: RunRequest, progress: Progress, stop: _StopSignal) -> None:
    plan = run.plan
    rng = np.random.default_rng(plan.seed)
    checkpoints = Checkpointer(plan, rng) if plan.checkpoint_dir and plan.checkpoint_every_s else None
    resumes = checkpoints is not None and checkpoints.resumes
    recorder = McapRecorder(plan.output_dir / RECORDING_FILE, resume=resumes) if plan.record else NullRecorder()
    remote = _remote_robot(plan, stop)
    observers = make_observers(plan, run.video_backend, _applications(plan), remote.actions if remote else None)
    if camera := camera_recording(plan):
        observers.append(CameraRecorder(recorder, camera, run.video_backend))
    if remote is not None:
        observers.insert(0, remote)  # told of the end before others take their time for it
    try:
        episode = _run(plan, rng, recorder, progress, stop, observers, remote, checkpoints)
    except BaseException as error:
        for observer in observers:
            if isinstance(observer, FailureRecorder) and (where := observer.explain()):
                error.add_note(where)
        # Reported before the robot's program is told, whose end would seem to be the failure.
        progress.write_report(_report_of(error, progress))
        # The first failure counts; a full disk may also keep the rest from being closed.
        for observer in observers:
            with suppress(Exception):
                observer.close(None)
        with suppress(RecordingError):
            recorder.close()
        if checkpoints is not None:
            checkpoints.close()
        raise
    progress.mark(Phase.FINISHING)
    findings = [observer.close(episode.ended_by) for observer in observers]
    recorder.close()
    write_result(make_result(episode, plan.seed, findings), plan.output_dir)
    progress.write_report({"ended_by": episode.ended_by})


def _run(
    plan: RunPlan,
    rng: np.random.Generator,
    recorder: McapRecorder | NullRecorder,
    progress: Progress,
    stop: _StopSignal,
    observers: Sequence[Observer],
    remote: RemoteRobot | RecordedRobot | None,
    checkpoints: Checkpointer | None,
) -> Episode:
    simulation, robot = _applications(plan)
    context = SimulationContext(
        plan=plan,
        rng=rng,
        world=_read_world(plan.world_dir),
        world_dir=plan.world_dir,
        data_dir=plan.data_dir,
        output_dir=plan.output_dir,
        environment={**robot.environment_variables, **simulation.environment_variables},
        recorder=recorder,
    )
    robot_context = replace(context, environment={**simulation.environment_variables, **robot.environment_variables})
    return run_episode(
        lambda: _factory(simulation)(context),
        lambda environment: (remote.make_agent if remote else _factory(robot))(robot_context, environment),
        mark=progress.mark,
        stop=stop,
        recorder=recorder,
        watchers=observers,
        checkpoints=checkpoints,
    )


def _remote_robot(plan: RunPlan, stop: _StopSignal) -> RemoteRobot | RecordedRobot | None:
    """The robot's side of a run whose robot application is a program; None: it is a factory."""
    robot = _applications(plan)[1]
    if robot.attribute is not None:
        return None
    if plan.recorded_actions is not None:
        return RecordedRobot(plan.recorded_actions, robot.name)
    return RemoteRobot(plan, robot.name, stop)


def _applications(plan: RunPlan) -> tuple[ApplicationPlan, ApplicationPlan]:
    """Returns the factories of the environment and the agent."""
    return plan.simulation_application or BUILT_IN_ENVIRONMENT, plan.robot_application or BUILT_IN_AGENT


def _factory(application: ApplicationPlan) -> Callable[..., Any]:
    assert application.attribute is not None, "programs are not imported"
    return load_factory(application.attribute, application.path)


def _read_world(world_dir: Path | None) -> World | None:
    return World.model_validate_json((world_dir / "world.json").read_bytes()) if world_dir else None


def _report_failure(error: BaseException, plan: RunPlan, progress: Progress) -> None:
    """Writes the traceback to the error log and the short form to the supervisor."""
    trace = _without_runtime(error.__traceback__)
    with suppress(Exception):  # the disk may be full, and the application may have closed or replaced the stream
        if isinstance(error, _SAY_ALL) and error.__cause__ is None:
            sys.stderr.write(f"{error}\n")
        else:
            traceback.print_exception(type(error), error, trace)
    progress.write_report(_report_of(error, progress))
    (plan.output_dir / RESULT_FILE).unlink(missing_ok=True)


def _report_of(error: BaseException, progress: Progress) -> dict[str, Any]:
    faults = {RecordingError: Phase.FINISHING, RequirementError: Phase.JUDGING}
    phase = next((phase for kind, phase in faults.items() if isinstance(error, kind)), progress.phase)
    what = _describe(error, _without_runtime(error.__traceback__))
    report: dict[str, Any] = {"error": what[:_MAX_ERROR_CHARACTERS], "phase": int(phase)}
    if isinstance(error, LaunchError):
        report["code"] = error.failure_code
    return report


def _describe(error: BaseException, trace: TracebackType | None) -> str:
    if isinstance(error, _SAY_ALL):
        return str(error)
    if isinstance(error, SystemExit):
        text = f"called sys.exit({error.code!r})"
    else:
        text = "".join(traceback.format_exception_only(type(error), error)).strip().replace("\n", ", ")
    place = next(iter(traceback.extract_tb(trace)[-1:]), None)
    return f"{text} ({Path(place.filename).name}, line {place.lineno})" if place else text


def _without_runtime(trace: TracebackType | None) -> TracebackType | None:
    """Skips the frames of this package that lead to an application's code, for a traceback about that code."""
    start = trace
    while start is not None and _is_of_runtime(start.tb_frame.f_code.co_filename):
        start = start.tb_next
    return start or trace


def _is_of_runtime(path: str) -> bool:
    """Whether a source file belongs to the runtime itself, and not to an application."""
    return path.startswith(f"{_RUNTIME_FOLDER}{os.sep}") and not path.startswith(_APPLICATIONS)
