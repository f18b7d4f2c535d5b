"""Verdicts by recorded topics, for jobs that have only programs (such as the user's own Gazebo)."""

from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path

from ....schemas.runs.plan import RunPlan, RunResult
from ....schemas.runs.programs import TOPIC_RECORDER, RunStop
from ....schemas.runs.recording_sources import sources_in
from ....schemas.runs.variables import variables_of
from ....schemas.wire.errors import InvalidParameterException
from ..episode.run_results import write_result
from ..limits.logs import LOG_FOLDER
from ..process.judging_request import JudgingRequest
from .finished_outputs import read_result, with_judged
from .helper_programs import run_helper
from .ros_topics import BAG_FILE

_JUDGING = "prefect_robomaker.tasks.runtime.process.judging"
_RECORDINGS = ("recording.mcap", BAG_FILE)
"""File names of a run's recordings of ROS 2 and ROS 1."""
_LIMIT_S = 120.0
"""Wall-clock limit of judging in seconds, plus a time for the size of the recording; importing alone takes seconds."""
_BYTES_A_SECOND = 1024 * 1024
"""Bytes of a recording that are judged in a second, for the time limit: a fifth of the measured speed with transforms
at 50 Hz, the smallest messages, on two busy processors.
"""


def judge_topics(
    plan: RunPlan,
    losses: Mapping[str, str],
    *,
    timed_out: bool,
    stop: Callable[[], str | None],
    environment: Mapping[str, str],
) -> None:
    """Judges requirements by a run's recording, and updates the run's result.

    For a run that had only programs, these are all requirements; for a run with a simulation, those that are judged by
    topics. A requirement that cannot be judged becomes an error with its reason.

    Args:
        plan: Plan of the run; the run is complete, its recordings are merged, and its result is written.
        losses: Reasons why topics are not recorded completely, by topic.
        timed_out: Whether the run ended at its duration limit.
        stop: Function called about every 0.1 s; a result other than None ends the judging.
        environment: Environment variables of the judging process.
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
    """Returns whether topics were to be recorded: a recorder ran, or its log says why it did not."""
    has_log = (plan.output_dir / LOG_FOLDER / f"{TOPIC_RECORDER}.log").is_file()
    return has_log or any(program.name.endswith(f".{TOPIC_RECORDER}") for program in plan.programs)


def _is_file(path: Path) -> bool:
    """Returns whether a path is a regular file; a program of the job may have put a link there."""
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
