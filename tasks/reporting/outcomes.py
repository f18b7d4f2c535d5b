"""Outcomes of jobs and runs, and formatting of numbers, sizes and durations."""

import math
import re
from collections import Counter
from collections.abc import Iterable, Mapping
from datetime import UTC, datetime
from enum import Enum
from types import MappingProxyType
from typing import Any

from ...schemas.operations.registry import VIDEO_TAG
from ...schemas.reports.report import JobCase, Report, ReportedJob
from ...schemas.reports.run_record import JobRecord, case_outcome
from ...schemas.runs.plan import Verdict
from ...schemas.runs.programs import StopReason
from ...schemas.runs.trials import planned_trials
from ...schemas.wire.common import counted, passed_of


class Outcome(Enum):
    """Outcome of a simulation job, worst first; a failed robot and a broken machine are different outcomes."""

    BROKEN = "broken"
    FAILED = "failed"
    CANCELED = "canceled"
    UNFINISHED = "unfinished"
    UNJUDGED = "no verdict"
    PASSED = "passed"

    @property
    def key(self) -> str:
        """Short name of the outcome for CSS classes and icons."""
        return self.name.lower()

    @property
    def rank(self) -> int:
        """Severity rank of the outcome, 0 for the worst."""
        return list(Outcome).index(self)

    @property
    def is_failure(self) -> bool:
        """Whether readers have to look at jobs of this outcome first."""
        return self in (Outcome.BROKEN, Outcome.FAILED)


def outcome_of(job: ReportedJob) -> Outcome:
    """Returns the outcome of a simulation job."""
    return classify(job.status, job.failure_code, job.result.verdict if job.result else None)


def classify(status: str, failure_code: str | None, verdict: Verdict | None) -> Outcome:
    """Determines a job's outcome from its status, failure code and verdict.

    The status takes precedence: a verdict counts only if the job ended by itself.

    Args:
        status: The job's status, or `NotCreated`.
        failure_code: Failure code of the job; None if it did not fail.
        verdict: The simulation's verdict; None if there is none.
    """
    return Outcome(case_outcome(status, verdict, failure_code))


def never_began(job: JobRecord | ReportedJob | JobCase) -> bool:
    """Whether no job was made of a request, as its batch ended before: such requests are counted, and not listed."""
    return job.arn is None and job.failure_code == StopReason.BATCH_CANCELED


def never_began_in_words(count: int, *, is_decided: bool) -> str:
    """Counts jobs that never began: `18 jobs were not needed: it was decided before`; empty if there are none.

    Args:
        count: Number of the jobs.
        is_decided: Whether the comparison with an earlier run had its answer, which ended the batch.
    """
    if not count:
        return ""
    why = "needed: it was decided before" if is_decided else "started: the batch was canceled before"
    return f"{counted(count, 'job')} {'was' if count == 1 else 'were'} not {why}"


def count_outcomes(jobs: Iterable[ReportedJob]) -> dict[Outcome, int]:
    """Counts jobs by outcome, worst first; outcomes that did not occur are left out."""
    counts = Counter(outcome_of(job) for job in jobs)
    return {outcome: counts[outcome] for outcome in Outcome if counts[outcome]}


def headline(report: Report) -> str:
    """Summarises a run in one line without a full stop: `3 of 4 jobs passed; 1 failed`.

    A run of a challenge has that one's line; a run without jobs says how many worlds it made, and one that was refused
    why.
    """
    if report.refusal:
        return f"refused before its first step: {report.refusal}"
    if report.challenge is not None:
        return report.challenge.headline
    if not report.jobs:
        worlds = len(report.worlds)
        return (
            f"No simulation jobs; {worlds} {'world' if worlds == 1 else 'worlds'}"
            if worlds
            else "Nothing was simulated"
        )
    counts = count_outcomes(report.jobs)
    sentence = passed_of(counts.get(Outcome.PASSED, 0), len(report.jobs), "job")
    others = [f"{count} {outcome.value}" for outcome, count in counts.items() if outcome is not Outcome.PASSED]
    if known := sum(bool(job.known) for job in report.jobs):
        others.append(f"{known} of the failures {'is' if known == 1 else 'are'} known")
    return f"{sentence}; {', '.join(others)}" if others else sentence


def times_with_videos(requests: Iterable[Mapping[str, Any]]) -> tuple[str, str]:
    """Names the times of simulations and of videos, by when the jobs' requests have videos made.

    With `video: always` a video is made while the simulation runs, and only the last seconds of failures follow; so are
    those of trials, which are run again.

    Args:
        requests: Requests of the jobs.
    """
    policies = [(asked.get("video") or (asked.get("tags") or {}).get(VIDEO_TAG), asked) for asked in requests]
    is_meanwhile = any(
        policy == "always" or (policy == "on-failure" and planned_trials(asked)) for policy, asked in policies
    )
    follows = "last seconds of failures" if any(policy == "always" for policy, _ in policies) else "videos of failures"
    return ("simulation with its videos" if is_meanwhile else "simulation"), follows


_SHOWN_S = 0.1
_UNITS = {
    "m": "m", "s": "s", "N": "N", "m2": "m²", "rad": "rad", "deg": "°", "mps": "m/s", "m_s": "m/s", "Hz": "Hz",
    "kg": "kg", "J": "J", "W": "W", "ms": "ms", "bytes": "B", "percent": "%",
}  # fmt: skip
_TERMINAL_CODES = re.compile(r"\x1b(?:\[[0-?]*[ -/]*[@-~]|\][^\x07\x1b]*(?:\x07|\x1b\\)|[@-Z\\-_])")
_CONTROLS = re.compile(r"[\x00-\x08\x0b\x0c\x0e-\x1f\x7f]")


def duration(seconds: float) -> str:
    """Formats a duration in seconds: `20 ms`, `12.3 s`, `2 min 5 s`, `1 h 3 min`."""
    if seconds < 0.0995:
        return f"{seconds * 1000:.0f} ms"
    if seconds < 59.95:
        return f"{seconds:.1f} s"
    minutes, rest = divmod(round(seconds), 60)
    if minutes < 60:
        return f"{minutes} min {rest} s" if rest else f"{minutes} min"
    hours, minutes = divmod(minutes, 60)
    return f"{hours} h {minutes} min" if minutes else f"{hours} h"


def times_by_part(parts: Mapping[str, float]) -> str:
    """Formats durations by part: `waiting 3.0 s, simulation 80 s, uploads 5.0 s`; those below 0.1 s are left out.

    Args:
        parts: Seconds by activity.
    """
    return ", ".join(f"{name} {duration(time_s)}" for name, time_s in parts.items() if time_s >= _SHOWN_S)


def moment(time: datetime) -> str:
    """Formats a time with seconds: `2026-03-02 09:30:00 UTC`; a time without zone is taken as UTC."""
    in_utc = time.astimezone(UTC) if time.tzinfo else time
    return f"{in_utc:%Y-%m-%d %H:%M:%S} UTC"


def minute(time: datetime) -> str:
    """Formats a time with minutes: `2026-03-02 09:30`, in UTC."""
    return moment(time)[:16]


def day(time: datetime) -> str:
    """Formats a date: `2026-03-02`, in UTC."""
    return moment(time)[:10]


def size(count: int) -> str:
    """Formats a number of bytes with a decimal prefix: `17 B`, `4.2 kB`, `1.3 MB`."""
    value = float(count)
    for unit in ("B", "kB", "MB", "GB"):
        if value < 999.5:
            return f"{value:.0f} {unit}" if unit == "B" or value >= 99.5 else f"{value:.1f} {unit}"
        value /= 1000
    return f"{value:.1f} TB"


def number(value: float | None, digits: int) -> str:
    """Formats a number with a fixed number of decimals; `–` for none."""
    return "–" if value is None or not math.isfinite(value) else f"{value:.{digits}f}"


def compact(value: float) -> str:
    """Formats a number: whole ones without decimals, `12`, others with four significant digits, `0.3333`."""
    if math.isfinite(value) and value == int(value) and abs(value) < 1e15:
        return str(int(value))
    return f"{value:.4g}"


_NAMES: Mapping[str, tuple[str, str]] = MappingProxyType(
    {"sim_time_s": ("simulated time", "s"), "trials_errors": ("trials that broke", "")}
)
"""Names and units of metrics whose own names would not be understood."""


def name_and_unit(metric: str) -> tuple[str, str]:
    """Splits a metric's name from its unit: `path_length_m` gives `path length` and `m`.

    A mean is named once, also that of means over trials: `mean_mean_speed_mps` gives `speed, mean` and `m/s`.
    """
    if metric in _NAMES:
        return _NAMES[metric]
    if metric.startswith("mean_"):
        name, unit = name_and_unit(metric.removeprefix("mean_"))
        return f"{name.removesuffix(', mean')}, mean", unit
    for suffix in sorted(_UNITS, key=len, reverse=True):
        stem = metric.removesuffix(f"_{suffix}")
        if stem and stem != metric:
            return stem.replace("_", " "), _UNITS[suffix]
    return metric.replace("_", " "), ""


def plain(text: str) -> str:
    """Removes terminal colours and control characters from log text."""
    return _CONTROLS.sub("", _TERMINAL_CODES.sub("", text.replace("\r\n", "\n"))).strip("\n")


def why_no_video_of_trial(policy: str, verdict: str) -> str:
    """Returns why a recorded trial has no video, as a clause with code in backticks.

    Args:
        policy: Video policy of the job's request: `none`, `on-failure` or `always`.
        verdict: Verdict of the trial; empty if its result cannot be read.
    """
    if policy == "none":
        return "the request asks for none"
    if policy == "on-failure" and verdict in ("PASS", "NONE"):
        return "the trial did not fail, and the request asks for videos of failures only (`video: on-failure`)"
    if policy == "on-failure" and verdict:
        return (
            "with `video: on-failure` only the first trials that do not pass have one, as many as `record_failed` says"
        )
    return "none is stored"
