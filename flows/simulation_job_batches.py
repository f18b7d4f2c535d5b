"""Flows: simulation job batches: many jobs, never more than `maxConcurrency` at once."""

from typing import Any

from ..schemas.operations.simulation_job_batches import BatchPolicy
from ..schemas.operations.simulation_jobs import SimulationJobRequests
from ..schemas.wire.common import Arn, ClientRequestToken, Filters, MaxResults, PaginationToken, TagMap
from .steps import carry_out, operation_flow, perform_flow, read, record, validate


@operation_flow
def StartSimulationJobBatch(
    *,
    createSimulationJobRequests: SimulationJobRequests,
    clientRequestToken: ClientRequestToken | None = None,
    batchPolicy: BatchPolicy | None = None,
    tags: TagMap | None = None,
) -> dict[str, Any]:
    """Runs many simulations, so many at a time."""
    job = record("StartSimulationJobBatch", validate("StartSimulationJobBatch", locals()))
    return carry_out("StartSimulationJobBatch", job["arn"])


@perform_flow
def PerformSimulationJobBatch(arn: str) -> dict[str, Any]:
    """Carries the job of an ARN, made by StartSimulationJobBatch, to its end."""
    return carry_out("StartSimulationJobBatch", arn)


@operation_flow
def DescribeSimulationJobBatch(*, batch: Arn) -> dict[str, Any]:
    """Describes a batch: its progress, and the jobs and failures of its requests."""
    return read("DescribeSimulationJobBatch", locals())


@operation_flow
def ListSimulationJobBatches(
    *, nextToken: PaginationToken | None = None, maxResults: MaxResults | None = None, filters: Filters | None = None
) -> dict[str, Any]:
    """Lists simulation job batches, newest first."""
    return read("ListSimulationJobBatches", locals())


@operation_flow
def CancelSimulationJobBatch(*, batch: Arn) -> dict[str, Any]:
    """Stops a batch: its jobs end, requests that wait never become jobs."""
    return record("CancelSimulationJobBatch", validate("CancelSimulationJobBatch", locals()))
