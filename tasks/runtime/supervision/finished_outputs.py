"""Output folder of a run that has ended: completes `result.json`, also if a program wrote it."""

import json
import math
import os
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any, get_args

from pydantic import ValidationError

from ....schemas.runs.plan import Requirement, RunPlan, RunResult, Verdict
from ....schemas.runs.programs import RunStop, ToolEnds
from ....schemas.runs.requirements import JobRequirement
from ...files.untrusted_files import read_left
from ..agents.agent_socket import remove_agent_socket
from ..episode.progress import unanswered
from ..episode.run_results import MAX_RESULT_BYTES, OWN_VERDICT, RESULT_FILE, never_answered, versions, write_result
from ..episode.verdicts import Parts, decide_verdict
from ..limits.logs import add_note
from ..trials.completion import complete_after_all
from .run_outcomes import OFTEN, Exit, Outcome, failure_reason, tool_in_words

_VERDICTS = get_args(Verdict)


@dataclass(frozen=True)
class ProgramResult:
    """A `result.json` that a program of a run wrote, checked: the result, or the problem with it."""

    result: RunResult | None = None
    """Parsed result; `None`: the file is missing or invalid."""

    problem: str | None = None
    """Reason why the file is invalid; `None`: it is valid or missing."""

    is_changed: bool = False
    """Whether the file deviates from the schema of results, so that it has to be rewritten."""


def read_program_result(output_dir: Path, facts: Mapping[str, Any]) -> ProgramResult:
    """Reads and completes the `result.json` that a program wrote, and returns it or the problem with it.

    Only `verdict` is required: a byte order mark is skipped, unknown members and non-finite numbers (as text) are moved
    to `extra`, and missing members are filled in.

    Args:
        output_dir: The run's output folder.
        facts: Members that the runtime knows and a program may omit.
    """
    path = output_dir / RESULT_FILE
    if not os.path.lexists(path):
        return ProgramResult()
    try:
        content = read_left(path, MAX_RESULT_BYTES)
    except OSError as error:
        return ProgramResult(problem=f"{RESULT_FILE} cannot be read: {error.strerror or error}")
    try:
        result = RunResult.model_validate_json(content)
        if _all_finite(result):
            return ProgramResult(result)
    except ValidationError:
        pass
    try:
        return ProgramResult(_lenient(content, facts), is_changed=True)
    except ValueError as error:  # of JSON, of UTF-8, of the form
        return ProgramResult(problem=f"{RESULT_FILE} is no result: {_words(error)}")


def _lenient(content: bytes, facts: Mapping[str, Any]) -> RunResult:
    said = json.loads(content.decode("utf-8-sig"))
    if not isinstance(said, dict) or said.get("verdict") not in _VERDICTS:
        raise ValueError(f"it has no `verdict` of {', '.join(_VERDICTS)}")
    known = {name: value for name, value in said.items() if name in RunResult.model_fields}
    own = known.get("extra")
    extra: dict[str, Any] = dict(own) if isinstance(own, dict) else {}
    extra |= {name: value for name, value in said.items() if name not in known}
    metrics = known.get("metrics")
    if isinstance(metrics, dict):
        odd = {name: str(value) for name, value in metrics.items() if not _is_finite(value)}
        known["metrics"] = {name: value for name, value in metrics.items() if name not in odd}
        if odd:
            extra["not_finite"] = odd
    known["extra"] = _as_text_where_not_finite(extra)
    result = RunResult.model_validate({**facts, "versions": versions(), **known}, strict=False)
    if not _all_finite(result):
        raise ValueError("a number in it is not finite")
    return result


def _is_finite(value: Any) -> bool:
    return not isinstance(value, float) or math.isfinite(value)


def _all_finite(result: RunResult) -> bool:
    """Returns whether all numbers of a result are finite, so that it can be written as JSON and read again."""
    try:
        json.dumps(result.model_dump(mode="python"), allow_nan=False, default=str)
    except ValueError:
        return False
    return True


def _as_text_where_not_finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {name: _as_text_where_not_finite(item) for name, item in value.items()}
    if isinstance(value, list):
        return [_as_text_where_not_finite(item) for item in value]
    return value if _is_finite(value) else str(value)


def _words(error: ValueError) -> str:
    if isinstance(error, ValidationError):
        first = error.errors()[0]
        return f"{'.'.join(map(str, first['loc']))}: {first['msg']}"
    return str(error)


_ONLY_PROGRAMS = "the job has only programs, and its topics were not judged"
INVALID_RESULT_FILE = "result.invalid.json"
"""New file name of an invalid `result.json` that an application wrote."""


def finish_outputs(
    plan: RunPlan, ended: Exit | None, outcome: Outcome, times: tuple[datetime, datetime]
) -> tuple[Outcome, bool]:
    """Writes, corrects or deletes `result.json` according to how the run ended.

    A run that only had programs gets a `result.json`, unless a program wrote a valid one. A program's result loses its
    verdict if the run was cancelled, and cannot be PASS if the run failed. The result of an episode is deleted if the
    run failed after writing it.

    Args:
        plan: Plan of the run.
        ended: Observed end of the run; None if its supervisor disappeared.
        outcome: Outcome that was decided from the end.
        times: Begin and end of the run.

    Returns:
        The outcome, which becomes a failure if the result of programs cannot be written; and whether the outputs are
        complete.
    """
    tools = ended.tools if ended is not None else ()
    for tool in tools:
        add_note(plan.output_dir, f"robomaker: {tool_in_words(tool, plan)}")
    if plan.has_episode:
        return outcome, _finish_episode(plan, ended, outcome, times)
    if ended is None and outcome.status == "Failed":  # how its programs ended is not known
        return outcome, False
    try:
        _result_of_programs(plan, outcome, times)
        if tools:
            _add_tools(plan, tools)
    except OSError as error:  # the disk is full, or an application put something in the way
        if outcome.status == "Completed":
            reason = failure_reason(f"{RESULT_FILE} cannot be written: {error}", "", ())
            outcome = Outcome("Failed", "InternalServiceError", reason)
        return outcome, False
    return outcome, True


def _finish_episode(plan: RunPlan, ended: Exit | None, outcome: Outcome, times: tuple[datetime, datetime]) -> bool:
    """Completes the outputs of a run with an episode; returns whether they are complete.

    Deletes `result.json` if the run failed, and writes one if the run was killed at its duration limit.

    Args:
        plan: The run's plan.
        ended: End of the run's process; `None`: not known.
        outcome: Outcome of the run.
        times: Times of the run's beginning and end.
    """
    remove_agent_socket(plan)
    if plan.trials is not None:
        _complete_trials(plan, outcome)
    if outcome.status == "Failed":
        with suppress(OSError):  # the application may have put anything in the folder's place
            (plan.output_dir / RESULT_FILE).unlink()
        return False
    is_whole = ended is not None and ended.ended_by is not None
    if outcome.timed_out and not is_whole and plan.trials is None:
        is_whole = _write_for_run(plan, ended, times)
    if is_whole and ended is not None and ended.tools:
        _add_tools(plan, ended.tools)
    return is_whole


def _write_for_run(plan: RunPlan, ended: Exit | None, times: tuple[datetime, datetime]) -> bool:
    """Writes `result.json` for a run whose process was killed at the duration limit, unless it has one.

    Returns whether there is one now; if it cannot be written, a note in the outputs says why.
    """
    if read_result(plan.output_dir) is not None:
        return True
    if ended is None:
        text = "stopped at the duration limit: the run's processes disappeared"
    elif "error" in ended.report:
        text = f"stopped at the duration limit: it failed while it was stopped: {ended.report['error']}"
    else:
        text = unanswered(ended.phase, ended.steps, ended.sim_time_s)
    is_judged = bool(plan.requirements) or (ended is not None and ended.judges)
    defects = [never_answered(text)] if is_judged else []
    requirements = [*defects, *(_never_judged(each, text) for each in plan.requirements)]
    began, now = times
    wall_time_s = (now - began).total_seconds()
    sim_time_s = ended.sim_time_s if ended is not None else 0.0
    result = RunResult(
        verdict=decide_verdict(Parts(requirements=requirements)),
        summary=f"Not judged: {text}." if is_judged else "",
        requirements=requirements,
        notes=[] if is_judged else [text],
        metrics={"steps": float(ended.steps if ended is not None else 0)},
        sim_time_s=sim_time_s,
        wall_time_s=wall_time_s,
        real_time_factor=sim_time_s / wall_time_s if wall_time_s > 0 else 0.0,
        ended_by=RunStop.DURATION_LIMIT,
        seed=plan.seed,
        versions=versions(),
    )
    try:
        write_result(result, plan.output_dir)
    except OSError as error:  # the disk is full, or an application put something in the way
        add_note(plan.output_dir, f"robomaker: {RESULT_FILE} cannot be written: {error}")
        return False
    return True


def _complete_trials(plan: RunPlan, outcome: Outcome) -> None:
    """Stores the results of trials that had finished when the run's process was killed or failed.

    If they cannot be written, a note in the outputs says so.
    """
    stopped_by = None if outcome.status == "Failed" else "duration limit" if outcome.timed_out else "canceled"
    try:
        complete_after_all(plan, ended_by=stopped_by)
    except OSError as error:  # the disk is full, or an application put something in the way
        add_note(plan.output_dir, f"robomaker: the table of trials cannot be written: {error}")


def _result_of_programs(plan: RunPlan, outcome: Outcome, times: tuple[datetime, datetime]) -> None:
    began, ended = times
    facts = {
        "sim_time_s": 0.0,
        "wall_time_s": (ended - began).total_seconds(),
        "real_time_factor": 0.0,
        "ended_by": _ended_by(outcome),
        "seed": plan.seed,
    }
    said = read_program_result(plan.output_dir, facts)
    if (result := said.result) is None:
        extra: dict[str, Any] = {"started_at": began.isoformat(), "ended_at": ended.isoformat()}
        wrong: dict[str, Any] = {}
        if said.problem is not None:
            path = plan.output_dir / RESULT_FILE
            path.replace(path.with_name(INVALID_RESULT_FILE))
            extra["invalid_result"] = f"an application wrote a {RESULT_FILE} that is none; it is {INVALID_RESULT_FILE}"
            wrong = {"verdict": "ERROR", "summary": f"An application's {said.problem}."}
        result = RunResult(**{"verdict": "NONE", **facts, **wrong}, versions=versions(), extra=extra)
    unjudged = [_never_judged(requirement, _ONLY_PROGRAMS) for requirement in plan.requirements]
    if outcome.status == "Canceled" and result.verdict != "NONE":
        result = result.unjudged()
    elif outcome.status == "Failed" and result.verdict not in ("FAIL", "ERROR"):
        broken = {"verdict": "ERROR", "summary": (outcome.failure_reason or "").partition("\n")[0]}
        result = result.model_copy(update=broken)
    elif outcome.status == "Completed":
        parts = Parts(own=result.verdict, requirements=[*result.requirements, *unjudged])
        if (verdict := decide_verdict(parts)) != result.verdict or unjudged:
            judged = {"verdict": verdict, "requirements": list(parts.requirements)}
            if unjudged:
                judged["extra"] = {**result.extra, OWN_VERDICT: result.verdict}
            result = result.model_copy(update=judged)
    if said.is_changed or result is not said.result:
        write_result(result, plan.output_dir)


def _ended_by(outcome: Outcome) -> str:
    if outcome.status == "Canceled":
        return RunStop.CANCELED
    return RunStop.DURATION_LIMIT if outcome.timed_out else "application"


def _never_judged(requirement: JobRequirement, why: str) -> Requirement:
    """Returns a requirement that could not be judged, with the reason."""
    return Requirement(
        name=requirement.name, kind=requirement.kind, satisfied=False, detail=f"could not be judged: {why}", error=why
    )


def with_judged(plan: RunPlan, result: RunResult, judged: RunResult | None, why: str | None) -> RunResult:
    """Returns a program's result with its requirements judged by the recording.

    Args:
        plan: Plan of the run.
        result: Result that a program wrote.
        judged: Result by the recording; None if the recording cannot be judged.
        why: Reason why it cannot be judged.
    """
    names = {each.name for each in plan.requirements}
    own = [each for each in result.requirements if each.name not in names or each.error is None]
    extra = dict(result.extra)
    verdict = extra.pop(OWN_VERDICT, result.verdict)
    if judged is None:
        rows = [_never_judged(each, why or _ONLY_PROGRAMS) for each in plan.requirements]
        changes: dict[str, Any] = {}
    else:
        rows = list(judged.requirements)
        changes = {
            "notes": list(dict.fromkeys([*result.notes, *judged.notes])),
            "metrics": {**result.metrics, **{k: v for k, v in judged.metrics.items() if k != "steps"}},
            "path": result.path or judged.path,
            "sim_time_s": result.sim_time_s or judged.sim_time_s,
            "summary": " ".join(text for text in (result.summary, judged.summary) if text),
        }
        extra |= judged.extra
    parts = Parts(own=verdict, requirements=[*own, *rows])
    return result.model_copy(
        update={**changes, "requirements": [*own, *rows], "extra": extra, "verdict": decide_verdict(parts)}
    )


def _add_tools(plan: RunPlan, tools: Sequence[ToolEnds]) -> None:
    """Adds the tools that ended to the result, and a note about tools that were restarted repeatedly."""
    loops = [f"{tool_in_words(tool, plan)}; it was started again each time" for tool in tools if tool.ends >= OFTEN]
    _change_result(plan.output_dir, lambda result: {"tools": list(tools), "notes": [*result.notes, *loops]})


def add_result_notes(output_dir: Path, notes: Sequence[str]) -> None:
    """Adds notes to a run's `result.json`, each at most once; does nothing without a result."""
    if notes:
        _change_result(output_dir, lambda result: {"notes": list(dict.fromkeys([*result.notes, *notes]))})


def _change_result(output_dir: Path, changes: Callable[[RunResult], dict[str, Any]]) -> None:
    """Changes members of `result.json`; if that fails, the file stays as it is, since it is complete."""
    if (result := read_result(output_dir)) is not None:
        with suppress(OSError):  # no room for a longer one, or an application put something in the way
            write_result(result.model_copy(update=changes(result)), output_dir)


def remove_verdict(output_dir: Path) -> None:
    """Removes the verdict from the `result.json` of a run that was cancelled just before its end was known.

    Does nothing if there is no result, or it has no verdict.
    """
    if (result := read_result(output_dir)) is not None and result.verdict != "NONE":
        with suppress(OSError):  # an application put something in the way
            write_result(result.unjudged(), output_dir)


def read_result(output_dir: Path) -> RunResult | None:
    """Reads the `result.json` of a run; `None` if it is missing or invalid."""
    try:
        return RunResult.model_validate_json(read_left(output_dir / RESULT_FILE, MAX_RESULT_BYTES))
    except (OSError, ValidationError):
        return None
