"""Stored records of runs in their folders, and the Git commit from which a run was started."""

import logging
import subprocess
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

from pydantic import ValidationError

from ...schemas.reports.changes import SinceLastRun
from ...schemas.reports.run_record import RunRecord, SourceCommit
from ...schemas.wire.errors import ConfigurationError
from ..comparison.compared_runs import NightRun
from ..comparison.history import since_last_good_run, since_last_run
from ..files.whole_files import write_whole

RECORD_NAME, ORDER_NAME = "run.json", "order.json"
"""File name of a run's record, and of the file that replaces it until the run has ended."""
MOST_NIGHTS = 100
"""Maximum number of runs that a history reads, or a report for the date since which a job fails."""


@dataclass(frozen=True)
class FoundRecords:
    """Records of a specification's runs, and the number of older runs that were left out."""

    records: list[RunRecord]
    """Records of the latest runs, the oldest first."""
    left_out: int
    """Number of older run folders that were not read."""
    unreadable: list[str]
    """Error messages of records that cannot be read."""


def read_record(path: Path) -> RunRecord:
    """Reads the record of a run (`run.json`), with the paths of the folder that it is in now.

    Raises:
        ConfigurationError: The file is not a record, or is one of a newer version.
    """
    try:
        return RunRecord.stored_in(path.parent, path.read_bytes())
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(map(str, first["loc"]))
        raise ConfigurationError(f"{path} is not a run's record: {place}: {first['msg']}") from error


def write_record(record: RunRecord) -> None:
    """Writes the record of a run into the run's folder, in a file that is replaced as a whole."""
    write_whole(record.run_dir / RECORD_NAME, record.model_dump_json(indent=2, exclude_none=True))


def find_records(runs: Path, name: str, most: int = MOST_NIGHTS, before: datetime | None = None) -> FoundRecords:
    """Finds the records of a specification's latest runs; partial reruns and probes are left out.

    Args:
        runs: Folder of all runs; each run's folder begins with its specification's name.
        name: Name of the specification.
        most: Maximum number of records.
        before: Time before which the runs began; None: no limit.
    """
    records: list[RunRecord] = []
    unreadable: list[str] = []
    paths = _latest_first(runs, name)
    looked_at = 0
    for path in paths:
        if len(records) == most:
            break
        looked_at += 1
        try:
            record = read_record(path)
        except (ConfigurationError, OSError) as problem:
            unreadable.append(str(problem))
            continue
        if is_night(record) and (before is None or record.started_at < before):
            records.append(record)
    return FoundRecords(records[::-1], len(paths) - looked_at, unreadable)


def run_before(record: RunRecord) -> RunRecord | None:
    """Returns the previous full run of the same specification, cancelled ones left out; `None` if there is none."""
    for path in _latest_first(record.run_dir.parent, record.name):
        with suppress(ConfigurationError, OSError):
            earlier = read_record(path)
            told = is_night(earlier) and earlier.state != "canceled"
            if told and earlier.ended_at <= record.started_at:
                return earlier
    return None


def is_night(record: RunRecord) -> bool:
    """Returns whether a run had all jobs of its specification: no partial rerun, and no probe."""
    return record.rerun_of is None and not record.probe


def names_of_specifications(runs: Path) -> list[str]:
    """Lists the names of specifications that have runs, from the run folders' names."""
    return sorted({_name_of(path) for path in _records(runs)} - {""})


def since_last(run: NightRun, runs: Path) -> SinceLastRun:
    """Compares a run with earlier runs of its specification: which jobs and requirements changed."""
    earlier = find_records(runs, run.name, before=run.started_at).records
    return since_last_run([*map(NightRun.of, earlier), run])


def since_last_good(record: RunRecord) -> SinceLastRun:
    """Compares a run with the run before, and lists all jobs lost since the last successful run."""
    earlier = find_records(record.run_dir.parent, record.name, before=record.started_at).records
    return since_last_good_run(list(map(NightRun.of, [*earlier, record])))


def ids_of_runs(runs: Path, name: str) -> list[str]:
    """Lists the ids of all runs of a specification that have a record, the latest first; no record is read.

    Args:
        runs: Folder of all runs.
        name: Name of the specification.
    """
    return [path.parent.name for path in _latest_first(runs, name)]


def _latest_first(runs: Path, name: str) -> list[Path]:
    """Returns the paths of a specification's run records, the latest first, by the times in their folders' names."""
    return sorted((path for path in _records(runs) if _name_of(path) == name), reverse=True)


def _name_of(record: Path) -> str:
    return record.parent.name.rpartition("-")[0]


def _records(runs: Path) -> Iterator[Path]:
    return runs.glob(f"*/{RECORD_NAME}")


_LIMIT_S = 10.0
# A repository's own settings name programs that Git would start, and nothing is to be written into it.
_GIT = ("git", "-c", "core.fsmonitor=false", "--no-optional-locks")
_logger = logging.getLogger(__name__)


def commit_of(path: Path) -> SourceCommit | None:
    """Returns the Git commit of the folder that a file is in.

    Args:
        path: Path of the file, or a folder.

    Returns:
        The commit, and whether tracked files differ from it; None if there is no repository, no commit yet, or no
        `git` on this machine.
    """
    folder = path.absolute() if path.is_dir() else path.absolute().parent
    if not any((parent / ".git").exists() for parent in (folder, *folder.parents)):
        return None
    try:
        commit = _ask(folder, "rev-parse", "HEAD").strip()
        changed = bool(_ask(folder, "status", "--porcelain", "--untracked-files=no").strip())
    except (OSError, subprocess.SubprocessError) as problem:
        _logger.info("the commit of %s is not known: %s", folder, problem)
        return None
    return SourceCommit(commit=commit, changed=changed)


def _ask(folder: Path, *words: str) -> str:
    ended = subprocess.run(
        [*_GIT, *words],
        cwd=folder,
        capture_output=True,
        text=True,
        check=True,
        timeout=_LIMIT_S,
        stdin=subprocess.DEVNULL,
    )
    return ended.stdout
