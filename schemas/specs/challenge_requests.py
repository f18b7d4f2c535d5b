"""Requests of a challenge: some jobs of a specification, each once unchanged and once with each sabotage.

All jobs of a step are one batch, so that a job that cannot be sabotaged does not stop the others. Tags say which job
and sabotage each one is.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from ..operations.registry import seed_of
from ..operations.simulation_jobs import SimulationJobRequest
from ..runs.trials import trials_of
from ..wire.common import MAX_DURATION_S
from ..wire.errors import Place, Problem, SpecError
from ..wire.job_configs import LaunchConfig, is_program
from ..wire.json_values import is_list, is_mapping
from ..wire.request_problems import path_text
from .probe_requests import BATCH, GENERATION, JOB, ProbeSize, check_probed, cut, kind_of, of_each_kind, without_trials
from .references import parse_template
from .sabotages import Sabotage, challenged_trials
from .specification import CheckedSpec, CheckedStep, made_list_of
from .yaml_nodes import ListNode, MappingNode, Node, child, plain

SABOTAGE_TAG = "sabotage"
"""Tag of a job with the name of its sabotage; absent: the robot is unchanged."""
JOB_TAG = "challenged-job"
"""Tag of a job with its number in the challenge, from 1; jobs with the same number are compared."""
_REQUESTS = "createSimulationJobRequests"
_TOKEN = "clientRequestToken"  # noqa: S105 - a member's name
_APPLICATIONS = ("simulationApplications", "robotApplications")


def is_sabotaged(tags: Mapping[str, str]) -> bool:
    """Returns whether tags are those of a job that a challenge has sabotaged, whose failure is what it is for."""
    return SABOTAGE_TAG in tags and JOB_TAG in tags  # one of these alone may be somebody's own


def challenged_spec(spec: CheckedSpec, jobs: int) -> CheckedSpec:
    """Returns the part of a specification that a challenge runs: its simulation steps, as batches, and those they need.

    Args:
        spec: The specification.
        jobs: Maximum number of challenged jobs; if there are more steps, the first ones are used.

    Raises:
        SpecError: It runs no simulation jobs, or some that no axis reaches, changes what is there already, or uses
            what simulation steps give.
    """
    check_probed(spec, "a challenge")
    simulating = [name for name in spec.order if spec.steps[name].operation in (JOB, BATCH)][:jobs]
    if not simulating:
        words = f"no step runs simulation jobs, so that there is no robot to sabotage; add one of {JOB} or {BATCH}"
        raise SpecError([Problem(Place(spec.filename, 1, 1), "steps", words)])
    _check_reached(spec.steps[name] for name in simulating)
    kept = _with_needed(spec, simulating)
    _check_unused(spec, kept, simulating)
    steps = {name: _as_batch(step) for name, step in spec.steps.items() if name in kept}
    return replace(spec, steps=steps, order=tuple(name for name in spec.order if name in kept))


@dataclass
class ChallengeCut:
    """Function object that replaces each step's request by that of a challenge: jobs with faults put into the robot."""

    sabotages: Sequence[Sabotage]
    jobs: int
    """Number of jobs that may still be challenged."""
    steps: int
    """Number of simulation steps that are still to come."""
    worlds: int | None
    """Maximum number of worlds of each generation job; None: all, as requests may name any of them."""
    _number: int = field(default=0, init=False)
    """Number of jobs challenged so far."""

    @classmethod
    def of(cls, spec: CheckedSpec, sabotages: Sequence[Sabotage], jobs: int) -> "ChallengeCut":
        """Prepares the cut of a specification.

        Args:
            spec: Specification from `challenged_spec`.
            sabotages: The sabotages.
            jobs: Maximum number of challenged jobs.
        """
        requests = [child(step.input, _REQUESTS) for step in spec.steps.values() if step.operation == BATCH]
        counts = all(node is not None and made_list_of(node) for node in requests)
        return cls(sabotages, jobs, len(requests), jobs if counts else None)

    def __call__(self, operation: str, request: dict[str, Any]) -> dict[str, Any]:
        """Returns the request that a challenge carries out in place of a step's: its jobs, with and without sabotages.

        Args:
            operation: Operation of the step.
            request: Request of the step, with references resolved.
        """
        members = {name: value for name, value in request.items() if name != _TOKEN}
        if operation == GENERATION and self.worlds is not None:
            return cut(operation, members, ProbeSize(self.worlds, 0, 0))
        requests = members.get(_REQUESTS)
        if operation != BATCH or not is_list(requests):
            return members
        share = -(-self.jobs // self.steps)  # what the steps to come can have of it, rounded up
        chosen = [requests[index] for index in of_each_kind([kind_of(job) for job in requests], share)]
        self.steps -= 1
        self.jobs -= len(chosen)
        arms = [arm for job in chosen for arm in self._arms(job)]
        return {**members, **_longer(members.get("batchPolicy"), 1 + len(self.sabotages)), _REQUESTS: arms}

    def _arms(self, job: Mapping[str, Any]) -> list[dict[str, Any]]:
        self._number += 1
        return [arm_of(job, sabotage, self._number) for sabotage in (None, *self.sabotages)]


def arm_of(job: Mapping[str, Any], sabotage: Sabotage | None, number: int) -> dict[str, Any]:
    """Makes the request of a job with a sabotage (a fault put into the robot), or with the unchanged robot.

    Args:
        job: Request of the job, with references resolved.
        sabotage: Sabotage to apply; None: the job is of the control arm.
        number: Number of the job in the challenge.
    """
    checked = SimulationJobRequest.model_validate({name: value for name, value in job.items() if name != _TOKEN})
    applications = {role: [without_trials(each) for each in job[role]] for role in _APPLICATIONS if job.get(role)}
    # A job's own tag of that name would make its control arm a sabotaged one.
    own = {name: value for name, value in (checked.tags or {}).items() if name != SABOTAGE_TAG}
    tags = {**own, JOB_TAG: str(number), **({SABOTAGE_TAG: sabotage.name} if sabotage else {})}
    seed = seed_of(checked) or 0  # without one each arm would draw its own
    trials = challenged_trials(trials_of(checked), seed, sabotage)
    # A film would be made of a recording, which these jobs do not have.
    return {**job, **applications, "seed": seed, "tags": tags, "trials": trials, "video": "none"}


def _with_needed(spec: CheckedSpec, names: Sequence[str]) -> set[str]:
    """Returns the named steps, and all steps that have to end before them."""
    found: set[str] = set()
    left = list(names)
    while left:
        if (name := left.pop()) not in found:
            found.add(name)
            left += spec.steps[name].needs
    return found


def _check_unused(spec: CheckedSpec, kept: set[str], simulating: Sequence[str]) -> None:
    problems = [
        Problem(
            spec.steps[name].place,
            path_text(spec.steps[name].location),
            f"uses what {', '.join(used)} gives; a challenge runs other jobs there, whose results are no steps' inputs",
        )
        for name in spec.order
        if name in kept and (used := sorted(_names_in(spec.steps[name].input) & set(simulating)))
    ]
    if problems:
        raise SpecError(problems)


def _check_reached(steps: Iterable[CheckedStep]) -> None:
    """Checks that axes of sabotages reach the simulation of each step's jobs, as far as the specification shows it.

    Raises SpecError with a problem for each step whose jobs they do not reach.
    """
    problems = [
        Problem(
            step.place,
            path_text(step.location),
            "a job's simulation is a program, or its robot program has none to drive, so that no axis reaches the "
            "robot; challenges need a simulation application that is a factory",
        )
        for step in steps
        if any(not _is_reached(each) for each in _jobs_in(plain(step.input)))
    ]
    if problems:
        raise SpecError(problems)


def _is_reached(job: Mapping[str, Any]) -> bool:
    """Returns whether a job steps an environment: its simulation is a factory, or built in for a robot's factory."""
    simulations, robots = (_programs_of(job.get(role)) for role in _APPLICATIONS)
    return not any(simulations) and (bool(simulations) or not any(robots))


def _programs_of(configs: object) -> list[bool]:
    """Returns for each application of a job whether its launch configuration starts a program."""
    found: list[bool] = []
    for each in configs if is_list(configs) else ():
        launch = each.get("launchConfig") if is_mapping(each) else None
        if is_mapping(launch):
            command, file = launch.get("command"), launch.get("launchFile")
            given = LaunchConfig.model_construct(command=command, launchFile=file if isinstance(file, str) else None)
            found.append(is_program(given))
        else:
            found.append(False)
    return found


def _jobs_in(value: object) -> Iterator[Mapping[str, Any]]:
    """Yields the requests of jobs anywhere in an input."""
    if is_list(value):
        for item in value:
            yield from _jobs_in(item)
    elif is_mapping(value):
        if any(role in value for role in _APPLICATIONS):
            yield value
        else:
            for item in value.values():
                yield from _jobs_in(item)


def _names_in(node: Node) -> set[str]:
    """Returns the names of the steps and variables that references use anywhere in an input."""
    if isinstance(node, MappingNode):
        return {name for each in node.entries.values() for name in _names_in(each)}
    if isinstance(node, ListNode):
        return {name for each in node.items for name in _names_in(each)}
    if not isinstance(node.value, str):
        return set()
    parts = parse_template(node.value).parts
    return {name for part in parts if not isinstance(part, str) for name in part.names()}


def _as_batch(step: CheckedStep) -> CheckedStep:
    """Converts a step with a single job to one with a batch of that job."""
    if step.operation != JOB or not isinstance(step.input, MappingNode):
        return step
    job = replace(step.input, entries={name: node for name, node in step.input.entries.items() if name != _TOKEN})
    requests = ListNode(step.place, (job,))
    batch = MappingNode(step.place, {_REQUESTS: requests}, {_REQUESTS: step.place})
    return replace(step, operation=BATCH, input=batch)


def _longer(policy: object, times: int) -> dict[str, Any]:
    """Returns a batch's policy with its time limit, if any, multiplied by a number."""
    limit_s = policy.get("timeoutInSeconds") if is_mapping(policy) else None
    if not is_mapping(policy) or not isinstance(limit_s, int):
        return {}
    return {"batchPolicy": {**policy, "timeoutInSeconds": min(MAX_DURATION_S, limit_s * times)}}
