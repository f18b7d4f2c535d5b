"""Requests of a probe: a specification's requests reduced to a few worlds, jobs and trials, with the same seeds.

`jobs_in` returns the numbers of jobs and trials of the whole request.
"""

import hashlib
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

from ..operations.simulation_jobs import SimulationJobRequest
from ..runs.trials import TRIALS_VARIABLE, Trials, trials_of
from ..wire.errors import Problem, SpecError
from ..wire.json_values import is_list, is_mapping, is_object
from ..wire.operation_shape import READS
from ..wire.request_problems import path_text
from .specification import CheckedSpec

GENERATION = "CreateWorldGenerationJob"
EXPORT = "CreateWorldExportJob"
JOB = "CreateSimulationJob"
BATCH = "StartSimulationJobBatch"
_REQUESTS = "createSimulationJobRequests"
_MAKES = frozenset(
    (
        *(GENERATION, EXPORT, JOB, BATCH, "CreateWorldTemplate"),
        *("CreateRobotApplication", "CreateRobotApplicationVersion"),
        *("CreateSimulationApplication", "CreateSimulationApplicationVersion"),
    )
)
_APPLICATIONS = ("simulationApplications", "robotApplications")

_Item = TypeVar("_Item")


@dataclass(frozen=True)
class ProbeSize:
    """Limits of a probe, a small trial run of a specification: worlds, jobs and trials."""

    worlds: int
    """Maximum number of worlds of each generation job."""
    jobs: int
    """Maximum number of jobs of each batch."""
    trials: int
    """Maximum number of trials of each job."""


@dataclass(frozen=True)
class JobAmount:
    """Amount of work in one simulation job: its trials and its time limit in seconds."""

    trials: int
    """Number of trials; 1 for a job without trials."""
    limit_s: float
    """Time limit in seconds (`maxJobDurationInSeconds`)."""
    kind: str = ""
    """Key of jobs that take equally long; see `kind_of`."""


def check_probed(spec: CheckedSpec, what: str = "a probe") -> None:
    """Raises an error if a specification has steps that change existing resources, which a probe must not do.

    Args:
        spec: The specification.
        what: Words for the command that would change existing resources.

    Raises:
        SpecError: A step is of an operation that a probe must not call.
    """
    problems = [
        Problem(
            step.place,
            path_text(step.location),
            f"{step.operation} changes what is there already, which {what} would do as well; {what} runs steps that "
            "read, and that make applications, templates, worlds and simulation jobs",
        )
        for step in spec.steps.values()
        if step.operation not in _MAKES and not step.operation.startswith(READS)
    ]
    if problems:
        raise SpecError(problems)


def worlds_in(request: Mapping[str, Any]) -> int:
    """Returns the number of worlds that a world generation request makes."""
    return math.prod(_world_count(request))


def jobs_in(operation: str, request: Mapping[str, Any]) -> list[JobAmount]:
    """Returns the amount of work of each simulation job that a request makes, in order; empty for other operations."""
    return [
        JobAmount(trials.count if (trials := _trials(job)) else 1, float(job["maxJobDurationInSeconds"]), kind_of(job))
        for job in _jobs(operation, request)
    ]


def kind_of(job: Mapping[str, Any]) -> str:
    """Returns a key that is equal for jobs which probably take equally long: limit, applications and launch.

    World, seed, trials and tags have no effect on it.

    Args:
        job: Request of the job, or its stored members.
    """
    wire = _checked(job).to_wire()
    applications = [
        {name: value for name, value in without_trials(each).items() if name != "worldConfigs"}
        for role in _APPLICATIONS
        for each in wire.get(role) or ()
    ]
    told = json.dumps([wire["maxJobDurationInSeconds"], applications], sort_keys=True)
    return hashlib.sha256(told.encode()).hexdigest()[:16]


def cut(operation: str, request: Mapping[str, Any], size: ProbeSize) -> dict[str, Any]:
    """Reduces a request to the size of a probe: fewer worlds, jobs and trials.

    Args:
        operation: Operation of the step.
        request: Request of the step, with references resolved.
        size: Maximum size of the result.

    Returns:
        The request of the probe, without a token: the whole request may use that later.
    """
    members = {name: value for name, value in request.items() if name != "clientRequestToken"}
    if operation == GENERATION:
        return {**members, "worldCount": _cut_worlds(request, size.worlds)}
    if operation == JOB:
        return _cut_job(members, size.trials)
    if operation == BATCH:
        jobs = _jobs(operation, request)
        chosen = of_each_kind([kind_of(job) for job in jobs], size.jobs)
        return {**members, _REQUESTS: [_cut_job(jobs[index], size.trials) for index in chosen]}
    return members


def spread(items: Sequence[_Item], most: int) -> list[_Item]:
    """Picks at most `most` items of a list at equal distances, because neighbours are often alike."""
    if len(items) <= most:
        return list(items)
    return [items[index * len(items) // most] for index in range(most)]


def of_each_kind(kinds: Sequence[str], most: int) -> list[int]:
    """Picks at most `most` jobs, by index: one of each kind if possible, the others from all over the list.

    Args:
        kinds: Kind of each job.
        most: Maximum number of jobs.
    """
    firsts = spread([kinds.index(kind) for kind in dict.fromkeys(kinds)], most)
    others = [index for index in spread(range(len(kinds)), most) if index not in firsts]
    return sorted([*firsts, *others[: most - len(firsts)]])


def _cut_worlds(request: Mapping[str, Any], most: int) -> dict[str, int]:
    """Reduces a world count, if possible with the same number of interiors per floor plan, on which seeds depend."""
    floorplans, interiors = _world_count(request)
    interiors = min(interiors, most)
    floorplans = min(floorplans, max(1, most // interiors))
    return {"floorplanCount": floorplans, "interiorCountPerFloorplan": interiors}


def _world_count(request: Mapping[str, Any]) -> tuple[int, int]:
    """Returns the numbers of floor plans and of interiors per floor plan."""
    count = request.get("worldCount")
    members = count if is_object(count) else {}
    return members.get("floorplanCount") or 1, members.get("interiorCountPerFloorplan") or 1


def _jobs(operation: str, request: Mapping[str, Any]) -> list[dict[str, Any]]:
    if operation == JOB:
        return [dict(request)]
    requests = request.get(_REQUESTS) if operation == BATCH else None
    return list(requests) if is_list(requests) else []


def _checked(job: Mapping[str, Any]) -> SimulationJobRequest:
    members = {name: value for name, value in job.items() if name in SimulationJobRequest.model_fields}
    return SimulationJobRequest.model_validate(members)


def _trials(job: Mapping[str, Any]) -> Trials | None:
    return trials_of(_checked(job))


def _cut_job(job: Mapping[str, Any], most: int) -> dict[str, Any]:
    trials = _trials(job)
    if trials is None or trials.count <= most:
        return dict(job)
    applications = {role: [without_trials(each) for each in job[role]] for role in _APPLICATIONS if job.get(role)}
    return {**job, **applications, "trials": cut_trials(trials, most).to_wire()}


def cut_trials(trials: Trials, most: int) -> Trials:
    """Reduces trials to at most `most`: with too many cells, to the first cell of a grid, or to fewer points.

    The share of recorded trials stays the same.
    """
    fewer: dict[str, Any] = {}
    cells = trials.cells
    if cells > most:
        fewer, cells = {"include": None, "exclude": None}, 1
        if trials.points is None:
            fewer |= {"axes": trials.first_values}
        else:
            cells = min(most, trials.points)
            fewer |= {"points": cells}
    seeds = min(trials.seeds, max(1, most // cells))
    share = seeds * cells / trials.count
    recorded = range(math.ceil(len(trials.record or ()) * share))
    changes = {
        **fewer,
        "seeds": seeds,
        "record": list(recorded) or None,
        "record_failed": math.ceil(trials.record_failed * share),
    }
    wire = {name: value for name, value in {**trials.to_wire(), **changes}.items() if value is not None}
    return Trials.model_validate(wire)


def without_trials(application: Mapping[str, Any]) -> dict[str, Any]:
    """Returns an application's configuration without the launch variable that orders trials."""
    launch = application.get("launchConfig")
    variables = launch.get("environmentVariables") if is_mapping(launch) else None
    if not is_mapping(launch) or not is_mapping(variables):
        return dict(application)
    kept = {name: value for name, value in variables.items() if name != TRIALS_VARIABLE}
    others = {name: value for name, value in launch.items() if name != "environmentVariables"}
    return {**application, "launchConfig": {**others, **({"environmentVariables": kept} if kept else {})}}
