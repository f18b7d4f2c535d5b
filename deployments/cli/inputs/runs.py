"""Earlier runs of specifications, by their ids."""

import json
from pathlib import Path
from typing import TYPE_CHECKING

from ....schemas.wire.errors import ConfigurationError

if TYPE_CHECKING:
    from ....schemas.reports.run_record import RunRecord


def find_record(runs: Path, run: str) -> Path:
    """Finds the record of a run.

    Args:
        runs: folder of all runs.
        run: a run's id, its folder, or `latest`, which leaves the probes of forecasts out.

    Raises:
        ConfigurationError: there is no such run.
    """
    if "/" in run and (record := Path(run) / "run.json").is_file():
        return record
    records = sorted(runs.glob("*/run.json"), key=lambda path: path.stat().st_mtime)
    if not records:
        raise ConfigurationError(f"there are no runs in {runs} yet; `robomaker run SPEC` makes one")
    if run == "latest":
        return next((record for record in reversed(records) if not _is_probe(record)), records[-1])
    if found := [path for path in records if path.parent.name == run]:
        return found[0]
    latest = ", ".join(path.parent.name for path in reversed(records[-5:]))
    raise ConfigurationError(f"there is no run {run!r} in {runs}; the latest are {latest}")


def _is_probe(record: Path) -> bool:
    try:
        return bool(json.loads(record.read_bytes()).get("probe"))
    except ValueError:
        return False  # who reads it is told what is wrong with it


def read_record(runs: Path, run: str) -> "RunRecord":
    """Reads the record of a run; see `find_record`.

    Raises:
        ConfigurationError: there is no such run, or its record cannot be read.
    """
    record = find_record(runs, run)
    from ....tasks.inspection import run_records

    return run_records.read_record(record)
