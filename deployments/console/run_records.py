"""Records of runs that have ended, for the pages of visitors who may see them."""

import math
import re
import time
from collections.abc import Callable, Mapping
from functools import cache, lru_cache
from pathlib import Path

from ...schemas.reports.run_record import JobRecord, RunRecord
from ...schemas.specs.batch_splitting import step_of
from ...schemas.wire.errors import ConfigurationError
from ...tasks.inspection.run_records import RECORD_NAME, read_record
from ...tasks.reporting import classify
from ..spec_runs.spec_runs import read_standing
from .visit import Visit

RecordOf = Callable[[str], RunRecord | None]

_TIME_IN_RUN = re.compile(r"-\d{8}T\d+$")

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
