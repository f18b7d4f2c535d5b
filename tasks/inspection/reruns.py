"""Reruns of jobs of an earlier run: selects the jobs, and makes a specification that repeats them."""

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from ...schemas.documents.simulation_jobs import SimulationJobBatchDocument, SimulationJobDocument
from ...schemas.operations.registry import SEED_TAG
from ...schemas.reports.report import ReportedJob
from ...schemas.reports.run_record import RerunOf, RunRecord, StepRecord
from ...schemas.wire.errors import ConfigurationError
from ...schemas.wire.json_values import is_list, is_object
from ..catalog import Resource
from ..reporting.outcomes import Outcome, outcome_of
from ..service.service import Service
from ..simulations.planning.run_plans import world_arn
from .reports import jobs_of, short_name

_FAILED = (Outcome.BROKEN, Outcome.FAILED, Outcome.CANCELED, Outcome.UNFINISHED)
_MOST_NAMED = 5
_BATCH = "StartSimulationJobBatch"


@dataclass(frozen=True)
class Selection:
    """Filter for the jobs of a run to repeat: a job has to match all given criteria; no criteria match all jobs."""

    failed: bool = False
    """Selects jobs without a good result: failed, with errors, cancelled, or never started."""

    jobs: tuple[str, ...] = ()
    """Ids or ARNs of jobs, or labels such as `request 3`."""

    worlds: tuple[str, ...] = ()
    """ARNs of worlds, or their last parts, such as `world-3`."""

    @property
    def words(self) -> str:
        """Describes the criteria of the filter as text."""
        parts = ["failed"] if self.failed else []
        parts += [" or ".join(self.jobs)] if self.jobs else []
        parts += [f"in {' or '.join(self.worlds)}"] if self.worlds else []
        return ", ".join(parts) or "all"


@dataclass(frozen=True)
class Rerun:
    """A run that repeats selected jobs of an earlier run."""

    spec_text: str
    """Text of the specification: the original requests of the jobs, with the same worlds and seeds."""

    rerun_of: RerunOf


@dataclass(frozen=True)
class _Order:
    """A job of the earlier run, with the request that repeats it."""

    job: ReportedJob
    request: Mapping[str, Any]


def plan_rerun(record: RunRecord, selection: Selection, service: Service) -> Rerun | None:
    """Makes the specification that repeats selected jobs of an earlier run.

    Args:
        record: Record of the earlier run.
        selection: Filter for the run's jobs.
        service: Service with its catalog and object store.

    Returns:
        The rerun; `None`: no selected job has failed.

    Raises:
        ConfigurationError: The run has no jobs, or none that match the selection, or is a challenge.
        ResourceNotFoundException: The jobs of the run were deleted.
    """
    if record.challenge is not None:
        raise ConfigurationError(
            f"the run {record.run_id} is a challenge, whose sabotaged jobs say nothing one by one; "
            f"`robomaker challenge {record.spec_path}` runs it again"
        )
    orders = {step.name: found for step in record.steps if (found := _orders(step, service))}
    everything = [order.job for found in orders.values() for order in found]
    if not everything:
        raise ConfigurationError(
            f"the run {record.run_id} made no simulation jobs; `robomaker run {record.spec_path}` runs all of it again"
        )
    _check_names(selection, everything, record.run_id)
    chosen = {name: [order for order in found if _is_selected(order.job, selection)] for name, found in orders.items()}
    chosen = {name: found for name, found in chosen.items() if found}
    if not chosen and not selection.failed:
        raise ConfigurationError(f"no job of the run {record.run_id} is {selection.words}")
    if not chosen:
        return None
    steps = {step.name: _step(step, chosen[step.name], service) for step in record.steps if step.name in chosen}
    # The requests have the values; the rerun keeps them, so that records and comparisons show the same ones.
    parameters = {name: {"default": value} for name, value in record.parameters.items()}
    spec = {"version": 1, "name": record.name, **({"parameters": parameters} if parameters else {}), "steps": steps}
    return Rerun(
        spec_text=json.dumps(spec, indent=2, ensure_ascii=False) + "\n",
        rerun_of=RerunOf(
            run_id=record.run_id,
            selection=selection.words,
            jobs_total=len(everything),
            earlier={name: [_result_in_words(order.job) for order in found] for name, found in chosen.items()},
        ),
    )


def failed_again(arn: str, service: Service) -> dict[str, Any] | None:
    """Makes the request of a batch that repeats those jobs of a batch that did not succeed.

    Args:
        arn: ARN of the batch, which has ended.
        service: The service, with its catalog and object store.

    Returns:
        The request; `None`: none of its jobs failed.

    Raises:
        ResourceNotFoundException: The catalog has no such batch.
    """
    step = StepRecord(name="batch", operation=_BATCH, status="Completed", arn=arn)
    failed = [order for order in _orders(step, service) if outcome_of(order.job) in _FAILED]
    return _batch_request(step, failed, service) if failed else None


def _orders(step: StepRecord, service: Service) -> list[_Order]:
    """Returns the jobs of a step with their requests, in the order of the requests; empty for steps without jobs."""
    if step.arn is None or step.operation not in (_BATCH, "CreateSimulationJob"):
        return []
    jobs = jobs_of([step], service)
    stored = service.catalog.get_many(job.arn for job in jobs if job.arn)
    made = {arn: SimulationJobDocument.of(resource) for arn, resource in stored.items()}
    if step.operation != _BATCH:
        stored = service.catalog.get(step.arn, kind="simulation-job")
        return [_Order(jobs[0], _again(SimulationJobDocument.of(stored)))]
    batch = _batch(step, service)
    by_place = {made[job.arn].request_index or 0: job for job in jobs if job.arn and job.arn in made}
    failed = iter(job for job in jobs if job.arn is None)
    orders: list[_Order] = []
    for place, request in enumerate(batch.requests):
        job = by_place.get(place)
        if job is not None:
            orders.append(_Order(job, _again(made[job.arn or ""])))
        elif str(place) in batch.failed and (lost := next(failed, None)) is not None:
            orders.append(_Order(lost, _plain_request(request)))
        else:  # the run was killed before it came to it
            label, world = f"request {place + 1}", world_arn(request)
            lost = ReportedJob(label=label, step=step.name, status="NotCreated", world_arn=world)
            orders.append(_Order(lost, _plain_request(request)))
    return orders


def _batch(step: StepRecord, service: Service) -> SimulationJobBatchDocument:
    assert step.arn is not None
    batch: Resource = service.catalog.get(step.arn, kind="simulation-job-batch")
    return SimulationJobBatchDocument.of(batch)


def _again(document: SimulationJobDocument) -> dict[str, Any]:
    """Returns the request of a job, with the seed that the job had."""
    request = _plain_request(document.request)
    return request if SEED_TAG in (request.get("tags") or {}) else {**request, "seed": document.seed}


def _plain_request(request: Mapping[str, Any]) -> dict[str, Any]:
    """Removes the client token from a request, which would return the earlier job instead of a new one."""
    return {name: value for name, value in request.items() if name != "clientRequestToken"}


def _escaped(value: Any) -> Any:
    """Escapes a value for a specification, so that nothing in it is read as a reference."""
    if isinstance(value, str):
        return value.replace("${{", "$${{")
    if is_object(value):
        return {name: _escaped(inner) for name, inner in value.items()}
    return [_escaped(inner) for inner in value] if is_list(value) else value


def _step(step: StepRecord, orders: Sequence[_Order], service: Service) -> dict[str, Any]:
    request = orders[0].request if step.operation != _BATCH else _batch_request(step, orders, service)
    return {"operation": step.operation, "input": _escaped(request)}


def _batch_request(step: StepRecord, orders: Sequence[_Order], service: Service) -> dict[str, Any]:
    kept = {name: value for name, value in _batch(step, service).request.items() if name in ("batchPolicy", "tags")}
    return {**kept, "createSimulationJobRequests": [dict(order.request) for order in orders]}


def _result_in_words(job: ReportedJob) -> str:
    """Returns the first result of a job as text: `sim-…: FAIL`."""
    judged = job.result is not None and job.status == "Completed"
    return f"{job.label}: {job.result.verdict if judged and job.result else job.status}"


def _is_selected(job: ReportedJob, selection: Selection) -> bool:
    if selection.failed and outcome_of(job) not in _FAILED:
        return False
    if selection.jobs and not any(_is_job(job, name) for name in selection.jobs):
        return False
    return not selection.worlds or any(_is_world(job, name) for name in selection.worlds)


def _is_job(job: ReportedJob, name: str) -> bool:
    return name in (job.label, job.arn)


def _is_world(job: ReportedJob, name: str) -> bool:
    """Returns whether a job used a world, which may be given by the end of its ARN."""
    arn = job.world_arn
    return arn is not None and (arn == name or arn.endswith((f"/{name}", f":{name}")))


def _check_names(selection: Selection, jobs: Sequence[ReportedJob], run_id: str) -> None:
    """Checks that all given names belong to the run.

    Raises:
        ConfigurationError: A name does not belong to the run; the message lists the names that do.
    """
    for name in selection.jobs:
        if not any(_is_job(job, name) for job in jobs):
            raise ConfigurationError(f"the run {run_id} has no job {name!r}; it has {_some(_labels(jobs))}")
    for name in selection.worlds:
        if not any(_is_world(job, name) for job in jobs):
            worlds = [short_name(job.world_arn) for job in jobs if job.world_arn]
            known = f"it has jobs in {_some(worlds)}" if worlds else "its jobs have no worlds"
            raise ConfigurationError(f"the run {run_id} has no job in the world {name!r}; {known}")


def _labels(jobs: Sequence[ReportedJob]) -> Iterator[str]:
    return (job.label for job in jobs)


def _some(names: Iterator[str] | Sequence[str]) -> str:
    each = list(dict.fromkeys(names))
    more = len(each) - _MOST_NAMED
    return ", ".join(each[:_MOST_NAMED]) + (f" and {more} more" if more > 0 else "")
