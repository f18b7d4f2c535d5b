"""Summary at the end of `robomaker run`: outcomes, paths of outputs, command to run it again."""

import re
import shlex
from collections.abc import Mapping, Sequence
from typing import Any, TextIO

from ....schemas.reports.live_comparison import in_words
from ....schemas.reports.names import short_name
from ....schemas.reports.run_record import JobRecord, RunRecord, StepRecord, interrupted_in_words
from ....schemas.reports.run_states import counts_in_words, plain_reason, shown_state
from ....schemas.runs.plan import Requirement
from ....schemas.runs.trials import OF_ALL_TRIALS
from ....schemas.specs.parameter_values import values_in_words
from ....schemas.wire.common import counted
from ....schemas.wire.json_values import is_mapping
from ....tasks.reporting.outcomes import never_began, never_began_in_words
from .answers import Cell, duration, print_lines
from .challenge import challenge_lines

_STATE_STYLES = {"passed": "bold green", "succeeded": "bold green", "failed": "bold red", "broken": "bold red"}
_ANSWER_STYLES = {"better": "bold green", "not worse": "bold green", "worse": "bold red"}
_VERDICT_STYLES = {"PASS": "green", "FAIL": "red", "ERROR": "red"}
_MAX_JOBS = 40
_WITHOUT_MARGINS = (None, "predicate", "off")
"""Kinds of requirements whose margins are not told: the environment's own, and those that are met or not."""
_MAX_REASON = 500
"""Limit of the characters of a failure reason, or a remark, in the summary: the longest sentences of ours have 400."""
_LOG_SAYS = "; its log ends with: "
_LOG_BEGINS = "\nLast lines of "
_ERROR_CLASS = re.compile(r"[\w.]+: ")


def print_summary(
    record: RunRecord,
    command: Sequence[str],
    stream: TextIO,
    *,
    server: str = "",
    page: str = "",
    lost: Sequence[str] = (),
    why: Sequence[str] = (),
) -> None:
    """Prints the final summary of a run: results, report and next commands.

    Args:
        record: The run.
        command: The command that runs it again.
        stream: Output stream, such as standard output.
        server: Address of the Prefect server's pages; empty: not shown.
        page: Address of the run's page in the console; empty: not shown.
        lost: Lines about what it judges less than earlier runs.
        why: Lines about groups of its failures.
    """
    print_lines(summary_lines(record, command, server=server, page=page, lost=lost, why=why), stream)


def summary_lines(
    record: RunRecord,
    command: Sequence[str],
    *,
    server: str = "",
    page: str = "",
    lost: Sequence[str] = (),
    why: Sequence[str] = (),
) -> list[list[Cell]]:
    """Returns the final summary of a run as lines of styled text."""
    took = duration((record.ended_at - record.started_at).total_seconds())
    head: list[Cell] = [(f"{record.name}: ", ""), (shown_state(record), _STATE_STYLES.get(record.state, "bold yellow"))]
    lines: list[list[Cell]] = [[], [*head, (f"{_headline(record)} after {took}", "")]]
    lines += _origin_lines(record, took)
    if failed := [step for step in record.steps if step.error]:
        lines += [[], *(_step_line(step) for step in failed)]
    if record.challenge is not None:
        lines += [[], *challenge_lines(record.challenge)]
    elif record.jobs:
        lines += [[], *_job_lines(record), *_margin_lines(record.jobs), *_known_lines(record.known_notes)]
    if why:
        lines += [[], *([("  why: ", "dim"), (_cut(line), "")] for line in why)]
    lines += _changed_lines(lost)
    lines.append([])
    if record.report_path:
        lines.append(_place("report", str(record.report_path)))
    if folder := _outputs(record.jobs):
        lines.append(_place("outputs", folder))
    lines += [_place("worlds", f"robomaker world sheet {job}") for job in _world_jobs(record.steps)]
    lines.append(_place("record", str(record.run_dir / "run.json")))
    if page:
        lines.append(_place("console", page))
    if server:
        lines.append(_place("prefect", server))
    lines.append(_place("again", shlex.join(command)))
    return lines


def _origin_lines(record: RunRecord, took: str) -> list[list[Cell]]:
    """Describes a run's origin: parameters, rerun of which run, interruptions, comparison, forecast, reused parts."""
    lines: list[list[Cell]] = []
    if record.parameters:
        lines.append([(f"with {values_in_words(record.parameters)}", "")])
    if rerun := record.rerun_of:
        lines.append([(f"rerun of {rerun.run_id} ({rerun.selection})", "")])
    if interrupted := interrupted_in_words(record.interruptions):
        lines.append([(interrupted, "")])
    if record.against:
        lines.append([(in_words(record.against), _ANSWER_STYLES.get(record.against.answer, "bold yellow"))])
    if check := record.forecast:
        lines.append([(f"forecast {duration(check.forecast_s)}, took {took} ({check.difference})", "")])
    if reused := [job for job in record.jobs if job.reused_from]:
        lines.append([(f"{len(reused)} of {len(record.jobs)} results taken over from earlier runs", "")])
    return lines


def _changed_lines(lost: Sequence[str]) -> list[list[Cell]]:
    return [[], *([(f"  {line}", "yellow")] for line in lost)] if lost else []


def _headline(record: RunRecord) -> str:
    counts = counts_in_words(record.jobs) if record.challenge is None else counted(len(record.jobs), "job")
    return f", {counts}," if counts else ""


def _step_line(step: StepRecord) -> list[Cell]:
    error = step.error or ""
    said = _in_one_line(error) if _LOG_BEGINS in error else error  # other errors may have a line for each problem
    return [("  ✗ ", "red"), (f"{step.name} ({step.operation}): ", "bold"), (said, "")]


def _job_lines(record: RunRecord) -> list[list[Cell]]:
    """Returns the table of jobs; requests whose batch ended before are one line."""
    begun = [(number, job) for number, job in enumerate(record.jobs, start=1) if not never_began(job)]
    lines = _job_table(begun) if begun else []
    is_decided = record.against is not None and record.against.stopped_early
    if left := never_began_in_words(len(record.jobs) - len(begun), is_decided=is_decided):
        lines.append([(f"  {left}", "dim")])
    return lines + _remark_lines(record.jobs)


def _job_table(jobs: Sequence[tuple[int, JobRecord]]) -> list[list[Cell]]:
    shown = jobs[:_MAX_JOBS]
    titles = ("#", "job", "verdict", "world", "setting", "rooms", "simulated", "wall time", "id", "", "")
    table = [[(title, "dim") for title in titles]]
    table += [_job_cells(number, job) for number, job in shown]
    # A column that says nothing about any job is left out.
    filled = [column for column in range(len(titles)) if any(row[column][0] for row in table[1:])]
    rows: list[list[Cell]] = [[row[column] for column in filled] for row in table]
    widths = [max(len(row[column][0]) for row in rows) for column in range(len(rows[0]))]
    lines = []
    for row in rows:
        padded = [(text.ljust(width) + "  ", style) for (text, style), width in zip(row, widths, strict=True)]
        while padded and not padded[-1][0].strip():
            padded.pop()
        padded[-1] = (padded[-1][0].rstrip(), padded[-1][1])
        lines.append([("  ", ""), *padded])
    if len(jobs) > len(shown):
        lines.append([(f"  … and {len(jobs) - len(shown)} more; the report has them all", "dim")])
    return lines


def _margin_lines(jobs: Sequence[JobRecord]) -> list[list[Cell]]:
    """Names the trial with the smallest margin of each requirement that all trials of all jobs met.

    None is named where some trials were not judged: one of them may have a smaller margin. Only requirements of the
    request are told of; in jobs that failed, reasons name the trials.
    """
    if not all(map(_is_judged, jobs)):
        return []
    found: dict[str, list[tuple[float, JobRecord, Requirement]]] = {}
    missed: set[str] = set()
    for job in jobs:
        for each in job.requirements:
            if not each.satisfied:
                missed.add(each.name)
            elif each.trial is not None and each.margin is not None and each.kind not in _WITHOUT_MARGINS:
                found.setdefault(each.name, []).append((each.margin, job, each))
    smallest = [min(those, key=lambda it: it[0]) for name, those in found.items() if name not in missed]
    return [
        [
            (f"  {each.name}: ", ""),
            (f"smallest margin {each.margin_text}, trial {each.trial}: ", "dim"),
            (f"robomaker repro {job.label} --trial {each.trial}", "dim"),
        ]
        for _, job, each in smallest[:_MAX_JOBS]
    ]


def _is_judged(job: JobRecord) -> bool:
    """Whether a job has a verdict, and so have all of its trials."""
    if job.status != "Completed" or job.verdict not in ("PASS", "FAIL"):
        return False
    has_trials = any(each.name == OF_ALL_TRIALS for each in job.requirements)
    return not (has_trials and job.unnamed_failure)  # trials broke, are missing or have no verdict


def _known_lines(notes: Sequence[str]) -> list[list[Cell]]:
    return [[(f"  {note}", "yellow")] for note in notes]


def _remark_lines(jobs: Sequence[JobRecord]) -> list[list[Cell]]:
    """Lists the remarks of jobs, a remark that many jobs share as one line; the list is cut after some lines."""
    by_remark: dict[str, list[str]] = {}
    for job in jobs:
        for remark in job.remarks:
            by_remark.setdefault(_in_one_line(remark), []).append(job.title)
    return [
        [(f"  {labels[0] if len(labels) == 1 else counted(len(labels), 'job')}: ", ""), (_cut(remark), "yellow")]
        for remark, labels in by_remark.items()
    ][:_MAX_JOBS]


def _job_cells(number: int, job: JobRecord) -> list[Cell]:
    # What a run that was cut short was judged to be means nothing.
    verdict = job.verdict if job.verdict and job.status == "Completed" else job.status
    rooms = f"{job.rooms_visited}/{job.rooms_total}" if job.rooms_total else ""
    simulated, took = (duration(each) if each is not None else "" for each in (job.sim_time_s, job.duration_s))
    reason = _in_one_line(job.failure_reason or plain_reason(job.verdict_reason or ""))
    known = f"known, {job.known}" if job.known else ""
    trouble = ": ".join(part for part in (known, job.failure_code or "", reason) if part)
    style = "yellow" if job.known else _VERDICT_STYLES.get(verdict, "yellow" if job.status == "Completed" else "red")
    origin = f"from {job.reused_from}" if job.reused_from else f"was {job.earlier}" if job.earlier else ""
    return [
        (str(number), "dim"),
        (job.title, ""),
        (verdict, style),
        ("" if job.name else job.world or "", ""),  # the name says it
        ("" if job.variant in job.name else job.variant, ""),
        (rooms, ""),
        (simulated, ""),
        (took, ""),
        (job.label if job.title != job.label else "", "dim"),
        (origin, "dim"),
        (_cut(trouble), "yellow" if job.known else "red"),
    ]


def _in_one_line(reason: str) -> str:
    """Shortens a reason to one line, with the last line of the log that it ends with.

    The log's line is left out if it repeats the reason.
    """
    head, _, log = reason.strip().partition(_LOG_BEGINS)
    first = next(iter(head.splitlines()), "")
    last = log.splitlines()[-1].strip() if "\n" in log else ""
    # An error's line in a log begins with its class; a reason may begin with whose error it is.
    is_said = last in first or first in last or first.endswith(f": {_ERROR_CLASS.sub('', last, count=1)}")
    return first if is_said else f"{first}{_LOG_SAYS}{last}"


def _cut(text: str) -> str:
    """Shortens a text at its end, after a word; the line that a log ends with says where it happened, and is kept."""
    if len(text) <= _MAX_REASON:
        return text
    said, _, log = text.partition(_LOG_SAYS)
    rest = _LOG_SAYS + _beginning(log, _MAX_REASON // 2) if log else ""
    return f"{_beginning(said, _MAX_REASON - len(rest))}{rest} (cut here; the report has all of it)"


def _beginning(text: str, most: int) -> str:
    """Returns the beginning of a text, up to the end of a word if it has several, with `…` where something follows."""
    if len(text) <= most:
        return text
    return f"{text[:most].rpartition(' ')[0] or text[:most]} …"


def _outputs(jobs: Sequence[JobRecord]) -> str:
    """Returns the folder that all jobs' outputs have in common; empty if no job has outputs."""
    places = [job.output_uri.rstrip("/").split("/") for job in jobs if job.output_uri]
    if not places:
        return ""
    common = []
    for parts in zip(*places, strict=False):
        if len(set(parts)) > 1:
            break
        common.append(parts[0])
    return "/".join(common)


def _world_jobs(steps: Sequence[StepRecord]) -> list[str]:
    """Returns the ids of generation jobs that made worlds, each of which has a contact sheet."""
    return [
        short_name(step.arn)
        for step in steps
        if step.operation == "CreateWorldGenerationJob" and step.arn and _made_worlds(step.output)
    ]


def _made_worlds(output: Mapping[str, Any]) -> bool:
    finished = output.get("finishedWorldsSummary")
    return is_mapping(finished) and bool(finished.get("succeededWorlds"))


def _place(what: str, where: str) -> list[Cell]:
    return [(f"  {what:<8} ", "dim"), (where, "")]
