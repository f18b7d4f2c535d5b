"""Reruns of jobs of an earlier run: selects the jobs, and makes a specification that repeats them."""

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from ...schemas.documents.simulation_jobs import SimulationJobBatchDocument, SimulationJobDocument
from ...schemas.operations.registry import SEED_TAG
from ...schemas.reports.names import ambiguous, begins_id, meant, near_names, short_name, with_id
from ...schemas.reports.report import ReportedJob
from ...schemas.reports.run_record import WITHOUT_GOOD_RESULT, RerunOf, RunRecord, StepRecord
from ...schemas.reports.run_states import names_for_known
from ...schemas.wire.errors import ConfigurationError
from ...schemas.wire.json_values import is_list, is_object
from ..catalog import Resource
from ..reporting.outcomes import outcome_of
from ..service.service import Service
from ..simulations.planning.run_plans import world_arn
from .reports import jobs_of

_MOST_NAMED = 5
_BATCH = "StartSimulationJobBatch"


@dataclass(frozen=True)
class Selection:
    """Filter for the jobs of a run to repeat: a job has to match all given criteria; no criteria match all jobs."""

    failed: bool = False
    """Selects jobs without a good result: failed, with errors, cancelled, or never started."""

    jobs: tuple[str, ...] = ()
    """Ids of jobs or their beginnings, ARNs, names such as `scout in flat 3`, or labels such as `request 3`."""

    worlds: tuple[str, ...] = ()
    """ARNs of worlds or the ends of them, such as `world-3`; beginnings of ids, or names such as `flat 3`."""

    @property
    def words(self) -> str:
        """Describes the criteria of the filter as text: `failed, in flat 3 or flat 4`; `all` if it has none."""
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


def plan_rerun(record: RunRecord, selection: Selection, service: Service, timeout_s: int | None = None) -> Rerun | None:
    """Makes the specification that repeats selected jobs of an earlier run.

    Args:
        record: Record of the earlier run.
        selection: Filter for the run's jobs.
        service: Service with its catalog and object store.
        timeout_s: Seconds after which each batch is ended; None: those of the earlier run, if it had a limit.

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
            f"the run {record.run_id} made no simulation jobs; `{record.whole_again}` runs all of it again"
        )
    named = _named(selection, everything, record.run_id)
    chosen = {name: [order for order in found if _is_selected(order.job, named)] for name, found in orders.items()}
    chosen = {name: found for name, found in chosen.items() if found}
    if not chosen and not selection.failed:
        raise ConfigurationError(f"no job of the run {record.run_id} is {selection.words}")
    if not chosen:
        return None
    steps = {
        step.name: _step(step, chosen[step.name], service, timeout_s) for step in record.steps if step.name in chosen
    }
    # The requests have the values; the rerun keeps them, so that records and comparisons show the same ones.
    parameters = {name: {"default": value} for name, value in record.parameters.items()}
    labels = {order.job.label for found in chosen.values() for order in found}
    names = {each.label: [*names_for_known(each, record.rerun_of)] for each in record.jobs if each.label in labels}
    known = [each.model_dump(mode="json") for each in record.known]
    head = {"parameters": parameters, "known": known}
    told = {name: value for name, value in head.items() if value}
    spec = {"version": 1, "name": record.name, **told, "steps": steps}
    return Rerun(
        spec_text=json.dumps(spec, indent=2, ensure_ascii=False) + "\n",
        rerun_of=RerunOf(
            run_id=record.run_id,
            selection=selection.words,
            jobs_total=len(everything),
            earlier={name: [_result_in_words(order.job) for order in found] for name, found in chosen.items()},
            names=names if record.known else {},
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
    failed = [order for order in _orders(step, service) if outcome_of(order.job).value in WITHOUT_GOOD_RESULT]
    return _batch_request(step, failed, service) if failed else None


def _orders(step: StepRecord, service: Service) -> list[_Order]:
    """Returns the jobs of a step with their requests, in the order of the requests; empty for steps without jobs.

    Requests whose jobs were never made are among them, with the status `NotCreated`.
    """
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


def _step(step: StepRecord, orders: Sequence[_Order], service: Service, timeout_s: int | None) -> dict[str, Any]:
    request = orders[0].request if step.operation != _BATCH else _batch_request(step, orders, service)
    if step.operation == _BATCH and timeout_s is not None:
        request = {**request, "batchPolicy": {**request.get("batchPolicy", {}), "timeoutInSeconds": timeout_s}}
    return {"operation": step.operation, "input": _escaped(request)}


def _batch_request(step: StepRecord, orders: Sequence[_Order], service: Service) -> dict[str, Any]:
    kept = {name: value for name, value in _batch(step, service).request.items() if name in ("batchPolicy", "tags")}
    return {**kept, "createSimulationJobRequests": [dict(order.request) for order in orders]}


def _result_in_words(job: ReportedJob) -> str:
    """Returns a job with its verdict, or its status if it was not judged, as text: `sim-…: FAIL`."""
    judged = job.result is not None and job.status == "Completed"
    return f"{job.label}: {job.result.verdict if judged and job.result else job.status}"


def chosen_jobs(selection: Selection, jobs: Sequence[ReportedJob], run_id: str) -> list[ReportedJob]:
    """Returns the jobs of a run that match a selection.

    Args:
        selection: Filter, as people wrote it.
        jobs: Jobs of the run.
        run_id: Id of the run, for messages.

    Raises:
        ConfigurationError: A text means no job of this run, or any of several; the message lists them.
    """
    named = _named(selection, jobs, run_id)
    return [job for job in jobs if _is_selected(job, named)]


def _is_selected(job: ReportedJob, selection: Selection) -> bool:
    if selection.failed and outcome_of(job).value not in WITHOUT_GOOD_RESULT:
        return False
    if selection.jobs and job.label not in selection.jobs:
        return False
    return not selection.worlds or job.world_arn in selection.worlds


def _named(selection: Selection, jobs: Sequence[ReportedJob], run_id: str) -> Selection:
    """Returns the selection with the labels of jobs and the ARNs of worlds that its texts mean in this run.

    Raises:
        ConfigurationError: A text means no part of the run, or any of several; the message lists them.
    """
    labels = [label for text in selection.jobs for label in _jobs_meant(text, jobs, run_id)]
    worlds = [arn for text in selection.worlds for arn in _worlds_meant(text, jobs, run_id)]
    return Selection(selection.failed, tuple(labels), tuple(worlds))


def _jobs_meant(text: str, jobs: Sequence[ReportedJob], run_id: str) -> list[str]:
    known = {job.label: (job.name, job.arn or "") for job in jobs}
    found = meant(text, known)
    if not found:
        near = near_names(text, (name for job in jobs for name in (job.name, job.label)))
        raise ConfigurationError(f"the run {run_id} has no job {text!r}{near or f'; it has {_some(_titles(jobs))}'}")
    if len(found) > 1:
        raise ConfigurationError(ambiguous(text, f"jobs of the run {run_id}", [*_titles(jobs, found)]))
    return found


def _worlds_meant(text: str, jobs: Sequence[ReportedJob], run_id: str) -> list[str]:
    """Returns the ARNs of a run's worlds that a text means: all whose ARNs end so, or the one of that name or id.

    Raises ConfigurationError if it means none, or the beginning of an id means several.
    """
    names = {job.world_arn: job.world_name or "" for job in jobs if job.world_arn}
    ends = [arn for arn, name in names.items() if text in (arn, name) or arn.endswith((f"/{text}", f":{text}"))]
    found = ends or [arn for arn in names if begins_id(text, short_name(arn))]
    if not found:
        told = [with_id(name, short_name(arn)) for arn, name in names.items()]
        near = near_names(text, names.values())
        known = f"it has jobs in {_some(told)}" if told else "its jobs have no worlds"
        raise ConfigurationError(f"the run {run_id} has no job in the world {text!r}{near or f'; {known}'}")
    if not ends and len(found) > 1:
        told = [with_id(names[arn], short_name(arn)) for arn in found]
        raise ConfigurationError(ambiguous(text, f"worlds of the run {run_id}", told))
    return found


def _titles(jobs: Sequence[ReportedJob], labels: Sequence[str] | None = None) -> Iterator[str]:
    """Yields the names of jobs with their ids, of all jobs or of those with the given labels."""
    for job in jobs:
        if labels is None or job.label in labels:
            yield with_id(job.name, job.label)


def _some(names: Iterable[str]) -> str:
    each = list(dict.fromkeys(names))
    more = len(each) - _MOST_NAMED
    return ", ".join(each[:_MOST_NAMED]) + (f" and {more} more" if more > 0 else "")
