"""Run a specification and report what came of it.

The exit code says how it ended; `robomaker --help` lists them.
"""

import argparse
import dataclasses
import os
import shutil
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from ....schemas.wire.errors import ConfigurationError
from ..arguments import add_open, add_output, add_spec
from ..output.browser import open_file, wanted

if TYPE_CHECKING:
    from ....schemas.reports.run_record import RunRecord
    from ....schemas.specs.model import CheckedSpec


def declare(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments."""
    add_spec(parser)
    parser.add_argument("--name", help="name of the run, in place of the specification's")
    parser.add_argument(
        "--seed", type=int, metavar="N", help="seed of worlds and simulations, in place of those in SPEC"
    )
    parser.add_argument("--report", metavar="PATH", help="put a copy of the report there")
    add_output(parser, "text", "json")
    add_open(parser, "show the report in a browser (by default only on a desktop's terminal)")


def execute(arguments: argparse.Namespace) -> int:
    """Runs the specification; the exit code says how it ended."""
    from ....schemas.settings import Settings
    from ..output.progress import watcher
    from ..output.summary import print_summary
    from ..prefect_server import use_server

    spec = _chosen(arguments)
    settings = Settings.from_environment(os.environ)
    if arguments.report:
        _check_folder(Path(arguments.report))
    api_url = use_server(settings)
    steps = [(name, spec.steps[name].operation) for name in spec.order]
    with watcher(steps, os.environ) as listener:
        from ....flows.pipelines import RunInterrupted, run_spec

        try:
            record = run_spec(spec, settings, listener, spec_path=arguments.spec, command=again(arguments))
        except RunInterrupted as interruption:
            interrupted, record = interruption, interruption.record
        else:
            interrupted = None
    record = _with_report(record, arguments.report)
    if arguments.output == "json":
        sys.stdout.write(record.model_dump_json(indent=2, exclude_none=True) + "\n")
    else:
        # Elsewhere the pages' address is not to be told from the API's.
        local = api_url.startswith("http://127.0.0.1:")
        print_summary(record, again(arguments), sys.stdout, server=api_url.removesuffix("/api") if local else "")
    if interrupted:
        raise interrupted
    if record.report_path and wanted(arguments.open):
        open_file(record.report_path)
    return record.exit_code


def again(arguments: argparse.Namespace) -> list[str]:
    """The command that does the same again."""
    command = ["robomaker", "run", arguments.spec]
    for option in ("name", "seed", "report"):
        if (value := getattr(arguments, option)) is not None:
            command += [f"--{option}", str(value)]
    return command


def _chosen(arguments: argparse.Namespace) -> "CheckedSpec":
    """The specification, with what the options put in place of its own values."""
    from ....schemas.specs.model import is_spec_name, with_seed
    from ..inputs.specifications import read_spec

    spec = read_spec(arguments.spec)
    if arguments.name is not None:
        if not is_spec_name(arguments.name):
            raise ConfigurationError(f"--name is {arguments.name!r}; letters, digits, - and _ would be right")
        spec = dataclasses.replace(spec, name=arguments.name)
    if arguments.seed is not None:
        if arguments.seed < 0:
            raise ConfigurationError(f"--seed is {arguments.seed}; it has to be a whole number from 0")
        spec = with_seed(spec, arguments.seed)
    return spec


def _check_folder(path: Path) -> None:
    """Finds out before a long run that the report cannot be put where it is wanted."""
    if path.is_dir() or not path.absolute().parent.is_dir():
        raise ConfigurationError(f"--report is {path}; it has to be a file in a folder that exists")


def _with_report(record: "RunRecord", wanted_path: str | None) -> "RunRecord":
    if wanted_path is None or record.report_path is None:
        return record
    path = Path(wanted_path).absolute()
    shutil.copyfile(record.report_path, path)
    return record.model_copy(update={"report_path": path})
