"""States of the simulation jobs of a job or batch, from the catalog alone, for messages and exit codes."""

import json
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from pydantic import ValidationError

from ...schemas.documents.simulation_jobs import SimulationJobBatchDocument, SimulationJobDocument
from ...schemas.reports.names import short_name
from ...schemas.reports.run_record import JobRecord
from ...schemas.reports.run_states import (
    FlowResult,
    count_outcomes,
    in_words,
    run_state,
    verdicts_of,
    worst_job,
)
from ...schemas.runs.plan import RunResult
from ...schemas.wire.errors import StorageError
from ..catalog import Resource
from ..service.references import name_of_job
from ..service.service import Service
from ..simulations.planning.run_plans import world_arn


def job_result(operation: str, answer: Mapping[str, Any], service: Service) -> FlowResult:
    """Makes the result that a job's Prefect flow returns, from the job's end.

    Args:
        operation: Operation that created the job.
        answer: Final description of the job.
        service: The service, with its catalog and object store.
    """
    arn, status = str(answer["arn"]), str(answer["status"])
    jobs = simulation_standings(arn, service)
    state = run_state([status], jobs)
    reason = why_not_completed(answer)
    troubles = [f"{status}: {reason}"] if reason and not jobs else []
    message = in_words(state, jobs, troubles, look=_inspect_command(operation, arn, jobs))
    return FlowResult(state=state, message=message, verdicts=verdicts_of(jobs), counts=count_outcomes(jobs))


def why_not_completed(answer: Mapping[str, Any]) -> str | None:
    """Returns the reason for which a job did not complete, from its final description; `None` if it did."""
    failures = answer.get("finishedWorldsSummary", {}).get("failureSummary", {}).get("failures")
    if failures and "failureReason" not in answer:
        count = sum(failure["failureCount"] for failure in failures)
        return f"worlds that failed: {count}; {failures[0]['sampleFailureReason']}"
    return answer.get("failureReason")


def _inspect_command(operation: str, arn: str, jobs: Sequence[JobRecord]) -> str:
    """Returns a command line that shows the reason of a failure: of a step's worst job, else of the step itself."""
    worst = worst_job(jobs)
    if worst is not None and worst.arn is not None:
        if worst.status == "Completed":
            return f"robomaker repro {worst.label}"
        operation, arn = "CreateSimulationJob", worst.arn
    member = "batch" if operation == "StartSimulationJobBatch" else "job"
    return f"robomaker call Describe{operation.removeprefix('Create').removeprefix('Start')} --input " + (
        f"'{json.dumps({member: arn})}'"
    )


def simulation_standings(arn: str, service: Service) -> list[JobRecord]:
    """Returns short records of a simulation job, or of each job of a batch, with their current state.

    Args:
        arn: ARN of the job or batch.
        service: The service, with its catalog and object store.

    Raises:
        ResourceNotFoundException: The catalog has no such resource.
    """
    job = service.catalog.get(arn)
    if job.kind == "simulation-job":
        return [_standing(job, service)]
    if job.kind == "simulation-job-batch":
        return [record for _, record in sorted(_of_batch(job, service), key=lambda found: found[0])]
    return []


def _of_batch(batch: Resource, service: Service) -> Iterator[tuple[int, JobRecord]]:
    for job in service.catalog.children(batch.arn, kind="simulation-job"):
        yield SimulationJobDocument.of(job).request_index or 0, _standing(job, service)
    for place, failure in SimulationJobBatchDocument.of(batch).failed.items():
        yield (
            int(place),
            JobRecord(
                label=f"request {int(place) + 1}",
                status="NotCreated",
                failure_code=failure.failure_code,
                failure_reason=failure.failure_reason,
            ),
        )


def _standing(job: Resource, service: Service) -> JobRecord:
    document = SimulationJobDocument.of(job)
    verdict, reason = document.verdict, document.verdict_reason
    if verdict is None and job.status == "Completed":  # it ended before verdicts were kept in the catalog
        result = _stored_result(document, service)
        verdict, reason = (result.verdict, result.reason) if result else (None, None)
    world = world_arn(document.request)
    return JobRecord(
        arn=job.arn,
        label=job.id,
        name=name_of_job(document),
        status=job.status,
        verdict=verdict,
        verdict_reason=reason,
        world=world and short_name(world),
        world_name=document.world_name,
        failure_code=document.failure_code,
        failure_reason=document.failure_reason,
    )


def _stored_result(document: SimulationJobDocument, service: Service) -> RunResult | None:
    place = document.outputs
    if place is None:
        return None
    try:
        return RunResult.model_validate_json(service.store.get_bytes(place.bucket, f"{place.prefix}/result.json"))
    except (StorageError, ValidationError):
        return None
