"""Videos of failed runs, rendered after the run's processes have ended."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path

from ....schemas.runs.plan import RunOutcome, RunPlan
from ....schemas.wire.errors import LaunchError
from ...files.untrusted_files import read_left, unfinished_of
from ..episode.run_results import MAX_RESULT_BYTES, RESULT_FILE
from ..limits.logs import add_note
from ..rendering.backends import best_video_backend
from .video_settings import CLIP_FILE, STATE_LOG_FOLDER, VIDEO_FILE, VideoRequest, settings_of

_PROGRAM = "prefect_robomaker.tasks.runtime.video.rerender"
_REMARKS_FILE = "film.log"
_POLL_S = 0.1
_MAX_REASON_CHARACTERS = 500


def record_failure_videos(
    plan: RunPlan,
    outcome: RunOutcome,
    stop: Callable[[], str | None],
    environment: Mapping[str, str],
    *,
    limit_s: float,
) -> None:
    """Renders the videos of a run after its end, if its video policy asks for them.

    With `on-failure` these are `video.mp4`, `last-10s.mp4` and `poster.png` of a run that failed; with `always` a
    failed run gets `last-10s.mp4`, a poster of its last moment, and `video.mp4` if it was killed before its own was
    complete. The run's error log says why a video could not be made.

    Args:
        plan: Plan of the run; its processes have all ended.
        outcome: Outcome of the run.
        stop: Function called about every 0.1 s; a result other than None ends the rendering.
        environment: Environment variables of the rendering process.
        limit_s: Wall-clock time limit.
    """
    if not _may_film(plan):
        return
    _remove_unfinished(plan.output_dir)
    if not has_failed(plan, outcome):
        return
    try:
        request = _request(plan)
        variables = {**environment, **({} if request.backend == "rays" else {"MUJOCO_GL": request.backend})}
        problem = _carry_out(request, plan.work_dir.absolute(), variables, stop, time.monotonic() + limit_s)
    except (OSError, LaunchError) as error:
        problem = str(error)
    if problem:
        _remove_unfinished(plan.output_dir)
        missing = (
            f"{VIDEO_FILE} of the failure" if (plan.output_dir / CLIP_FILE).exists() else "The video of the failure"
        )
        add_note(plan.output_dir, f"{missing} is missing: {problem}.")


def is_filmed(plan: RunPlan, outcome: RunOutcome) -> bool:
    """Whether a video is drawn after this outcome: a run of one episode failed, and its policy is not `none`."""
    return _may_film(plan) and has_failed(plan, outcome)


def _may_film(plan: RunPlan) -> bool:
    return plan.video != "none" and plan.has_episode and plan.trials is None


def has_failed(plan: RunPlan, outcome: RunOutcome) -> bool:
    """Whether a run crashed, timed out, or was judged FAIL or ERROR; canceled ones did not."""
    if outcome.status != "Completed":
        return outcome.status == "Failed"
    return outcome.timed_out or _verdict(plan.output_dir) in ("FAIL", "ERROR")


def _request(plan: RunPlan) -> VideoRequest:
    log_dir, output_dir = plan.work_dir.absolute() / STATE_LOG_FOLDER, plan.output_dir.absolute()
    if not log_dir.exists():
        raise FileNotFoundError("no state was noted: it failed before its first step or has no `physics`")
    return VideoRequest(
        log_dir=log_dir,
        output_dir=output_dir,
        backend=best_video_backend(),
        settings=settings_of(plan),
        whole_video=not (output_dir / VIDEO_FILE).exists(),
        parent_pid=os.getpid(),
    )


def _verdict(output_dir: Path) -> str | None:
    try:
        return json.loads(read_left(output_dir / RESULT_FILE, MAX_RESULT_BYTES))["verdict"]
    except (OSError, ValueError, KeyError, TypeError, RecursionError):  # a program may have written it
        return None


def _carry_out(
    request: VideoRequest,
    work_dir: Path,
    environment: Mapping[str, str],
    stop: Callable[[], str | None],
    deadline_s: float,
) -> str | None:
    """Runs the program that renders the videos of a failed run; returns the failure as text, or `None`.

    The program is killed if the job is stopped or the time is over.

    Args:
        request: Videos to render.
        work_dir: Folder in which the program runs, and its messages are written.
        environment: Environment variables of the program.
        stop: Returns why the job is stopped, or `None`.
        deadline_s: Time at which it is killed, of the monotonic clock in seconds.
    """
    remarks_path = work_dir / _REMARKS_FILE
    remarks_path.unlink(missing_ok=True)
    with remarks_path.open("xb") as remarks:
        process = subprocess.Popen(
            [sys.executable, "-P", "-m", _PROGRAM, request.model_dump_json()],
            env={**environment, "PWD": str(work_dir)},
            cwd=work_dir,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=remarks,
            start_new_session=True,
        )
    try:
        while process.poll() is None:
            if (reason := stop()) is not None:
                return f"the job was stopped ({reason})"
            if time.monotonic() >= deadline_s:
                return "it took too long"
            with suppress(subprocess.TimeoutExpired):
                process.wait(_POLL_S)
    finally:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()
    if process.returncode == 0:
        return None
    lines = remarks_path.read_text(errors="replace").strip().splitlines()
    return lines[-1][:_MAX_REASON_CHARACTERS] if lines else f"it ended with exit code {process.returncode}"


def _remove_unfinished(output_dir: Path) -> None:
    for name in (VIDEO_FILE, CLIP_FILE):
        with suppress(OSError):  # the application may have put anything there
            unfinished_of(output_dir / name).unlink()
