"""Show the steps of a specification in the order they would run.

Runs nothing.
"""

import argparse
import json
import sys
from dataclasses import asdict, dataclass
from typing import Any

from ....schemas.specs.model import FOR_EACH, CheckedSpec, CheckedStep, for_each_of
from ....schemas.specs.references import ReferenceMistake, parse_template
from ....schemas.specs.text import ListNode, Node, ScalarNode, child, plain
from ..arguments import add_output, add_spec
from ..inputs.specifications import read_spec
from ..output.durations import duration

_WORLD = "a world"
_COUNTS = ("floorplanCount", "interiorCountPerFloorplan")


@dataclass(frozen=True)
class PlannedStep:
    """One step, before it runs."""

    step: str
    operation: str
    needs: list[str]
    worlds: int | None = None
    """Worlds it makes, where the file says it."""

    jobs: int | None = None
    """Simulation jobs it makes at most, where the file says it."""

    concurrency: int | None = None
    detail: str = ""
    """The same in words."""


def declare(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments."""
    add_spec(parser)
    add_output(parser, "text", "json")


def execute(arguments: argparse.Namespace) -> int:
    """Prints the plan."""
    spec = read_spec(arguments.spec)
    steps = planned(spec)
    if arguments.output == "json":
        document = {"schema_version": 1, "name": spec.name, "steps": [asdict(step) for step in steps]}
        sys.stdout.write(json.dumps(document, indent=2) + "\n")
        return 0
    sys.stdout.write(f"{spec.name}: {_counted(len(steps), 'step')}, one after the other\n\n")
    rows = [(str(number), step.step, step.operation, _after(step)) for number, step in enumerate(steps, 1)]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for row, step in zip(rows, steps, strict=True):
        cells = "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True))
        sys.stdout.write(f"  {cells}  {step.detail}".rstrip() + "\n")
    sys.stdout.write(f"\nrobomaker run {arguments.spec}\n")
    return 0


def planned(spec: CheckedSpec) -> list[PlannedStep]:
    """The steps in the order they would run."""
    outputs: dict[str, dict[str, Any]] = {}
    steps = []
    for name in spec.order:
        step = _planned_step(spec.steps[name], outputs)
        # As if every world succeeded: enough to count what later steps make of them.
        worlds = [_WORLD] * (step.worlds or 0)
        outputs[name] = {"finishedWorldsSummary": {"succeededWorlds": worlds}} if worlds else {}
        steps.append(step)
    return steps


def _planned_step(step: CheckedStep, outputs: dict[str, dict[str, Any]]) -> PlannedStep:
    needs = list(step.needs)
    if step.operation == "CreateWorldGenerationJob":
        plans, interiors = (_number(step.input, "worldCount", key) for key in _COUNTS)
        if plans and interiors:
            detail = f"{_counted(plans * interiors, 'world')}: {_counted(plans, 'floor plan')}, {interiors} × furnished"
            return PlannedStep(step.name, step.operation, needs, worlds=plans * interiors, detail=detail)
    if step.operation == "CreateSimulationJob":
        return PlannedStep(step.name, step.operation, needs, jobs=1, detail=f"1 simulation job{_limit(step.input)}")
    if step.operation == "StartSimulationJobBatch" and (requests := child(step.input, "createSimulationJobRequests")):
        jobs, what = _size(requests, outputs)
        concurrency = _number(step.input, "batchPolicy", "maxConcurrency")
        together = f", {concurrency} at a time" if concurrency else ""
        detail = what + together + _limit(_first(requests))
        return PlannedStep(step.name, step.operation, needs, jobs=jobs, concurrency=concurrency, detail=detail)
    return PlannedStep(step.name, step.operation, needs)


def _first(requests: Node) -> Node | None:
    construct = for_each_of(requests)
    return construct.entries["value"] if construct else child(requests, 0)


def _size(requests: Node, outputs: dict[str, dict[str, Any]]) -> tuple[int | None, str]:
    """How many jobs, as a number where it can be told, and in words."""
    construct = for_each_of(requests)
    entries = _entries(construct.entries[FOR_EACH] if construct else requests, outputs)
    if entries is None:
        return None, f"a simulation job for each of {plain(construct.entries[FOR_EACH] if construct else requests)}"
    each = ", one for each world" if entries and all(entry == _WORLD for entry in entries) else ""
    return len(entries), _counted(len(entries), "simulation job") + each


def _entries(node: Node, outputs: dict[str, dict[str, Any]]) -> list[Any] | None:
    """The entries of a list; `None` where only a run can tell."""
    if isinstance(node, ListNode):
        return list(node.items)
    try:
        found = parse_template(str(plain(node))).value(outputs)
    except ReferenceMistake:
        return None
    return found if isinstance(found, list) else None


def _number(node: Node, *keys: str) -> int | None:
    found: Node | None = node
    for key in keys:
        found = child(found, key) if found is not None else None
    value = found.value if isinstance(found, ScalarNode) else None
    return value if isinstance(value, int) else None


def _limit(request: Node | None) -> str:
    seconds = _number(request, "maxJobDurationInSeconds") if request is not None else None
    return "" if seconds is None else f", at most {duration(seconds)} each"


def _counted(count: int, noun: str) -> str:
    return f"{count} {noun}{'s' if count != 1 else ''}"


def _after(step: PlannedStep) -> str:
    return f"after {', '.join(step.needs)}" if step.needs else ""
