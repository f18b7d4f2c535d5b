"""Entry point of a run's process, from a clean fork to `result.json`."""

import os
import signal
import sys
from contextlib import suppress
from pathlib import Path
from types import FrameType

from ..episode.progress import Progress, RunStopped
from ..episode.run_results import versions
from ..limits.logs import redirect_output
from ..rendering import cameras
from ..states.checkpoint_files import CheckpointError, RunTakenError, discard_checkpoints
from ..states.provenance import machine_facts
from .attempt import BUILT_IN_ENVIRONMENT as BUILT_IN_ENVIRONMENT
from .attempt import attempt, report_failure, seed_globals
from .held_sources import HELD_VARIABLE, MARK_VARIABLE, hold, mark, values_of
from .run_request import RunRequest
from .trial_runs import run_trials

_PACKAGE = str(Path(__file__).parents[2])
"""Folder of the runtime and its engines, whose code measures with the real clock."""

versions()  # read once, before forking
machine_facts()


def run_child(run: RunRequest, progress: Progress) -> int:
    """Runs a simulation in this process, which exists for this run alone.

    Args:
        run: Request with the run's plan.
        progress: Memory for the run's progress and final report.

    Returns:
        The process's exit code: 0 if the run ended as a run should, else 1. Errors are not raised: their tracebacks are
        written to the error log, and their short form to `progress`.
    """
    stop = _StopSignal(progress)
    try:
        redirect_output(run.plan.output_dir)
        _take_on(run)
        _carry_out(run, progress, stop)
    except BaseException as error:
        report_failure(error, run.plan, progress)
        return 1
    finally:
        for stream in (sys.stdout, sys.stderr):
            with suppress(Exception):  # the application may have closed or replaced it, or the disk is full
                stream.flush()
    return 0


class _StopSignal:
    """Reads stop requests from shared memory, and makes SIGTERM after such a request an exception in application code.

    A request comes without a signal at first: a signal would interrupt blocking native calls, so that a hanging one
    would seem to answer.
    """

    def __init__(self, progress: Progress) -> None:
        self._progress = progress
        signal.signal(signal.SIGTERM, self._on_signal)

    @property
    def reason(self) -> str:
        return self._progress.stop_reason

    def _on_signal(self, number: int, frame: FrameType | None) -> None:
        del number, frame
        if not self.reason:  # somebody else sent it
            self._progress.request_stop("canceled")
        elif self._progress.phase.role is not None:
            raise RunStopped(self._progress.phase)


def _take_on(run: RunRequest) -> None:
    """Makes this process that of a run: replaces its environment variables, folder, import path and random seeds.

    If the run asks for it, also the clock and other sources of chance are held.
    """
    os.environ.clear()
    os.environ.update(run.environment)
    os.chdir(run.plan.work_dir)
    sys.path[:] = run.import_path
    seed_globals(run.plan.seed)
    if MARK_VARIABLE in os.environ:
        sources = values_of(os.environ.get(HELD_VARIABLE, ""))
        hold(sources, run.plan.seed, outside=(_PACKAGE,))
        mark(sources)
    cameras.follow_environment()


def _carry_out(run: RunRequest, progress: Progress, stop: _StopSignal) -> None:
    """Runs the simulation, or its trials, from the last checkpoint if there is one, else from the start.

    A checkpoint that cannot be used is deleted, and the run begins anew. Raises `RunTakenError` if another process runs
    it.
    """
    if run.plan.trials is not None:
        run_trials(run, progress, stop)
        return
    try:
        attempt(run, progress, stop)
    except RunTakenError:
        raise  # its checkpoints are those of another process
    except CheckpointError as error:
        assert run.plan.checkpoint_dir is not None
        sys.stderr.write(f"The run begins anew: its last checkpoint cannot be continued from: {error}\n")
        discard_checkpoints(run.plan.checkpoint_dir)
        seed_globals(run.plan.seed)
        attempt(run, progress, stop)
