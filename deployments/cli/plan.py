"""`robomaker plan`: what would run, in which order, and how much of it."""

import argparse
import json
import sys
from dataclasses import asdict, dataclass
from typing import Any

from ...schemas.references import parse_template
from ...schemas.spec import FOR_EACH, CheckedSpec, CheckedStep, for_each_of
from ...schemas.spec_text import ListNode, Node, ScalarNode, child, plain
from .specs import read_spec

_SUCCEEDED_WORLDS = "finishedWorldsSummary.succeededWorlds"


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


def execute(arguments: argparse.Namespace) -> int:
    """Prints the plan."""
    spec = read_spec(arguments.spec)
    steps = planned(spec)
    if arguments.output == "json":
        document = {"schema_version": 1, "name": spec.name, "steps": [asdict(step) for step in steps]}
        sys.stdout.write(json.dumps(document, indent=2) + "\n")
        return 0
    count = f"{len(steps)} step{'s' if len(steps) != 1 else ''}"
    sys.stdout.write(f"{spec.name}: {count}, one after the other\n\n")
    rows = [(str(number), step.step, step.operation, _after(step)) for number, step in enumerate(steps, 1)]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for row, step in zip(rows, steps, strict=True):
        cells = "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True))
        sys.stdout.write(f"  {cells}  {step.detail}".rstrip() + "\n")
    sys.stdout.write(f"\nrobomaker run {arguments.spec}\n")
    return 0


def planned(spec: CheckedSpec) -> list[PlannedStep]:
    """The steps in the order they would run."""
    worlds: dict[str, int] = {}
    steps = []
    for name in spec.order:
        step = _planned_step(spec.steps[name], worlds)
        if step.worlds is not None:
            worlds[name] = step.worlds
        steps.append(step)
    return steps


def _planned_step(step: CheckedStep, worlds: dict[str, int]) -> PlannedStep:
    needs = list(step.needs)
    if step.operation == "CreateWorldGenerationJob":
        plans, interiors = (_number(step.input, "worldCount", key) for key in _COUNTS)
        if plans and interiors:
            detail = f"{_counted(plans * interiors, 'world')}: {_counted(plans, 'floor plan')}, {interiors} × furnished"
            return PlannedStep(step.name, step.operation, needs, worlds=plans * interiors, detail=detail)
    if step.operation == "CreateSimulationJob":
        return PlannedStep(step.name, step.operation, needs, jobs=1, detail=f"1 simulation job{_limit(step.input)}")
    if step.operation == "StartSimulationJobBatch":
        return _planned_batch(step, worlds)
    return PlannedStep(step.name, step.operation, needs)


_COUNTS = ("floorplanCount", "interiorCountPerFloorplan")


def _planned_batch(step: CheckedStep, worlds: dict[str, int]) -> PlannedStep:
    requests = (
        step.input.entries.get("createSimulationJobRequests")
        if not isinstance(step.input, ScalarNode | ListNode)
        else None
    )
    concurrency = _number(step.input, "batchPolicy", "maxConcurrency")
    jobs, what = (None, "simulation jobs") if requests is None else _size(requests, worlds)
    together = f", {concurrency} at a time" if concurrency else ""
    limit = ""
    if requests is not None:
        construct = for_each_of(requests)
        first = construct.entries["value"] if construct else child(requests, 0)
        limit = _limit(first) if first is not None else ""
    return PlannedStep(
        step.name, step.operation, list(step.needs), jobs=jobs, concurrency=concurrency, detail=what + together + limit
    )


def _size(requests: Node, worlds: dict[str, int]) -> tuple[int | None, str]:
    """How many jobs, as a number where it can be told, and in words."""
    construct = for_each_of(requests)
    if construct is None:
        count = len(requests.items) if isinstance(requests, ListNode) else None
        return count, _counted(count, "simulation job") if count else "simulation jobs"
    source = construct.entries[FOR_EACH]
    if isinstance(source, ListNode):
        return len(source.items), _counted(len(source.items), "simulation job")
    text = str(plain(source))
    reference = parse_template(text).whole
    for name, count in worlds.items():
        if reference and reference.expression == f"{name}.{_SUCCEEDED_WORLDS}":
            return count, f"{_counted(count, 'simulation job')}, one for each world"
    return None, f"a simulation job for each of {text}"


def _number(node: Node, *keys: str) -> int | None:
    found: Node | None = node
    for key in keys:
        found = child(found, key) if found is not None else None
    value: Any = found.value if isinstance(found, ScalarNode) else None
    return value if type(value) is int else None


def _limit(request: Node) -> str:
    seconds = _number(request, "maxJobDurationInSeconds")
    if seconds is None:
        return ""
    return f", at most {seconds / 60:g} min each" if seconds >= 120 else f", at most {seconds} s each"


def _counted(count: int, noun: str) -> str:
    return f"{count} {noun}{'s' if count != 1 else ''}"


def _after(step: PlannedStep) -> str:
    return f"after {', '.join(step.needs)}" if step.needs else ""
