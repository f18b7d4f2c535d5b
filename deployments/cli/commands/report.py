"""`robomaker report`: writes the report of an earlier run again and says where it is, or what it says."""

import argparse
import os
import sys
from pathlib import Path

from ....schemas.settings import Settings
from ....schemas.wire.errors import ConfigurationError
from ..output.browser import open_file


def execute(arguments: argparse.Namespace) -> int:
    """Prints the report's path, or its numbers."""
    junit = _checked(arguments.junit)
    settings = Settings.from_environment(os.environ)
    record_file = find_record(settings.home / "runs", arguments.run)

    from pydantic import ValidationError

    from ....schemas.reports.run_record import RunRecord

    try:
        record = RunRecord.model_validate_json(record_file.read_bytes())
    except ValidationError as error:
        raise ConfigurationError(f"{record_file} is not a run's record: {error.errors()[0]['msg']}") from error

    from ....tasks.inspection.reports import rebuild_report
    from ....tasks.service.service import Service

    summary = rebuild_report(record, Service.open(settings), junit)
    if arguments.output == "json":
        sys.stdout.write(summary.model_dump_json(indent=2, exclude_none=True) + "\n")
    else:
        sys.stdout.write(f"{summary.report_path}\n")
    if arguments.open and summary.report_path:
        open_file(summary.report_path)
    return 0


def _checked(junit: str | None) -> Path | None:
    """Where the JUnit file goes.

    Raises:
      ConfigurationError: it is a folder, or in one that does not exist.
    """
    if junit is None:
        return None
    path = Path(junit).absolute()
    if path.is_dir() or not path.parent.is_dir():
        raise ConfigurationError(f"--junit is {junit}; it has to be a file in a folder that exists")
    return path


def find_record(runs: Path, run: str) -> Path:
    """Finds the record of a run.

    Args:
      runs: folder of all runs.
      run: a run's id, or `latest`.

    Raises:
      ConfigurationError: there is no such run.
    """
    records = sorted(runs.glob("*/run.json"), key=lambda path: path.stat().st_mtime)
    if not records:
        raise ConfigurationError(f"there are no runs in {runs} yet; `robomaker run SPEC` makes one")
    if run == "latest":
        return records[-1]
    if found := [path for path in records if path.parent.name == run]:
        return found[0]
    latest = ", ".join(path.parent.name for path in reversed(records[-5:]))
    raise ConfigurationError(f"there is no run {run!r} in {runs}; the latest are {latest}")
