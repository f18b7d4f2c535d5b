"""Write the report of a run again and print its path."""

import argparse
import os
import sys

from .....schemas.wire.errors import ConfigurationError
from ...arguments import add_open, add_output
from ...inputs.options import output_file, read_record
from ...output.answers import open_file

_PRINTED = "-"
"""File of `--markdown` that stands for the standard output."""


def declare(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments of `robomaker report` to its parser."""
    text = "id of a run, its specification's name for the newest, or latest (the default)"
    parser.add_argument("run", metavar="RUN", nargs="?", help=text)
    parser.add_argument("--junit", metavar="FILE", help="write it as JUnit XML too, for CI systems")
    parser.add_argument(
        "--markdown",
        metavar="FILE",
        nargs="?",
        const=_PRINTED,
        help="write it as Markdown too, for comments on pull requests and CI summaries; without FILE, or with -, print "
        "it instead of the path",
    )
    add_output(parser, "text", "json")
    add_open(parser, "show it in a browser")


def execute(arguments: argparse.Namespace) -> int:
    """Runs `robomaker report`: writes a run's report anew and prints its path, its numbers (JSON) or its Markdown.

    JUnit XML and Markdown are written to files, too, if asked. Raises ConfigurationError if both Markdown and JSON
    would be printed.
    """
    from .....schemas.settings import Settings

    junit = output_file(arguments.junit, "--junit")
    is_printed = arguments.markdown == _PRINTED
    if is_printed and arguments.output == "json":
        raise ConfigurationError("--markdown without a file and -o json both print; name a file, or leave one out")
    if arguments.run is None and _looks_like_run(arguments.markdown or ""):
        raise ConfigurationError(
            f"--markdown is {arguments.markdown}; name the run before it, robomaker report {arguments.markdown} "
            f"--markdown, or a file with an extension, such as {arguments.markdown}.md"
        )
    markdown = None if is_printed else output_file(arguments.markdown, "--markdown")
    settings = Settings.from_environment(os.environ)
    record = read_record(settings.home / "runs", arguments.run or "latest")

    from .....tasks.inspection.reports import rebuild_report
    from .....tasks.service.service import Service

    summary = rebuild_report(record, Service.open(settings), junit=junit, markdown=markdown)
    if is_printed:
        from .....tasks.reporting import markdown_report

        sys.stdout.write(markdown_report(summary))
    elif arguments.output == "json":
        sys.stdout.write(summary.model_dump_json(indent=2, exclude_none=True) + "\n")
    else:
        from .....tasks.reporting.causes import why_in_lines
        from .....tasks.reporting.nights.changes import losses_in_words

        sys.stdout.write(f"{summary.report_path}\n")
        for line in why_in_lines(summary.why):
            sys.stderr.write(f"why: {line}\n")
        for line in losses_in_words(summary.since_last) if summary.since_last else ():
            sys.stderr.write(f"{line}\n")
    if arguments.open and summary.report_path:
        open_file(summary.report_path)
    return 0


def _looks_like_run(file: str) -> bool:
    """Returns whether a file is named like a run, as in `--markdown nightly`, which argparse takes for the file."""
    return file != _PRINTED and bool(file) and not set(file) & {"/", "."}
