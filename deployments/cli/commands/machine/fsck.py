"""Check that what the catalog says is stored is in the object store, whole.

Outputs of jobs, bundles of worlds and archives of exports are compared with what was stored; also told are outputs that
are on this machine only, interrupted removals, and parts of uploads that never ended. Exit code 3 if problems are left.
Jobs may go on meanwhile. Nothing is changed without --mend, and nothing that may be the only copy is ever removed.
"""

import argparse
from collections import Counter
from typing import TYPE_CHECKING

from ...arguments import add_output
from ...inputs.options import open_service
from ...output.answers import print_either

if TYPE_CHECKING:
    from .....schemas.reports.retention import ConsistencyReport, Finding


def declare(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments of `robomaker fsck` to its parser."""
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
    """Runs `robomaker fsck`: checks that catalog and object store agree, and with `--mend` repairs what it can.

    Prints what it found, and returns exit code 3 if problems are left.
    """
    from .....tasks.consistency.checking import check_consistency

    report = check_consistency(open_service(), read_content=arguments.read_content, mend=arguments.mend)
    print_either(arguments.output, report, _report_lines(report))
    return 3 if report.open_findings else 0


def _report_lines(report: "ConsistencyReport") -> list[str]:
    """Formats the consistency report as text lines."""
    from rich.filesize import decimal

    lines = [line for finding in report.findings for line in _lines(finding)]
    objects = f"{report.objects} {'object' if report.objects == 1 else 'objects'} of {report.resources}"
    resources = "resource" if report.resources == 1 else "resources"
    how = "content compared" if report.read_content else "sizes compared, content with --read-content"
    lines.append(f"Checked {objects} {resources}, {decimal(report.size_bytes)}; {how}.")
    lines.append(_conclusion(report))
    return lines


def _lines(finding: "Finding") -> list[str]:
    mark = "mended" if finding.mended else finding.problem.value
    lines = [f"{mark}: {finding.where}"]
    if finding.resource is not None:
        lines.append(f"  of {finding.resource.split(':', 5)[-1]}")
    if finding.detail:
        lines.append(f"  {finding.detail}")
    if finding.remedy and not finding.mended:
        lines.append(f"  {finding.remedy}")
    return lines


def _conclusion(report: "ConsistencyReport") -> str:
    from .....schemas.reports.retention import LOSSES

    left = report.open_findings
    mended = sum(finding.mended for finding in report.findings)
    done = f"Mended {mended}. " if mended else ""
    if not left:
        return f"{done}Catalog and object store agree."
    counts = Counter(finding.problem.value for finding in left)
    lost = sum(finding.problem in LOSSES for finding in left)
    words = ", ".join(f"{count} {problem}" for problem, count in counts.items())
    told = f"; {lost} of them only a backup or another run brings back" if lost else ""
    return f"{done}{len(left)} {'problem is' if len(left) == 1 else 'problems are'} left: {words}{told}."
