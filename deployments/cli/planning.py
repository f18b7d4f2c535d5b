"""Plan of a specification before it runs: order of steps, numbers of worlds, jobs and trials, time limits."""

import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from ...schemas.runs.trials import planned_trials
from ...schemas.runs.variables import TIME_LIMIT_VARIABLE, number_in
from ...schemas.specs.references import ReferenceMistake, parse_template
from ...schemas.specs.resolving import written_cells
from ...schemas.specs.specification import (
    FOR_EACH,
    INDEX,
    CheckedSpec,
    CheckedStep,
    axes_of,
    for_each_of,
    made_list_of,
    variable_of,
)
from ...schemas.specs.step_axes import AXES
from ...schemas.specs.yaml_nodes import ListNode, MappingNode, Node, ScalarNode, child, node_at, plain
from ...schemas.wire.common import counted
from ...schemas.wire.errors import SpecError
from .output.answers import duration

if TYPE_CHECKING:
    from ...schemas.reports.comparison import AxisPairs, PlannedPairs
    from ...schemas.reports.forecast import Forecast
    from ...tasks.comparison.detection import PlannedTrials

_SOME_WORLD = "a world"
_VARIED = ("worlds", "variations")
_WORLD = ("simulationApplications", 0, "worldConfigs", 0, "world")
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
    """Number of worlds that a planned step makes, if the file says it."""

    jobs: int | None = None
    """Limit of simulation jobs that a planned step creates, if the file says it."""

    trials: int | None = None
    """Number of trials of all its jobs, if the file says it; a job without trials counts as one."""

    simulated_s: float | None = None
    """Simulated time that all trials together take at most, in seconds, if the file limits that of each."""

    concurrency: int | None = None
    job_limit_s: int | None = None
    """Longest `maxJobDurationInSeconds` of a planned step's jobs, if the file says it."""

    timeout_s: int | None = None
    """Value of `timeoutInSeconds` of a planned step's batch, if the file says it."""

    detail: str = ""
    """Text with these numbers."""


def planned(spec: CheckedSpec) -> list[PlannedStep]:
    """Returns the steps of a specification in the order they would run, as if every world that they make succeeded."""
    outputs: dict[str, dict[str, Any]] = {}
    steps = []
    for name in spec.order:
        step = _planned_step(spec.steps[name], outputs)
        # As if every world succeeded: enough to count what later steps make of them.
        worlds = [f"{_SOME_WORLD} {number} of {name}" for number in range(step.worlds or 0)]
        outputs[name] = {"finishedWorldsSummary": {"succeededWorlds": worlds}, "worlds": worlds} if worlds else {}
        steps.append(step)
    return steps


def jobs_of_axes(spec: CheckedSpec) -> int | None:
    """Counts the simulation jobs that axes of a specification's steps make; `None`: there are none, or a run tells."""
    of_axes = {
        name
        for name, step in spec.steps.items()
        if (requests := child(step.input, "createSimulationJobRequests")) and axes_of(requests)
    }
    jobs = [step.jobs for step in planned(spec) if step.step in of_axes] if of_axes else []
    known = [count for count in jobs if count is not None]
    return sum(known) if known and len(known) == len(jobs) else None


def planned_trials_of(spec: CheckedSpec, steps: Sequence[PlannedStep]) -> "PlannedTrials | None":
    """Counts the trials of one run of a specification, and the worlds they drive in; `None`: only a run can tell."""
    from ...tasks.comparison.detection import PlannedTrials

    drives = [step for step in steps if step.operation in DRIVES]
    if not drives or any(step.trials is None or step.jobs is None for step in drives):
        return None
    worlds = set[str]().union(*(_worlds(spec.steps[step.step], step.jobs or 0) for step in drives))
    return PlannedTrials(sum(step.trials or 0 for step in drives), len(worlds))


def pairs_of_axes(spec: CheckedSpec, steps: Sequence[PlannedStep]) -> "list[AxisPairs]":
    """Counts the pairs of each axis of a grid, and how many of them the comparison within a run takes at least.

    Axes that the world depends on are left out: they are not compared, or their pairs are of two worlds.
    """
    from ...schemas.reports.comparison import AxisPairs
    from ...tasks.comparison.arms import ALPHA
    from ...tasks.comparison.statistics.e_processes import fewest_worlds
    from ...tasks.comparison.statistics.mcnemar import fewest_pairs

    listed = [(step, *each) for step in steps if step.trials for each in _listed_axes(spec.steps[step.step])]
    least = fewest_pairs(ALPHA / max(1, sum(count - 1 for *_, count in listed)))  # by Holm's method
    found = []
    for step, axis, count in listed:
        pairs, worlds = (step.trials or 0) // count, len(_worlds(spec.steps[step.step], step.jobs or 0))
        of_worlds = pairs > worlds >= fewest_worlds(ALPHA)
        units = worlds if of_worlds else pairs
        found.append(AxisPairs(step=step.step, axis=axis, pairs=units, least=least, of_worlds=of_worlds))
    return found


def _listed_axes(step: CheckedStep) -> list[tuple[str, int]]:
    """Returns the axes of a step's whole grid with their numbers of values, without those that its world depends on."""
    requests = child(step.input, "createSimulationJobRequests")
    construct = axes_of(requests) if requests is not None else None
    axes = child(construct, AXES) if construct is not None else None
    if construct is None or not isinstance(axes, MappingNode) or {"include", "exclude"} & construct.entries.keys():
        return []
    if (design := child(construct, "design")) is not None and plain(design) != "grid":
        return []
    of_world = _names(_world(_written(construct)[0]))
    values = {name: child(node, "values") for name, node in axes.entries.items() if name not in of_world}
    return [
        (name, len(node.items)) for name, node in values.items() if isinstance(node, ListNode) and len(node.items) > 1
    ]


def with_time(needed: "PlannedPairs", forecast: "Forecast", planned: int) -> "PlannedPairs":
    """Adds the time and cost of one run with as many trials as are needed, by the forecast of one with those it has.

    Args:
        needed: The number of trials.
        forecast: The forecast from a probe's measurements.
        planned: Trials that the specification has now.
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
        detail = f"1 simulation job{_trials_each([step.input])}{_limit(limits)}"
        return PlannedStep(
            step.name,
            step.operation,
            needs,
            jobs=1,
            trials=_trials(step.input),
            simulated_s=_simulated_s([step.input]),
            job_limit_s=max(limits, default=None),
            detail=detail,
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
            trials=_trials_of_all(requests, jobs),
            simulated_s=_simulated_s(_written(requests), jobs if made_list_of(requests) is not None else 1),
            concurrency=concurrency,
            job_limit_s=max(limits, default=None),
            timeout_s=timeout_s,
            detail=f"{what}{_trials_each(_written(requests))}{together}{_limit(limits)}{all_of_it}",
        )
    return PlannedStep(step.name, step.operation, needs)


def _written(requests: Node) -> list[Node]:
    """Returns the requests for jobs that are written in a specification file."""
    construct = made_list_of(requests)
    return [construct.entries["value"]] if construct else list(requests.items) if isinstance(requests, ListNode) else []


def _trials(request: Node) -> int:
    """Returns the number of trials of a job's request; 1 without trials."""
    written = plain(request)
    return max(1, planned_trials(written)) if isinstance(written, Mapping) else 1


def _trials_of_all(requests: Node, jobs: int | None) -> int | None:
    """Returns the number of trials of all jobs of a batch; `None` if it is only known during the run."""
    written = _written(requests)
    if made_list_of(requests) is None:
        return sum(map(_trials, written)) or None
    return None if jobs is None else jobs * _trials(written[0])


def _trials_each(requests: Sequence[Node]) -> str:
    """Says how many trials each of some jobs has, as `, 16 trials each`; empty if all are a single episode."""
    counts = [_trials(request) for request in requests]
    if max(counts, default=1) == 1:
        return ""
    fewest = f"{min(counts)} to " if min(counts) < max(counts) else ""
    return f", {fewest}{counted(max(counts), 'trial')} each"


def _simulated_s(requests: Sequence[Node], jobs: int | None = 1) -> float | None:
    """Returns the simulated time that all trials of some requests take at most; `None` if a trial has no known limit.

    Args:
        requests: Requests as they are written.
        jobs: Jobs that each request makes.
    """
    limits_s = [_simulated_limit_s(request) for request in requests]
    if not limits_s or jobs is None or any(limit_s is None for limit_s in limits_s):
        return None
    return sum(jobs * _trials(request) * (limit_s or 0) for request, limit_s in zip(requests, limits_s, strict=True))


def _simulated_limit_s(request: Node) -> float | None:
    """Returns the simulated time, in seconds, at which `indoor-navigation` ends a trial, if the request says it."""
    written = plain(request)
    applications = written.get("simulationApplications") if isinstance(written, Mapping) else None
    if not isinstance(applications, list) or len(applications) != 1 or not isinstance(applications[0], Mapping):
        return None
    variables = (applications[0].get("launchConfig") or {}).get("environmentVariables")
    said = variables.get(TIME_LIMIT_VARIABLE) if isinstance(variables, Mapping) else None
    varied = (written.get("trials") or {}).get("axes") or {}
    if applications[0].get("application") != "indoor-navigation" or not isinstance(said, str):
        return None
    limit_s = number_in(said)
    return limit_s if math.isfinite(limit_s) and limit_s > 0 and TIME_LIMIT_VARIABLE not in varied else None


def sum_in_words(steps: Sequence[PlannedStep]) -> str:
    """Says how many jobs and trials all steps of a plan have: `in sum 16 simulation jobs × 4 trials = 64 trials`.

    Args:
        steps: The steps of a specification.

    Returns:
        Text, also with the simulated time that they take at most, where the file limits it; empty if no step runs
        jobs, or if only the run can tell how many.
    """
    driven = [step for step in steps if step.operation in DRIVES]
    if not driven or any(step.jobs is None or step.trials is None for step in driven):
        return ""
    jobs, trials = (sum(getattr(step, key) or 0 for step in driven) for key in ("jobs", "trials"))
    each = {(step.trials or 0) / (step.jobs or 1) for step in driven}
    per_job = each.pop() if len(each) == 1 else 0.0
    if trials == jobs:  # a job without trials counts as one, and is none
        amount = ""
    elif per_job.is_integer() and per_job > 1:
        amount = f" × {counted(int(per_job), 'trial')} = {counted(trials, 'trial')}"
    else:
        amount = f", {counted(trials, 'trial')}"
    limits_s = [step.simulated_s for step in driven]
    known_s = [limit_s for limit_s in limits_s if limit_s is not None]
    time = f", at most {duration(math.fsum(known_s))} of simulated time" if len(known_s) == len(driven) else ""
    return f"in sum {counted(jobs, 'simulation job')}{amount}{time}"


def _worlds(step: CheckedStep, jobs: int) -> set[str]:
    """Returns names for the different worlds that a step's jobs use, equal for steps with the same worlds.

    The names only tell worlds apart; they are those of no stored world.
    """
    requests = child(step.input, "createSimulationJobRequests") or ListNode(step.place, (step.input,))
    written = [_world(each) for each in _written(requests)]
    if (axes := axes_of(requests)) is not None:
        return _worlds_of_axes(axes, written[0], jobs)
    construct = for_each_of(requests)
    if construct is None or not _names(written[0]).intersection((variable_of(construct), INDEX)):
        return set(written)
    source = json.dumps(plain(construct.entries[FOR_EACH]))
    return {f"{source} {number}" for number in range(jobs)}


def _worlds_of_axes(construct: MappingNode, world: str, jobs: int) -> set[str]:
    """Names for the worlds of axes: one for each value of the first axis on which the world depends."""
    axes = child(construct, AXES)
    named = _names(world)
    values = (
        [child(axes.entries[name], "values") for name in axes.entries if name in named]
        if isinstance(axes, MappingNode)
        else []
    )
    if not values or values[0] is None:
        return {f"{world} {number}" for number in range(jobs)} if values else {world}
    if isinstance(values[0], ListNode):
        return {str(plain(each)) for each in values[0].items}
    return {f"{plain(values[0])} {number}" for number in range(jobs)}


def _world(request: Node) -> str:
    """Returns the world of a job's request, as written in the file; empty if there is none."""
    found: Node | None = request
    for key in _WORLD:
        found = child(found, key) if found is not None else None
    return str(plain(found)) if found is not None else ""


def _names(text: str) -> set[str]:
    return {name for reference in parse_template(text).references for name in reference.names()}


def _size(requests: Node, outputs: dict[str, dict[str, Any]]) -> tuple[int | None, str]:
    """Returns the number of jobs, or `None` if it cannot be computed before the run, and a text that says it."""
    if (axes := axes_of(requests)) is not None:
        return _size_of_axes(axes, outputs)
    construct = for_each_of(requests)
    entries = _entries(construct.entries[FOR_EACH] if construct else requests, outputs)
    if entries is None:
        return None, f"a simulation job for each of {plain(construct.entries[FOR_EACH] if construct else requests)}"
    each = ", one for each world" if entries and all(str(entry).startswith(_SOME_WORLD) for entry in entries) else ""
    return len(entries), counted(len(entries), "simulation job") + each


def _size_of_axes(construct: MappingNode, outputs: dict[str, dict[str, Any]]) -> tuple[int | None, str]:
    """Returns the number of jobs of axes and a text: `12 simulation jobs: 6 cells of robot × world, 2 seeds each`.

    The number is `None` if it is not known before the run.
    """
    axes = child(construct, AXES)
    names = " × ".join(axes.entries) if isinstance(axes, MappingNode) else ""
    try:
        cells = written_cells(construct, outputs)
    except SpecError:
        return None, f"a simulation job for each cell of {names}"
    jobs = cells.count * cells.seeds
    if not names:
        return jobs, f"{counted(jobs, 'simulation job')}, one for each seed"
    seeds = f", {counted(cells.seeds, 'seed')} each" if cells.seeds > 1 else ""
    return jobs, f"{counted(jobs, 'simulation job')}: {counted(cells.count, 'cell')} of {names}{seeds}"


def _entries(node: Node, outputs: dict[str, dict[str, Any]]) -> list[Any] | None:
    """Returns the entries of a list in the file; `None` if they are only known during the run."""
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
    """Returns the time limits of jobs, in seconds, that are written as numbers in the file."""
    found = (_number(request, "maxJobDurationInSeconds") for request in requests)
    return [seconds for seconds in found if seconds is not None]


def _limit(limits_s: Sequence[int]) -> str:
    if not limits_s:
        return ""
    shortest = f"{duration(min(limits_s))} to " if min(limits_s) < max(limits_s) else ""
    return f", at most {shortest}{duration(max(limits_s))} each"


def after(step: PlannedStep) -> str:
    """Lists the steps that a specification's step depends on, as text; empty if there are none."""
    return f"after {', '.join(step.needs)}" if step.needs else ""


_GENERATES = "CreateWorldGenerationJob"
_REQUESTS = "createSimulationJobRequests"
_MOST_TRIES = 4


def ways_to_more(
    spec: CheckedSpec,
    planned_now: "PlannedTrials",
    needed: "PlannedPairs",
    answer: "Callable[[PlannedTrials], PlannedPairs]",
    most_worlds: int,
) -> list[str]:
    """Lists which numbers of a specification would give a run enough trials: `drive.seeds 84 instead of 2`.

    Each is changed alone, and the smallest value is named with which the question is answered. Numbers that make no
    difference, such as seeds where whole worlds decide, are left out.

    Args:
        spec: The specification.
        planned_now: Trials of one run, and their worlds.
        needed: The answer for these.
        answer: Answers the question for another number of trials and worlds.
        most_worlds: Worlds that a job may make; for more the setting is named.
    """
    found: list[str] = []
    if not needed.more:
        return found
    for step, location, now in _numbers(spec):
        value = _enough(spec, planned_now, needed, answer, (step, location, now))
        if value is not None:
            worlds = value * _worlds_each(spec, step, location)
            allowed = f" (with ROBOMAKER_MAX_WORLDS_PER_JOB={worlds})" if worlds > most_worlds else ""
            keys = [key for key in location if key in ("trials", *location[-1:])]
            found.append(f"{step}.{'.'.join(keys)} {value:,} instead of {now:,}{allowed}")
    return found


def _worlds_each(spec: CheckedSpec, step: str, location: tuple[str, ...]) -> int:
    """Returns the number of worlds that one more of a number makes: interiors of a floor plan; 0 of seeds."""
    if location[0] != "worldCount":
        return 0
    counts = node_at(spec.steps[step].input, ("worldCount",))
    return (_number(counts, _COUNTS[1]) if isinstance(counts, MappingNode) else None) or 1


def _enough(
    spec: CheckedSpec,
    planned_now: "PlannedTrials",
    needed: "PlannedPairs",
    answer: "Callable[[PlannedTrials], PlannedPairs]",
    number: tuple[str, tuple[str, ...], int],
) -> int | None:
    """Returns the value of a number of a specification that gives enough trials; `None` if no value found does."""
    step, location, now = number

    def counted_with(value: int) -> "PlannedTrials | None":
        changed = replace(spec.steps[step], input=_with_number(spec.steps[step].input, location, value))
        other = replace(spec, steps={**spec.steps, step: changed})
        return planned_trials_of(other, planned(other))

    one_more = counted_with(now + 1)
    if one_more is None:
        return None
    gained = (one_more.trials - planned_now.trials, one_more.worlds - planned_now.worlds)
    value, has = now, planned_now
    for _ in range(_MOST_TRIES):
        lacking = (needed.pairs - has.trials, (needed.worlds or 0) - has.worlds)
        steps = [
            math.ceil(lack / gain) if gain > 0 else None for lack, gain in zip(lacking, gained, strict=True) if lack > 0
        ]
        if not steps:
            return value
        if None in steps:
            return None
        value += max(each for each in steps if each is not None)
        if (more := counted_with(value)) is None:
            return None
        has, needed = more, answer(more)
    return None


def _numbers(spec: CheckedSpec) -> list[tuple[str, tuple[str, ...], int]]:
    """Returns the numbers that decide how many trials there are: step, place in its input, and value."""
    found: list[tuple[str, tuple[str, ...], int]] = []
    for name in spec.order:
        step = spec.steps[name]
        requests = child(step.input, _REQUESTS)
        if step.operation == _GENERATES:
            places: list[tuple[str, ...]] = [("worldCount", _COUNTS[0])]
        elif step.operation == "CreateSimulationJob":
            places = [("trials", "seeds")]
        elif requests is not None and made_list_of(requests) is not None:
            places = [(_REQUESTS, "value", "trials", "seeds")]
            places = [(_REQUESTS, "seeds"), *places] if axes_of(requests) is not None else places
        else:
            places = []
        for place in places:
            parent = node_at(step.input, place[:-1])
            if isinstance(parent, MappingNode):  # seeds are 1 where they are not written
                now = _number(parent, place[-1]) if place[-1] in parent.entries else 1
                found += [(name, place, now)] if now else []
    return found


def _with_number(node: Node, location: tuple[str, ...], value: int) -> Node:
    """Returns a node with another number at a location below it."""
    if not location:
        return ScalarNode(node.place, value, str(value))
    if not isinstance(node, MappingNode):
        return node
    below = _with_number(node.entries.get(location[0], node), location[1:], value)
    return replace(node, entries={**node.entries, location[0]: below})
