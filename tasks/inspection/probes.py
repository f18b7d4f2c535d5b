"""Measurements of a probe (small trial run): time, jobs and worlds of each step, and the numbers of the whole run."""

from collections.abc import Mapping, Sequence
from datetime import datetime, timedelta
from itertools import cycle, islice
from typing import Any

from ...schemas.documents.simulation_jobs import SimulationJobDocument
from ...schemas.documents.worlds import StoredPlace, WorldDocument
from ...schemas.reports.forecast import JobCost, ProbedJob, StepProbe
from ...schemas.reports.run_record import JobRecord, RunRecord, StepRecord
from ...schemas.runs.trials import Trials
from ...schemas.specs.probe_requests import BATCH, EXPORT, GENERATION, JOB, jobs_in, kind_of, worlds_in
from ...schemas.specs.resolving import resolve_input
from ...schemas.specs.specification import CheckedSpec
from ...schemas.wire.errors import StorageError
from ..catalog import Resource
from ..service.service import Service
from ..storage import read_manifest
from ..worlds.archive_places import archive_place
from .forecasting import WholeStep


def measured(
    first: RunRecord, last: RunRecord, cpu_times_s: Mapping[str, float], cpus: int, service: Service
) -> dict[str, StepProbe]:
    """Computes the time and disk measurements of each step from the passes of a probe (small trial run).

    Args:
        first: First pass, which starts all processes that a run starts.
        last: Last pass, or the first again: its jobs use the processes that the first pass started.
        cpu_times_s: CPU time in seconds of the processes that each step of the first pass started, by step name.
        cpus: Number of worlds that are generated at the same time.
        service: The service, with its catalog and object store.
    """
    return {
        one.name: _measured_step(one, other, cpu_times_s.get(one.name, 0.0), cpus, service)
        for one, other in zip(first.steps, last.steps, strict=True)
    }


def _measured_step(first: StepRecord, last: StepRecord, cpu_time_s: float, cpus: int, service: Service) -> StepProbe:
    probe = StepProbe(step=first.name, operation=first.operation, wall_time_s=_wall_time_s(first))
    if first.operation in (JOB, BATCH):
        trials = max((job.trials for job in _job_costs(first, service)), default=1)
        return probe.model_copy(update={"jobs": _job_costs(last, service), "first_trials": trials})
    if first.operation == GENERATION:
        worlds = service.catalog.children(first.arn or "", kind="world")
        made = sorted(world.created_at for world in worlds)
        sizes = [_size_bytes(WorldDocument.of(world).bundle, service) for world in worlds]
        return probe.model_copy(
            update={
                "worlds": len(made),
                "world_s": time_in_place_s(made, cpus),
                "cpu_time_s": cpu_time_s,
                "size_bytes": sum(sizes),
            }
        )
    if first.operation == EXPORT and (packed := len(first.output.get("worlds") or [])):
        size_bytes = _archive_bytes(first.arn or "", service)
        packing = {"worlds": packed, "world_s": probe.wall_time_s / packed, "size_bytes": size_bytes}
        return probe.model_copy(update=packing)
    return probe


def _wall_time_s(step: StepRecord) -> float:
    return (step.ended_at - step.started_at).total_seconds() if step.started_at and step.ended_at else 0.0


def time_in_place_s(ended: Sequence[datetime], at_once: int) -> float:
    """Estimates how long a world or job occupies its place, in seconds, from the times at which each ended.

    Args:
        ended: Time at which each ended, in order; the first one of each place is ignored, as it also waited for
            processes to start.
        at_once: Number of places.

    Returns:
        Seconds; 0 if no place had a second one.
    """
    later = len(ended) - at_once
    if later <= 0:
        return 0.0
    return (ended[-1] - ended[at_once - 1]) / timedelta(seconds=1) * at_once / later


def _job_costs(step: StepRecord, service: Service) -> list[JobCost]:
    """Returns the costs of a step's jobs, in request order, with unused time between jobs; empty for other steps."""
    if not step.arn:
        return []
    if step.operation == JOB:
        jobs = [service.catalog.get(step.arn, kind="simulation-job")]
    else:
        jobs = service.catalog.children(step.arn, kind="simulation-job")
    by_place = sorted(jobs, key=lambda job: SimulationJobDocument.of(job).request_index or 0)
    costs = [_job_cost(job, service) for job in by_place]
    waited_s = _wait_s(step, sorted(job.updated_at for job in jobs), costs, service)
    return [cost.model_copy(update={"slot_s": cost.slot_s + waited_s}) for cost in costs]


def _wait_s(step: StepRecord, ended: Sequence[datetime], costs: Sequence[JobCost], service: Service) -> float:
    """Returns the seconds for which a place is unused between two jobs, which is significant for short jobs."""
    allowed = (step.output.get("batchPolicy") or {}).get("maxConcurrency")
    if service.backend is not None or not allowed or not costs:
        return 0.0
    in_place_s = time_in_place_s(ended, min(allowed, service.settings.max_jobs))
    return max(0.0, in_place_s - sum(cost.slot_s for cost in costs) / len(costs))


def _job_cost(job: Resource, service: Service) -> JobCost:
    document = SimulationJobDocument.of(job)
    began = job.created_at
    if service.backend is not None and document.started_at is not None:
        began = document.started_at  # it was made before there was a place for it
    run_s = (document.simulation_time_millis or 0) / 1000
    return JobCost(
        slot_s=max((job.updated_at - began).total_seconds(), run_s),
        run_s=run_s,
        trials=Trials.model_validate(document.trials).count if document.trials else 1,
        cpu_time_s=document.cpu_time_s,
        size_bytes=_size_bytes(document.outputs, service),
        kind=kind_of(document.request),
    )


def _size_bytes(place: StoredPlace | None, service: Service) -> int:
    """Returns the size in bytes of the files that a manifest lists; 0 without a manifest."""
    if place is None:
        return 0
    try:
        return sum(file.size_bytes for file in read_manifest(service.store, place.bucket, place.prefix).files)
    except StorageError:
        return 0


def _archive_bytes(arn: str, service: Service) -> int:
    """Returns the size of an export job's archive in bytes; 0 if the object store cannot be read."""
    bucket, key = archive_place(service.catalog.get(arn, kind="world-export-job"))
    try:
        return sum(item.size_bytes for item in service.store.list(bucket, key))
    except StorageError:
        return 0


def probed_jobs(last: RunRecord) -> list[ProbedJob]:
    """Returns the jobs of a probe (small trial run) with their verdicts."""

    def trials(job: JobRecord, name: str) -> int | None:
        counted = job.metrics.get(name)
        return None if counted is None else int(counted)

    return [
        ProbedJob(
            job=job.label,
            verdict=job.verdict or job.status,
            reason=job.failure_reason or job.verdict_reason or "",
            trials=trials(job, "trials"),
            trials_passed=trials(job, "trials_passed"),
        )
        for job in last.jobs
    ]


def whole_steps(spec: CheckedSpec, probe: RunRecord) -> dict[str, WholeStep]:
    """Computes the amount of work in each step of the whole run, using a probe's worlds for missing ones.

    Args:
        spec: Specification.
        probe: Pass of the specification's probe in which all steps completed.

    Raises:
        SpecError: A reference gives nothing.
    """
    ended = {step.name: step for step in probe.steps}
    outputs: dict[str, dict[str, Any]] = {}
    whole: dict[str, WholeStep] = {}
    for name in spec.order:
        step, output = spec.steps[name], ended[name].output
        request = resolve_input(step, outputs)
        worlds = worlds_in(request) if step.operation == GENERATION else len(request.get("worlds") or [])
        policy = output.get("batchPolicy") or {}
        timeout_s = policy.get("timeoutInSeconds") if step.operation == BATCH else None
        jobs = jobs_in(step.operation, request)
        whole[name] = WholeStep(jobs, worlds, policy.get("maxConcurrency") or 1, timeout_s)
        outputs[name] = _with_all_worlds(output, worlds) if step.operation == GENERATION else output
    return whole


def _with_all_worlds(output: dict[str, Any], worlds: int) -> dict[str, Any]:
    """Returns a generation job's output with its worlds repeated until there are `worlds` of them."""
    summary = output.get("finishedWorldsSummary") or {}
    made = islice(cycle(summary.get("succeededWorlds") or []), worlds)
    return {**output, "finishedWorldsSummary": {**summary, "finishedCount": worlds, "succeededWorlds": list(made)}}
