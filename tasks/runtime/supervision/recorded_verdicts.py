"""Verdicts of jobs that have only programs, such as a Gazebo of the user's own: by the topics that they recorded."""

from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path

from ....schemas.runs.plan import RunPlan, RunResult
from ....schemas.runs.programs import RunStop
from ....schemas.runs.recording_sources import sources_in
from ....schemas.runs.variables import variables_of
from ....schemas.wire.errors import InvalidParameterException
from ..episode.run_results import write_result
from ..limits.logs import LOG_FOLDER
from ..process.judging_request import JudgingRequest
from ..ros.topic_report import PROGRAM
from .finished_outputs import read_result, with_judged
from .helper_programs import run_helper
from .ros_topics import BAG_FILE

_JUDGING = "prefect_robomaker.tasks.runtime.process.judging"
_RECORDINGS = ("recording.mcap", BAG_FILE)
"""Recordings of ROS 2 and of ROS 1 that a run leaves."""
_LIMIT_S = 120.0
"""Wall-clock limit of judging, besides what the size of the recording adds; importing alone takes seconds."""
_BYTES_A_SECOND = 1024 * 1024
"""A fifth of what was measured with transforms at 50 Hz, whose messages are the smallest, on two busy processors."""


def judge_topics(
    plan: RunPlan,
    losses: Mapping[str, str],
    *,
    timed_out: bool,
    stop: Callable[[], str | None],
    environment: Mapping[str, str],
) -> None:
    """Judges requirements by a run's recording, and updates the run's result.

    Of a run that had only programs these are all; of one with a simulation those that are judged by topics only.

    What cannot be judged is an error with its reason, as the result says it already.

    Args:
        plan: The run; it is completed, its recordings are joined, and its result is written.
        losses: Why topics are not recorded whole, by their names.
        timed_out: Whether the duration limit ended it.
        stop: Asked about every 0.1 s; anything but None ends the judging.
        environment: Variables of the judging process.
    """
    if plan.has_episode:  # the simulation has judged all that needs no topics; trials have no recording of their own
        by_topics = [each for each in plan.requirements if each.by_topics] if plan.trials is None else []
        plan = plan.model_copy(update={"requirements": by_topics})
    if not plan.requirements or (result := read_result(plan.output_dir)) is None:
        return
    recording = next((path for name in _RECORDINGS if _is_file(path := plan.output_dir / name)), None)
    judged: RunResult | None = None
    if recording is None:
        who = "the run" if plan.has_episode else "the job has only programs, and they"
        remedy = "the notes say why" if _has_recorder(plan) else "set loggingConfig.recordAllRosTopics"
        why: str | None = f"{who} recorded no topics; {remedy}"
    else:
        judged, why = _judged(plan, recording, losses, timed_out, stop, environment)
    with suppress(OSError):  # no room for it, or an application put something in the way: it stays ERROR
        write_result(with_judged(plan, result, judged, why), plan.output_dir)


def _has_recorder(plan: RunPlan) -> bool:
    """Whether topics were to be recorded: a recorder ran, or its log says why it did not."""
    has_log = (plan.output_dir / LOG_FOLDER / f"{PROGRAM}.log").is_file()
    return has_log or any(program.name.endswith(f".{PROGRAM}") for program in plan.programs)


def _is_file(path: Path) -> bool:
    """Whether a program of the job did not put a link there."""
    return path.is_file() and not path.is_symlink()


def _judged(
    plan: RunPlan,
    recording: Path,
    losses: Mapping[str, str],
    timed_out: bool,
    stop: Callable[[], str | None],
    environment: Mapping[str, str],
) -> tuple[RunResult | None, str | None]:
    try:
        sources = sources_in(variables_of(plan))
    except InvalidParameterException as error:
        return None, str(error)
    ended_by = RunStop.DURATION_LIMIT if timed_out else None
    request = JudgingRequest(plan=plan, recording=recording, sources=sources, losses=dict(losses), ended_by=ended_by)
    limit_s = _LIMIT_S + recording.stat().st_size / _BYTES_A_SECOND
    said, problem = run_helper(
        [_JUDGING], stop=stop, environment=environment, limit_s=limit_s, request=request.model_dump_json()
    )
    if problem is not None:
        return None, problem
    return RunResult.model_validate(said, strict=False), None
