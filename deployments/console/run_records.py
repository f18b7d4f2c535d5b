"""Records of runs that have ended, for the pages of visitors who may see them."""

import math
import re
import time
from collections.abc import Callable, Mapping
from functools import cache, lru_cache
from pathlib import Path
from typing import NamedTuple

from ...schemas.reports.challenge import Challenge
from ...schemas.reports.names import began
from ...schemas.reports.run_record import CUT_SHORT, JobRecord, RunRecord
from ...schemas.reports.run_states import counts_in_words
from ...schemas.specs.batch_splitting import step_of
from ...schemas.wire.errors import ConfigurationError
from ...tasks.inspection.run_records import RECORD_NAME, is_night, read_record
from ...tasks.nights.open_runs import is_going
from ...tasks.reporting import classify
from ..spec_runs.spec_runs import read_standing
from .visit import Visit

RecordOf = Callable[[str], RunRecord | None]

_TIME_IN_RUN = re.compile(r"-\d{8}T\d+$")

_MOST_PROBED = 20
"""Newest runs of a specification among which its newest night is looked for: probes and reruns come between."""
_MOST_GOING = 5
"""Newest runs of a specification among which those that go on are looked for."""
_SEEN_FOR_S = 60.0
"""Seconds after which a page that is followed asks again whether a run may be seen: changed tags count by then."""


def sees_run(visit: Visit, record: RunRecord) -> bool:
    """Whether a visitor may see a run: if the visitor ordered it, or may see all its steps and jobs."""
    if visit.sees_all:
        return True
    standing = read_standing(place_of(record.run_id, visit).parent)
    if standing is not None and visit.key is not None and standing.key_id == visit.key.id:
        return True
    steps, jobs = ({each.arn for each in some if each.arn} for some in (record.steps, record.jobs))
    return bool(steps) and all(_sees_each(visit, arns) for arns in (steps, jobs))  # of others the first tells


def _sees_each(visit: Visit, arns: set[str]) -> bool:
    return len(visit.seen(visit.service.catalog.get_many(arns, ()).values())) == len(arns)


def place_of(run_id: str, visit: Visit) -> Path:
    """Returns the path of the record of a run, whether there is one or not."""
    return visit.service.settings.home / "runs" / run_id / RECORD_NAME


def is_known(name: str, visit: Visit) -> bool:
    """Whether there is a run of that id, which the visitor may see."""
    path = _record_path(name, visit)
    if path is None:
        return False
    if visit.sees_all:
        return True
    record = read_kept(path, path.stat().st_mtime_ns)
    return record is not None and sees_run(visit, record)


def _record_path(name: str, visit: Visit) -> Path | None:
    """Returns the path of the record of a run that has ended; `None` if there is none."""
    # Longer names are none: the file system would refuse them with an error of its own.
    is_name = "/" not in name and name not in ("", ".", "..") and len(name.encode()) <= 255
    path = place_of(name, visit)
    return path if is_name and path.is_file() else None


def record_of(run_id: str, visit: Visit) -> RunRecord | None:
    """Returns the record of a run that has ended; `None` if there is none that the visitor may see."""
    if not is_known(run_id, visit):
        return None
    path = place_of(run_id, visit)
    return read_kept(path, path.stat().st_mtime_ns)


class RunInNeed(NamedTuple):
    """A run that somebody has to look at although none of its jobs tells why."""

    run: RunRecord
    reason: str
    """Sentence without full stop on what is wrong with it."""


def runs_in_need(visit: Visit, record_of_run: RecordOf) -> list[RunInNeed]:
    """Returns the newest runs and challenges of specifications that are wrong for a reason which no job has.

    They were refused, ran out of time, failed at a step without jobs, or left sabotages unnoticed.

    Args:
        visit: The visit.
        record_of_run: Returns the record of a run that the visitor may see.
    """
    found: list[RunInNeed] = []
    folder = visit.service.settings.home / "runs"
    for ids in _ids_by_name(folder, folder.stat().st_mtime_ns) if folder.is_dir() else ():
        newest: dict[str, tuple[str, str]] = {}
        for run_id in ids[:_MOST_PROBED]:
            path = place_of(run_id, visit)
            kind, reason = _need_of(path, path.stat().st_mtime_ns) if path.is_file() else ("", "")
            newest.setdefault(kind, (run_id, reason))
        for kind, (run_id, reason) in newest.items():
            if kind and reason and (record := record_of_run(run_id)) is not None:
                found.append(RunInNeed(record, reason))
    return sorted(found, key=lambda each: each.run.started_at, reverse=True)


def going_runs(visit: Visit) -> list[str]:
    """Returns the ids of the runs that go on in this data home and that the visitor may see, the latest first.

    Only the newest runs of each specification are looked at: its runs follow each other.
    """
    folder = visit.service.settings.home / "runs"
    names = _ids_by_name(folder, folder.stat().st_mtime_ns) if folder.is_dir() else ()
    found = [run_id for ids in names for run_id in ids[:_MOST_GOING] if _is_going(run_id, visit)]
    return sorted(found, key=began, reverse=True)


def _is_going(run_id: str, visit: Visit) -> bool:
    path = place_of(run_id, visit)
    if path.is_file() or not is_going(path.parent):
        return False
    standing = None if visit.sees_all else read_standing(path.parent)
    is_own = standing is not None and visit.key is not None and standing.key_id == visit.key.id
    return visit.sees_all or is_own


@lru_cache(maxsize=8192)
def _need_of(path: Path, changed_at: int) -> tuple[str, str]:
    """Returns whether a record is of a `night` or a `challenge`, and what is wrong with it that none of its jobs tells.

    The first page asks every two seconds for many runs, more than records are kept, each of which takes milliseconds.
    """
    record = read_kept(path, changed_at)
    if record is None or not (is_night(record) or record.challenge is not None):
        return "", ""
    return "night" if is_night(record) else "challenge", _reason_without_job(record)


def _reason_without_job(record: RunRecord) -> str:
    """Returns what is wrong with a run that none of its jobs tells; empty: nothing is, or a job tells it."""
    if record.refusal is not None:
        return record.refused_in_words
    if record.challenge is not None:
        is_well = record.challenge.is_passed or record.state in CUT_SHORT
        return "" if is_well else _challenge_in_words(record.challenge)
    if record.state == "timed out":
        told = counts_in_words(record.jobs)
        return f"ran out of time: {told}" if told else "ran out of time"
    return record.step_error


def _challenge_in_words(challenge: Challenge) -> str:
    unnoticed = [each.name for each in challenge.sabotages if each.is_open] if challenge.showing else []
    names = f"; unnoticed: {', '.join(unnoticed)}" if unnoticed else ""
    return f"challenge: {challenge.headline}{names}"


@lru_cache(maxsize=4)
def _ids_by_name(folder: Path, _changed_ns: int) -> tuple[tuple[str, ...], ...]:
    """Returns the ids of runs by specification, the latest first; the folder is read again once a run came or went.

    The first page asks every two seconds, and thousands of folders take a tenth of a second.
    """
    found: dict[str, list[str]] = {}
    for run_id in sorted((path.name for path in folder.iterdir()), reverse=True):
        found.setdefault(run_id.rpartition("-")[0], []).append(run_id)
    return tuple(map(tuple, found.values()))


class SeenRecords:
    """Records of runs for a page that is followed: whether the visitor may see a run is asked once a minute.

    The catalog is asked for each job of a run where the key sees only some resources, and the page is made every two
    seconds.

    Args:
        visit: The visit.
        clock: Seconds, from any moment.
    """

    def __init__(self, visit: Visit, clock: Callable[[], float] = time.monotonic) -> None:
        self._visit = visit
        self._clock = clock
        self._asked: dict[str, tuple[float, bool]] = {}

    def of(self, run_id: str) -> RunRecord | None:
        """Returns the record of a run that has ended; `None` if there is none that the visitor may see."""
        path = _record_path(run_id, self._visit)
        if path is None:  # not remembered: the run may end any moment
            return None
        now_s = self._clock()
        asked_s, is_seen = self._asked.get(run_id, (-math.inf, False))
        if now_s - asked_s >= _SEEN_FOR_S:
            is_seen = is_known(run_id, self._visit)
            self._asked[run_id] = now_s, is_seen
        return read_kept(path, path.stat().st_mtime_ns) if is_seen else None


class JobsInRuns:
    """Records of jobs in their runs, for a page with jobs of several runs: each run is looked up once.

    Args:
        record_of_run: Returns the record of a run by its id; `None` while it goes on, or where there is none.
    """

    def __init__(self, record_of_run: RecordOf) -> None:
        self.record_of = cache(record_of_run)
        self._jobs: dict[str, Mapping[str, JobRecord]] = {}

    def find(self, arn: str, run_id: str | None) -> JobRecord | None:
        """Returns the record of a job in its run; `None` if it has none, or its run goes on."""
        if not run_id:
            return None
        if run_id not in self._jobs:
            record = self.record_of(run_id)
            self._jobs[run_id] = {} if record is None else {job.arn: job for job in record.jobs if job.arn}
        return self._jobs[run_id].get(arn)


def run_name(run_id: str, record: RunRecord | None) -> str:
    """Returns the name of a run's specification: that of its record, else its id without the time in it."""
    return record.name if record is not None else _TIME_IN_RUN.sub("", run_id)


def batch_name(arn: str, run_id: str, record: RunRecord | None) -> str:
    """Returns the name of a batch: `drive of nightly`, its step and specification; empty if no run ordered it."""
    step = next((step.name for step in record.steps if step.arn == arn), "") if record is not None else ""
    return f"{step} of {run_name(run_id, record)}" if step else run_name(run_id, record)


def has_known_failures_only(batch: str, record: RunRecord | None) -> bool:
    """Returns whether each failure of a batch is known or wanted in its run, so that it makes neither of them red.

    Args:
        batch: ARN of the batch.
        record: Record of its run; `None`: no failure is known.
    """
    if record is None:
        return False
    if record.challenge is not None:  # sabotaged robots have to fail
        return record.state == "succeeded"
    step = next((step.name for step in record.steps if step.arn == batch), None)
    jobs = [job for job in record.jobs if step is None or step in (job.step, step_of(job.step or ""))]
    failures = [job for job in jobs if classify(job.status, job.failure_code, job.verdict).is_failure]
    return bool(failures) and all(job.known for job in failures)


@lru_cache(maxsize=256)
def read_kept(path: Path, changed_at: int) -> RunRecord | None:
    """Reads a run's record, cached until its file changes; `None` if it cannot be read."""
    del changed_at
    try:
        return read_record(path)
    except (ConfigurationError, OSError):
        return None
