"""The plan of a specification before it runs: order of steps, amounts, limits."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from ...schemas.runs.trials import planned_trials
from ...schemas.specs.model import FOR_EACH, CheckedSpec, CheckedStep, for_each_of
from ...schemas.specs.references import ReferenceMistake, parse_template
from ...schemas.specs.text import ListNode, Node, ScalarNode, child, plain
from .output.answers import duration

if TYPE_CHECKING:
    from ...schemas.reports.comparison import PlannedPairs
    from ...schemas.reports.forecast import Forecast
    from ...tasks.comparison.detection import PlannedTrials

_WORLD = "a world"
_VARIED = ("worlds", "variations")
_WORLDS = "worldConfigs"
DRIVES = ("CreateSimulationJob", "StartSimulationJobBatch")
"""Operations that run simulation jobs."""
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

    trials: int | None = None
    """Trials of its jobs in all, where the file says it; a job without trials is one."""

    job_worlds: int | None = None
    """Different worlds that its jobs drive in, where the file says it; jobs without a world count as one."""

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


def planned_trials_of(steps: Sequence[PlannedStep]) -> "PlannedTrials | None":
    """Counts the trials of one run of a specification, and the worlds they drive in; `None`: only a run can tell."""
    from ...tasks.comparison.detection import PlannedTrials

    drives = [step for step in steps if step.operation in DRIVES]
    if not drives or any(step.trials is None or step.job_worlds is None for step in drives):
        return None
    # Steps that follow each other mostly drive in the same worlds.
    return PlannedTrials(sum(step.trials or 0 for step in drives), max(step.job_worlds or 0 for step in drives))


def with_time(needed: "PlannedPairs", forecast: "Forecast", planned: int) -> "PlannedPairs":
    """Adds the time and cost of one run with as many trials as are needed, by the forecast of one with those it has.

    Args:
        needed: the number of trials.
        forecast: what a probe measured.
        planned: trials that the specification has now.
    """
    more = needed.pairs / planned - 1
    driven = [step for step in forecast.steps if step.operation in DRIVES]
    wall_time_s = forecast.wall_time_s + more * sum(max(0.0, step.wall_time_s - step.start_s) for step in driven)
    cost = None if forecast.cost is None else forecast.cost * wall_time_s / max(forecast.wall_time_s, 1e-9)
    return needed.model_copy(update={"wall_time_s": wall_time_s, "cost": cost})


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
            step.name,
            step.operation,
            needs,
            jobs=1,
            trials=_trials(step.input),
            job_worlds=1,
            job_limit_s=max(limits, default=None),
            detail=detail,
        )
    if step.operation == "StartSimulationJobBatch" and (requests := child(step.input, "createSimulationJobRequests")):
        jobs, what = _size(requests, outputs)
        trials, job_worlds = _trials_and_worlds(requests, jobs)
        concurrency = _number(step.input, "batchPolicy", "maxConcurrency")
        together = f", {concurrency} at a time" if concurrency else ""
        limits, timeout_s = _limits(_written(requests)), _number(step.input, "batchPolicy", "timeoutInSeconds")
        all_of_it = f", at most {duration(timeout_s)} for all" if timeout_s else ""
        return PlannedStep(
            step.name,
            step.operation,
            needs,
            jobs=jobs,
            trials=trials,
            job_worlds=job_worlds,
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


def _trials(request: Node) -> int:
    """Trials of a request; one without trials is one."""
    written = plain(request)
    return max(1, planned_trials(written)) if isinstance(written, Mapping) else 1


def _trials_and_worlds(requests: Node, jobs: int | None) -> tuple[int | None, int | None]:
    """Trials of all jobs of a batch, and the different worlds they drive in; `None` where only a run can tell."""
    written = _written(requests)
    if for_each_of(requests) is None:
        worlds = {json.dumps(plain(node) if node else None) for node in (child(each, _WORLDS) for each in written)}
        return (sum(map(_trials, written)), len(worlds)) if written else (None, None)
    if jobs is None:
        return None, None
    of_each = child(written[0], _WORLDS)
    return jobs * _trials(written[0]), jobs if of_each and "${{" in json.dumps(plain(of_each)) else 1


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
