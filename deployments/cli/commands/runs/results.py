"""Write the table of a run's results to a file: a row for each trial, and for each job without trials.

Rows of jobs that broke, were canceled or never came of their requests are there, too; the column `outcome` says so.
"""

import argparse
import os
import sys
from typing import TYPE_CHECKING

from .....schemas.wire.errors import ConfigurationError
from ...inputs.options import find_run, output_file

if TYPE_CHECKING:
    import pyarrow as pa


def declare(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments of `robomaker results` to its parser."""
    text = "id or folder of a run, its specification's name for the newest, or latest (the default); it may still run"
    parser.add_argument("run", metavar="RUN", nargs="?", default="latest", help=text)
    parser.add_argument("--to", metavar="FILE", help="put it there: FILE.parquet or FILE.csv; else CSV is printed")


def execute(arguments: argparse.Namespace) -> int:
    """Runs `robomaker results`: writes the table of a run's results; how the run stands goes to standard error.

    The table goes to the file of `--to`, whose path is printed, or else as CSV to standard output. Raises
    ConfigurationError if the file cannot be written.
    """
    from .....schemas.settings import Settings
    from .....tasks.results.exports import check_extension, export_table

    path = output_file(arguments.to, "--to")
    if path is not None:
        check_extension(path, "--to")
    settings = Settings.from_environment(os.environ)
    folder = find_run(settings.home / "runs", arguments.run)

    from .....tasks.nights.run_standings import stand_of, table_of
    from .....tasks.service.service import Service

    with Service.opened(settings) as service:
        run = stand_of(folder, service)
        table = table_of(run, service).to_arrow()
    if path is None:
        _print_csv(table)
    else:
        try:
            export_table(table, path)
        except OSError as error:
            why = os.strerror(error.errno).lower() if error.errno else str(error)
            raise ConfigurationError(
                f"--to is {path}, which cannot be written: {why}; a file in a folder where you may write would be right"
            ) from error
        sys.stdout.write(f"{path}\n")
    rows = f"{table.num_rows} {'row' if table.num_rows == 1 else 'rows'}"
    sys.stderr.write(f"{run.run_id}: {run.in_words()}; {rows}\n")
    return 0


def _print_csv(table: "pa.Table") -> None:
    import pyarrow as pa
    from pyarrow import csv

    text = pa.BufferOutputStream()
    csv.write_csv(table, text)
    sys.stdout.write(text.getvalue().to_pybytes().decode())
