"""Show the steps of a specification in the order they would run.

Runs nothing.
"""

import argparse
import json
import sys
from dataclasses import asdict

from ..arguments import add_output, add_spec


def declare(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments."""
    add_spec(parser)
    add_output(parser, "text", "json")


def execute(arguments: argparse.Namespace) -> int:
    """Prints the plan."""
    from ..inputs.specifications import read_spec
    from ..planning import after, counted, planned

    spec = read_spec(arguments.spec)
    steps = planned(spec)
    if arguments.output == "json":
        document = {"schema_version": 1, "name": spec.name, "steps": [asdict(step) for step in steps]}
        sys.stdout.write(json.dumps(document, indent=2) + "\n")
        return 0
    sys.stdout.write(f"{spec.name}: {counted(len(steps), 'step')}, one after the other\n\n")
    rows = [(str(number), step.step, step.operation, after(step)) for number, step in enumerate(steps, 1)]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for row, step in zip(rows, steps, strict=True):
        cells = "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True))
        sys.stdout.write(f"  {cells}  {step.detail}".rstrip() + "\n")
    sys.stdout.write(f"\nrobomaker run {arguments.spec}\n")
    return 0
