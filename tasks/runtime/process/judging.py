"""Program that judges the recording of a run whose processes have ended.

`python -P -m prefect_robomaker.tasks.runtime.process.judging` reads a `JudgingRequest` as JSON from its standard input,
and prints the result of the run as JSON. On a failure the exit code is not 0, and the last line of standard error has
the reason.

Programs of the run could write to its recording, so nothing in it is trusted: memory is limited, and none of their
functions are called.
"""

import resource
import sys
from dataclasses import replace
from typing import Any

from ....schemas.runs.plan import RunResult
from ....schemas.wire.errors import RobomakerError
from ..applications.recorded_run import RecordedRun, make_agent
from ..episode.run_results import make_result
from ..limits.processes import die_with_parent
from ..recording.recording import Recorder
from ..requirements.observer import RequirementsObserver
from .judging_request import JudgingRequest
from .run_loop import run_episode

_MEMORY_BYTES = 8 * 1024 * 1024 * 1024
"""Limit of the program's address space in bytes; numerical libraries reserve gigabytes for threads that they never
start.
"""


class _NeverStopped:
    """Stop source that never stops: the process that started this program kills it instead."""

    reason = ""


def judge(request: JudgingRequest) -> RunResult:
    """Judges the recording of a run by its requirements, and returns the result.

    Args:
        request: Recording and requirements.

    Raises:
        LaunchError: The recording cannot be judged at all.
    """
    observer = RequirementsObserver(request.plan)
    # The recorder ends with the run, unless it lost something on the way.
    sources = request.sources.model_copy(update={"ends_with_run": request.sources.ends_with_run or not request.losses})
    no_stop: Any = _NeverStopped()
    episode = run_episode(
        lambda: RecordedRun(request.recording, sources, request.losses, calls_functions=False),
        lambda environment: make_agent(None, environment),
        mark=lambda _phase: None,
        stop=no_stop,
        recorder=Recorder(),
        watchers=(observer,),
    )
    if request.ended_by is not None and episode.ended_by == "environment":
        episode = replace(episode, ended_by=request.ended_by)
    return make_result(episode, request.plan.seed, [observer.close(episode.ended_by)])


def main() -> int:
    """Entry point of a child process that judges a recording; ends with its parent, and limits its own memory.

    Reads the request as JSON from standard input and writes the result as JSON to standard output. Returns the exit
    code: 1 if judging failed, with the reason on standard error, else 0.
    """
    die_with_parent()
    resource.setrlimit(resource.RLIMIT_AS, (_MEMORY_BYTES, _MEMORY_BYTES))
    request = JudgingRequest.model_validate_json(sys.stdin.read())
    try:
        result = judge(request)
    except (RobomakerError, OSError, MemoryError) as error:
        sys.stderr.write(f"{str(error) or type(error).__name__}\n")
        return 1
    sys.stdout.write(result.model_dump_json())
    return 0


if __name__ == "__main__":
    sys.exit(main())
