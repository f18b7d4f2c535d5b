"""The records of runs in their folders: reading one, and finding the runs of a specification."""

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

from pydantic import ValidationError

from ...schemas.reports.changes import SinceLastRun
from ...schemas.reports.run_record import RunRecord
from ...schemas.wire.errors import ConfigurationError
from ..comparison.history import since_last_run
from ..comparison.nights import NightRun

RECORD_NAME = "run.json"
MOST_NIGHTS = 100
"""How many runs a history looks at, and a report for since when a job fails."""


@dataclass(frozen=True)
class FoundRecords:
    """Runs of a specification."""

    records: list[RunRecord]
    """The latest of them, the oldest first."""
    left_out: int
    """How many older folders of runs were not read."""
    unreadable: list[str]
    """What is wrong with records that cannot be read."""


def read_record(path: Path) -> RunRecord:
    """Reads the record of a run.

    Raises:
        ConfigurationError: it is no record, or one of a newer version.
    """
    try:
        return RunRecord.model_validate_json(path.read_bytes())
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(map(str, first["loc"]))
        raise ConfigurationError(f"{path} is not a run's record: {place}: {first['msg']}") from error


def write_record(record: RunRecord) -> None:
    """Writes the record of a run into its folder; it appears there only when it is whole."""
    path = record.run_dir / RECORD_NAME
    part = path.with_name(f"{RECORD_NAME}.part")
    part.write_text(record.model_dump_json(indent=2, exclude_none=True))
    part.replace(path)


def find_records(runs: Path, name: str, most: int = MOST_NIGHTS, before: datetime | None = None) -> FoundRecords:
    """Finds the latest runs of a specification; reruns of some of its jobs are no nights of it.

    Args:
        runs: folder of all runs; their folders are named after their specifications.
        name: the specification's name.
        most: how many to take at most.
        before: only runs that began earlier; None: all.
    """
    records: list[RunRecord] = []
    unreadable: list[str] = []
    paths = _latest_first(runs, f"{name}-")
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
        if record.name == name and record.rerun_of is None and (before is None or record.started_at < before):
            records.append(record)
    return FoundRecords(sorted(records, key=lambda each: each.started_at), len(paths) - looked_at, unreadable)


def names_of_specifications(runs: Path) -> list[str]:
    """Names of the specifications that have runs, by the names of the runs' folders."""
    return sorted({path.parent.name.rpartition("-")[0] for path in _latest_first(runs, "")} - {""})


def since_last(run: NightRun, runs: Path) -> SinceLastRun:
    """What changed in a run since the last one of its specification, by the records of those that began before it."""
    earlier = find_records(runs, run.name, before=run.started_at).records
    return since_last_run([*map(NightRun.of, earlier), run])


def _latest_first(runs: Path, prefix: str) -> Sequence[Path]:
    return [path for _, path in sorted(_dated(runs, prefix), reverse=True)]


def _dated(runs: Path, prefix: str) -> Iterator[tuple[float, Path]]:
    try:
        folders = [entry.path for entry in os.scandir(runs) if entry.name.startswith(prefix)]
    except FileNotFoundError:
        return
    for folder in folders:
        path = Path(folder, RECORD_NAME)
        try:
            yield path.stat().st_mtime, path
        except OSError:
            continue  # the run goes on, or is no run
