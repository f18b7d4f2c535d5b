"""Say what works on this machine and what is missing."""

import argparse
import os
import sys
from dataclasses import asdict
from typing import TYPE_CHECKING

from ...arguments import add_output
from ...output.answers import print_either

if TYPE_CHECKING:
    from ...doctor_checks import Finding


_MARKS: dict[str, tuple[str, str]] = {"ok": ("✓", "32"), "warning": ("!", "33"), "broken": ("✗", "31")}


def declare(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments of `robomaker doctor` to its parser."""
    parser.add_argument("--notify", action="store_true", help="send a test message to the channels of ROBOMAKER_NOTIFY")
    parser.add_argument(
        "--backend", metavar="B", help="also run one job on a backend, such as dask:tcp://10.0.0.7:8786 or local"
    )
    add_output(parser, "text", "json")


def execute(arguments: argparse.Namespace) -> int:
    """Runs `robomaker doctor`: checks the installation and prints what it found.

    Returns exit code 3 if something is broken, else 0, also with warnings. With `--notify` a test message is sent,
    and with `--backend` a small job is run by that backend.
    """
    from .....schemas.settings import Settings
    from ...doctor_checks import examine

    chosen = {"ROBOMAKER_BACKEND": arguments.backend} if arguments.backend else {}
    settings = Settings.from_environment({**os.environ, **chosen})
    findings = examine(settings, notify=arguments.notify)
    if arguments.backend:
        from ...backend_check import check_backend

        findings.append(check_backend(settings))
    document = {"schema_version": 1, "findings": [asdict(finding) for finding in findings]}
    print_either(arguments.output, document, _lines(findings))
    return 3 if any(finding.health == "broken" for finding in findings) else 0


def _lines(findings: "list[Finding]") -> list[str]:
    colored = sys.stdout.isatty() and not os.environ.get("NO_COLOR")
    width = max(len(finding.subject) for finding in findings)
    lines = []
    for finding in findings:
        mark, color = _MARKS[finding.health]
        shown = f"\x1b[{color}m{mark}\x1b[0m" if colored else mark
        indent = "\n" + " " * (width + 4)
        lines.append(f"{shown} {finding.subject.ljust(width)}  {finding.found.replace(chr(10), indent)}")
        if finding.remedy:
            lines.append(f"  {' ' * width}  -> {finding.remedy}")
    broken = sum(finding.health == "broken" for finding in findings)
    warnings = sum(finding.health == "warning" for finding in findings)
    lines.append("")
    if broken:
        lines.append(f"{broken} of {len(findings)} checks found something broken.")
    else:
        lines.append("Everything needed works." + (f" {warnings} warning(s)." if warnings else ""))
    return lines
