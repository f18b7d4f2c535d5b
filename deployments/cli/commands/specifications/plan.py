"""Show the steps of a specification in the order they would run.

Runs nothing. With `--reuse` it says of each world and each simulation job whether `robomaker run --reuse` would take
it over from an earlier run, and if not, why: what is new, or which input has changed.
"""

import argparse
import json
import os
import sys
from dataclasses import asdict
from typing import TYPE_CHECKING

from ...arguments import add_output, add_spec

if TYPE_CHECKING:
    from .....schemas.specs.model import CheckedSpec
    from .....tasks.inspection.reuse_plans import PlannedPart


def declare(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments."""
    add_spec(parser)
    parser.add_argument("--reuse", action="store_true", help="say what a run with --reuse would run, and why")
    add_output(parser, "text", "json")


def execute(arguments: argparse.Namespace) -> int:
    """Prints the plan."""
    from ...inputs.specifications import read_spec
    from ...output.reuse import reuse_lines, reuse_total
    from ...planning import after, counted, planned

    spec = read_spec(arguments.spec)
    steps = planned(spec)
    parts = _reuse(spec) if arguments.reuse else {}
    if arguments.output == "json":
        each = [asdict(step) | _reuse_as_json(parts.get(step.step)) for step in steps]
        document = {"schema_version": 1, "name": spec.name, "steps": each}
        sys.stdout.write(json.dumps(document, indent=2) + "\n")
        return 0
    sys.stdout.write(f"{spec.name}: {counted(len(steps), 'step')}, one after the other\n\n")
    rows = [(str(number), step.step, step.operation, after(step)) for number, step in enumerate(steps, 1)]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for row, step in zip(rows, steps, strict=True):
        cells = "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True))
        sys.stdout.write(f"  {cells}  {step.detail}".rstrip() + "\n")
        sys.stdout.writelines(f"       {line}\n" for line in reuse_lines(parts.get(step.step, [])))
    if arguments.reuse:
        sys.stdout.write(f"\n{reuse_total(parts)}\n")
    sys.stdout.write(f"\nrobomaker run {arguments.spec}{' --reuse' if arguments.reuse else ''}\n")
    return 0


def _reuse(spec: "CheckedSpec") -> "dict[str, list[PlannedPart]]":
    """What a run would take over, by step."""
    from .....schemas.settings import Settings
    from .....tasks.inspection.reuse_plans import plan_reuse
    from .....tasks.service.service import Service

    return plan_reuse(spec, Service.open(Settings.from_environment(os.environ)))


def _reuse_as_json(parts: "list[PlannedPart] | None") -> dict[str, object]:
    return {} if parts is None else {"parts": [asdict(part) for part in parts]}
