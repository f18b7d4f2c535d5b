"""Display of job states in the web console (text, colour, icon as in reports), also of unfinished jobs."""

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, replace
from datetime import datetime

from ...schemas.documents.simulation_jobs import JobInBrief
from ...schemas.documents.worlds import StoredPlace
from ...schemas.lifecycles import is_terminal
from ...schemas.reports.report import Share
from ...schemas.reports.run_record import JobRecord
from ...schemas.reports.run_states import plain_reason
from ...tasks.catalog import Resource
from ...tasks.reporting import classify
from ...tasks.results.rates import share_of
from ...tasks.service.references import name_of_job

JOB = "simulation-job"
_ICONS = {"running": "unfinished", "waiting": "unjudged", "known": "unjudged"}


@dataclass(frozen=True)
class Look:
    """Display of a state in the web console: text, CSS class and icon."""

    key: str
    """CSS class of a resource's state."""
    value: str
    """Text of the state."""

    @property
    def icon(self) -> str:
        """HTML icon of a resource's state."""
        return _ICONS.get(self.key, self.key)


WAITING, RUNNING = Look("waiting", "waiting"), Look("running", "running")
KNOWN = Look("known", "known failure")
"""State of a job that failed as its specification knows: not red, since it makes no run red."""
DRAWING, STORING = Look("running", "drawing"), Look("running", "storing")
UNFINISHED = (WAITING, RUNNING, DRAWING, STORING)


@dataclass(frozen=True)
class JobLine:
    """A simulation job in a list or grid of the web console."""

    id: str
    name: str
    """Name for people, `scout in flat 3`; the id where it has none. Others may have it, too."""
    status: str
    look: Look
    number: int
    """Number of the job in its batch, from 1; 0: it is in no batch."""
    reason: str
    created_at: datetime
    updated_at: datetime
    duration_s: float | None
    outputs: StoredPlace | None
    tags: dict[str, str]
    parts_s: dict[str, float]
    """Time that a job took, in seconds, by activity."""
    known: str = ""
    """Owner, last day and reason of its failure, if that is known in its run; else empty."""

    @property
    def is_failure(self) -> bool:
        """Whether the job failed or broke, and not as its specification knows, so that a person has to examine it."""
        return self.look.key in ("broken", "failed")


def look_of_status(kind: str, status: str) -> Look:
    """Returns the display of the status of a resource without verdict."""
    if not is_terminal(kind, status):
        return WAITING if status == "Pending" else RUNNING
    if status in ("Failed", "PartialFailed"):
        return Look("broken", status)
    return Look("canceled", "canceled") if status in ("Canceled", "TimedOut") else Look("passed", status)


def job_line(job: Resource) -> JobLine:
    """Makes the web console's row of a simulation job: name, status, outcome, reason in one line, times in seconds."""
    document = JobInBrief.of(job)
    if is_terminal(JOB, job.status):
        outcome = classify(job.status, document.failure_code, document.verdict)
        look = Look(outcome.key, outcome.value)
    else:
        look = _look_of_unfinished(job.status, draws=document.simulated_at is not None)
    told = (document.failure_reason, document.verdict_reason) if job.status == "Failed" else (document.verdict_reason,)
    reason = plain_reason(next((text for text in told if text), ""))
    code = f"{document.failure_code}: " if document.failure_code and job.status == "Failed" else ""
    took = document.simulation_time_millis
    return JobLine(
        id=job.id,
        name=name_of_job(document) or job.id,
        status=job.status,
        look=look,
        number=(document.request_index or 0) + 1 if job.parent else 0,
        reason=f"{code}{next(iter(reason.strip().splitlines()), '')}",
        created_at=job.created_at,
        updated_at=job.updated_at,
        duration_s=None if took is None else took / 1000,
        outputs=document.outputs,
        tags=dict(job.tags),
        parts_s={
            "waiting": sum(document.waited_s.values()),
            "simulation": (took or 0) / 1000,
            "videos of failures": document.video_s or 0.0,
            "uploads": document.upload_s or 0.0,
        },
    )


def named_in_run(line: JobLine, record: JobRecord | None) -> JobLine:
    """Returns the row with the job's name in its run, and as a known failure if it is one there.

    No other job of the run has that name: `scout in flat 3, seed=4`.

    Args:
        line: Row of the job.
        record: Its record in its run; `None`: it has none, or the run goes on.
    """
    if record is None:
        return line
    named = replace(line, name=record.name or line.name)
    return replace(named, look=KNOWN, known=record.known) if record.known and line.is_failure else named


def _look_of_unfinished(status: str, *, draws: bool) -> Look:
    """Returns how an unfinished job is shown, by its status and whether its programs have ended."""
    if status == "Pending":
        return WAITING
    if not draws:
        return RUNNING
    return STORING if status == "Terminating" else DRAWING


def rate_of(lines: Iterable[JobLine]) -> Share | None:
    """Returns the pass rate of jobs, with its interval; `None` while none is judged."""
    counts = Counter(line.look.key for line in lines)
    share = share_of("", counts["passed"], counts["failed"] + counts["known"])  # a failure is one, known or not
    return None if share.rate is None else share
