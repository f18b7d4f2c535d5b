"""The plan of a specification before it runs: order of steps, amounts, limits."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from ...schemas.specs.model import FOR_EACH, CheckedSpec, CheckedStep, for_each_of
from ...schemas.specs.references import ReferenceMistake, parse_template
from ...schemas.specs.text import ListNode, Node, ScalarNode, child, plain
from .output.answers import duration

_WORLD = "a world"
_VARIED = ("worlds", "variations")
_COUNTS = ("floorplanCount", "interiorCountPerFloorplan")


@dataclass(frozen=True)
class PlannedStep:
    """A step of a specification in the output of `robomaker plan`."""

    step: str
    operation: str
    needs: list[str]
    worlds: int | None = None
    """Worlds it makes, where the file says it."""

    jobs: int | None = None
    """Simulation jobs it makes at most, where the file says it."""

    concurrency: int | None = None
    job_limit_s: int | None = None
    """The longest `maxJobDurationInSeconds` of its jobs, where the file says it."""

    timeout_s: int | None = None
    """The batch's `timeoutInSeconds`, where the file says it."""

    detail: str = ""
    """The same in words."""


def planned(spec: CheckedSpec) -> list[PlannedStep]:
    """Returns the steps of a specification in the order they would run."""
    outputs: dict[str, dict[str, Any]] = {}
    steps = []
    for name in spec.order:
        step = _planned_step(spec.steps[name], outputs)
        # As if every world succeeded: enough to count what later steps make of them.
        worlds = [_WORLD] * (step.worlds or 0)
        outputs[name] = {"finishedWorldsSummary": {"succeededWorlds": worlds}, "worlds": worlds} if worlds else {}
        steps.append(step)
    return steps


def _planned_step(step: CheckedStep, outputs: dict[str, dict[str, Any]]) -> PlannedStep:
    needs = list(step.needs)
    if step.operation == "CreateWorldGenerationJob":
        plans, interiors = (_number(step.input, "worldCount", key) for key in _COUNTS)
        if plans and interiors:
            detail = f"{counted(plans * interiors, 'world')}: {counted(plans, 'floor plan')}, {interiors} × furnished"
            return PlannedStep(step.name, step.operation, needs, worlds=plans * interiors, detail=detail)
    if step.operation == "VaryWorlds":
        amounts = [_entries(node, outputs) for key in _VARIED if (node := child(step.input, key))]
        if len(amounts) == len(_VARIED) and all(amounts):
            worlds, variations = (len(each or ()) for each in amounts)
            made = worlds * variations
            detail = f"{counted(made, 'world')}: {counted(variations, 'variation')} of {counted(worlds, 'world')}"
            return PlannedStep(step.name, step.operation, needs, worlds=made, detail=detail)
    if step.operation == "CreateSimulationJob":
        limits = _limits([step.input])
        detail = f"1 simulation job{_limit(limits)}"
        return PlannedStep(
            step.name, step.operation, needs, jobs=1, job_limit_s=max(limits, default=None), detail=detail
        )
    if step.operation == "StartSimulationJobBatch" and (requests := child(step.input, "createSimulationJobRequests")):
        jobs, what = _size(requests, outputs)
        concurrency = _number(step.input, "batchPolicy", "maxConcurrency")
        together = f", {concurrency} at a time" if concurrency else ""
        limits, timeout_s = _limits(_written(requests)), _number(step.input, "batchPolicy", "timeoutInSeconds")
        all_of_it = f", at most {duration(timeout_s)} for all" if timeout_s else ""
        return PlannedStep(
            step.name,
            step.operation,
            needs,
            jobs=jobs,
            concurrency=concurrency,
            job_limit_s=max(limits, default=None),
            timeout_s=timeout_s,
            detail=f"{what}{together}{_limit(limits)}{all_of_it}",
        )
    return PlannedStep(step.name, step.operation, needs)


def _written(requests: Node) -> list[Node]:
    """The requests for jobs that the file has."""
    construct = for_each_of(requests)
    return [construct.entries["value"]] if construct else list(requests.items) if isinstance(requests, ListNode) else []


def _size(requests: Node, outputs: dict[str, dict[str, Any]]) -> tuple[int | None, str]:
    """How many jobs, as a number where it can be told, and in words."""
    construct = for_each_of(requests)
    entries = _entries(construct.entries[FOR_EACH] if construct else requests, outputs)
    if entries is None:
        return None, f"a simulation job for each of {plain(construct.entries[FOR_EACH] if construct else requests)}"
    each = ", one for each world" if entries and all(entry == _WORLD for entry in entries) else ""
    return len(entries), counted(len(entries), "simulation job") + each


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


def _limits(requests: Sequence[Node]) -> list[int]:
    """Limits of jobs in seconds, where they are written as numbers."""
    found = (_number(request, "maxJobDurationInSeconds") for request in requests)
    return [seconds for seconds in found if seconds is not None]


def _limit(limits_s: Sequence[int]) -> str:
    if not limits_s:
        return ""
    shortest = f"{duration(min(limits_s))} to " if min(limits_s) < max(limits_s) else ""
    return f", at most {shortest}{duration(max(limits_s))} each"


def counted(count: int, noun: str) -> str:
    """Formats a count with its noun: `1 world`, `3 worlds`."""
    return f"{count} {noun}{'s' if count != 1 else ''}"


def after(step: PlannedStep) -> str:
    """Lists the steps that a step depends on, as text; empty if there are none."""
    return f"after {', '.join(step.needs)}" if step.needs else ""
