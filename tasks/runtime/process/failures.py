"""Failures of a run: in its error log, and in words for its supervisor."""

import os
import sys
import traceback
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Any

from ....schemas.runs.plan import RunPlan
from ....schemas.wire.errors import LaunchError
from ..agents.remote_agent import RobotProgramError
from ..episode.loading import LoadError
from ..episode.progress import Phase, Progress
from ..episode.results import RESULT_FILE
from ..recording.recording import RecordingError
from ..requirements.measurements import RequirementError

_RUNTIME_FOLDER = Path(__file__).parents[1]
_APPLICATIONS = tuple(str(_RUNTIME_FOLDER / name) + os.sep for name in ("applications", "robots"))
_MAX_ERROR_CHARACTERS = 2000
_SAY_ALL = LoadError | LaunchError | RobotProgramError
"""Errors whose message says all: a traceback would not help users."""


def report_failure(error: BaseException, plan: RunPlan, progress: Progress) -> None:
    """Writes the traceback to the error log and the short form to the supervisor."""
    log_failure(error)
    progress.write_report(report_of(error, progress))
    (plan.output_dir / RESULT_FILE).unlink(missing_ok=True)


def log_failure(error: BaseException) -> None:
    """Writes the traceback to the error log."""
    trace = _without_runtime(error.__traceback__)
    with suppress(Exception):  # the disk may be full, and the application may have closed or replaced the stream
        if isinstance(error, _SAY_ALL) and error.__cause__ is None:
            sys.stderr.write(f"{error}\n")
        else:
            traceback.print_exception(type(error), error, trace)


def report_of(error: BaseException, progress: Progress) -> dict[str, Any]:
    """Returns the report of an error for the supervisor."""
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
