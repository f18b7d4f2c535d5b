"""Check that what the catalog says is stored is in the object store, whole.

Outputs of jobs, bundles of worlds and archives of exports are compared with what was stored; also told are outputs that
are on this machine only, interrupted removals, and parts of uploads that never ended. Exit code 3 if problems are left.
Jobs may go on meanwhile. Nothing is changed without --mend, and nothing that may be the only copy is ever removed.
"""

import argparse
import os
import sys

from ...arguments import add_output


def declare(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments."""
    parser.add_argument(
        "--read-content", action="store_true", help="read every object and compare its SHA-256, not only its size"
    )
    parser.add_argument(
        "--mend",
        action="store_true",
        help="store outputs that are here only, finish removals, remove parts of uploads that began over a day ago",
    )
    add_output(parser, "text", "json")


def execute(arguments: argparse.Namespace) -> int:
    """Checks; exit code 3 if problems are left."""
    from .....schemas.settings import Settings
    from .....tasks.consistency.checking import check_consistency
    from .....tasks.service.service import Service
    from ...output.consistency import report_lines

    service = Service.open(Settings.from_environment(os.environ))
    try:
        report = check_consistency(service, read_content=arguments.read_content, mend=arguments.mend)
    finally:
        service.catalog.close()
    if arguments.output == "json":
        sys.stdout.write(report.model_dump_json(indent=2, exclude_none=True) + "\n")
    else:
        sys.stdout.write("\n".join(report_lines(report)) + "\n")
    return 3 if report.open_findings else 0
