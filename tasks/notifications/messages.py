"""What a notification says, and when one is sent: pure functions of a run and of the one before it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from ...schemas.reports.run_record import JobRecord, RunRecord
from ...schemas.runs.plan import Requirement
from ...schemas.settings import NotifyWhen

WORST = 3
"""How many failures a message has."""

_MAX_REASON = 300
_NO_JOB = ("Failed", "NotCreated")


@dataclass(frozen=True)
class Failure:
    """A job that did not pass."""

    job: JobRecord
    missed: tuple[Requirement, ...] = ()
    """The requirements that it missed, as far as they are known."""

    @property
    def broke(self) -> bool:
        """Whether it could not be judged, which is worse than a verdict."""
        return self.job.status in _NO_JOB or self.job.verdict == "ERROR"


@dataclass(frozen=True)
class Message:
    """What is sent."""

    title: str
    body: str
    good: bool


def is_due(when: frozenset[NotifyWhen], record: RunRecord, before: RunRecord | None) -> bool:
    """Whether a run is told of.

    A run that was cancelled says nothing about the robot, and is told only where all are.

    Args:
        when: what is to be told.
        record: the run.
        before: the last run of the specification before it that was not cancelled; None: there is none.
    """
    if "always" in when:
        return True
    if record.state == "canceled":
        return False
    good, was_good = record.state == "succeeded", before is None or before.state == "succeeded"
    if good:
        return not was_good and bool(when & {"recovery", "change"})
    return "failure" in when or ("change" in when and was_good)


def failed_jobs(record: RunRecord) -> list[JobRecord]:
    """The jobs that did not pass, in the order of their requests; those that were cancelled do not count."""
    return [job for job in record.jobs if job.status != "Canceled" and (Failure(job).broke or job.verdict == "FAIL")]


def worst_first(failures: Sequence[Failure]) -> list[Failure]:
    """What broke first, then those that missed most requirements; else in the order of their requests."""
    return sorted(failures, key=lambda failure: (not failure.broke, -len(failure.missed)))


def message_of(record: RunRecord, failures: Sequence[Failure], before: RunRecord | None) -> Message:
    """Writes the message of a run.

    Args:
        record: the run.
        failures: all its failures, the worst first.
        before: the last run of the specification before it; None: there is none.
    """
    good = record.state == "succeeded"
    again = ", good again" if good and before is not None and before.state != "succeeded" else ""
    counts = _counts(record, failures)
    lines = [f"{counts}." if counts else "It made no simulation jobs.", ""]
    lines += [f"Step {step.name} ({step.operation}): {_short(step.error)}" for step in record.steps if step.error]
    lines += [f"{number}. {_line(failure)}" for number, failure in enumerate(failures[:WORST], start=1)]
    if len(failures) > WORST:
        lines.append(f"and {len(failures) - WORST} more")
    if lines[-1]:
        lines.append("")
    if record.report_path:
        lines.append(f"Report: {record.report_path}")
    if failures:
        lines.append(f"Run these again: robomaker rerun {record.run_id} --failed")
    return Message(f"{record.name}: {record.state}{again}" + (f", {counts}" if counts else ""), "\n".join(lines), good)


def _counts(record: RunRecord, failures: Sequence[Failure]) -> str:
    if not record.jobs:
        return ""
    broke = sum(failure.broke for failure in failures)
    told: Mapping[str, int] = {
        "pass": sum(job.verdict == "PASS" and job.status == "Completed" for job in record.jobs),
        "fail": len(failures) - broke,
        "broke": broke,
        "canceled": sum(job.status == "Canceled" for job in record.jobs),
    }
    parts = [f"{count} {word}" for word, count in told.items() if count or word == "pass"]
    return f"{', '.join(parts)} of {len(record.jobs)} job{'s' if len(record.jobs) != 1 else ''}"


def _line(failure: Failure) -> str:
    job = failure.job
    where = f"{job.label} in {job.world}" if job.world else job.label
    if failure.missed and not job.failure_reason:
        return f"{where}: " + _short("; ".join(f"{each.name}: {each.detail}" for each in failure.missed))
    reason = job.failure_reason or job.verdict_reason or ""
    return f"{where}: " + _short(": ".join(part for part in (job.failure_code, reason) if part) or job.status)


def _short(text: str | None) -> str:
    line = " ".join((text or "").partition("\nLast lines of ")[0].split())
    return line if len(line) <= _MAX_REASON else f"{line[: _MAX_REASON - 1]}…"
