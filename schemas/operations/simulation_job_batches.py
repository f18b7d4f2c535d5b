"""Operations on simulation job batches: many simulation jobs, of which a limited number runs at the same time."""

from typing import Annotated, Literal

from pydantic import Field

from ..wire.base import Shape, ShapeName, optional
from ..wire.common import (
    MAX_DURATION_S,
    Arn,
    ClientRequestToken,
    FailedAt,
    Filters,
    GenericString,
    LastUpdatedAt,
    PageRequest,
    PaginationToken,
    Timestamp,
)
from ..wire.operation_shape import INTERNAL, INVALID, LIMIT, MISMATCH, NOT_FOUND, READ_ERRORS, THROTTLED, OperationShape
from ..wire.tags import TagMap
from .simulation_jobs import SimulationJobErrorCode, SimulationJobRequest, SimulationJobRequests, SimulationJobSummaries

SimulationJobBatchStatus = Annotated[
    Literal[
        "Pending",
        "InProgress",
        "Failed",
        "Completed",
        "Canceled",
        "Canceling",
        "Completing",
        "TimingOut",
        "TimedOut",
    ],
    ShapeName("SimulationJobBatchStatus"),
]
SimulationJobBatchErrorCode = Annotated[Literal["InternalServiceError"], ShapeName("SimulationJobBatchErrorCode")]
BatchTimeoutInSeconds = Annotated[
    int, ShapeName("BatchTimeoutInSeconds", wire_type="long"), Field(ge=1, le=MAX_DURATION_S)
]
MOST_PRIORITY = 100
BatchPriority = Annotated[int, ShapeName("BatchPriority"), Field(ge=-MOST_PRIORITY, le=MOST_PRIORITY)]
MaxConcurrency = Annotated[int, ShapeName("MaxConcurrency"), Field(ge=1)]


class BatchPolicy(Shape):
    """Limits of a simulation job batch: its timeout, how many jobs run at once, and its priority."""

    timeoutInSeconds: BatchTimeoutInSeconds | None = optional(
        "Time for the whole batch in seconds, 1 to 1209600; absent: 14 days."
    )
    maxConcurrency: MaxConcurrency | None = optional(
        "Jobs at a time, at least 1; absent: as many as a machine runs at once, `ROBOMAKER_MAX_JOBS`."
    )
    priority: BatchPriority | None = optional(
        "Extension: on each machine jobs of batches with a higher one begin first; -100 to 100, absent: 0."
    )


class StartSimulationJobBatchRequest(Shape):
    """Request of `StartSimulationJobBatch`: starts a batch of simulation jobs."""

    clientRequestToken: ClientRequestToken | None = optional(
        "Makes the call repeatable: the same token and request give the same batch."
    )
    batchPolicy: BatchPolicy | None = optional("Limits of the batch.")
    createSimulationJobRequests: SimulationJobRequests = Field(description="The jobs, 1 to 1000, in order.")
    tags: TagMap | None = optional("Tags for the batch; those of its jobs are in the requests.")


class FailedCreateSimulationJobRequest(Shape):
    """A request of a simulation job batch for which no job was created, with the reason."""

    request: SimulationJobRequest | None = optional("The request as it was sent.")
    failureReason: GenericString | None = optional("Why not, in words.")
    failureCode: SimulationJobErrorCode | None = optional("Why not.")
    failedAt: FailedAt | None = optional("When that was found.")


FailedCreateSimulationJobRequests = Annotated[
    list[FailedCreateSimulationJobRequest], ShapeName("FailedCreateSimulationJobRequests")
]
PendingSimulationJobRequests = Annotated[list[SimulationJobRequest], ShapeName("CreateSimulationJobRequests", 1, 1000)]


class StartSimulationJobBatchResponse(Shape):
    """Response of `StartSimulationJobBatch`: the accepted batch. The three lists are always sent, even when empty."""

    arn: Arn | None = optional("ARN of the batch.")
    status: SimulationJobBatchStatus | None = optional("Status of the batch.")
    createdAt: Timestamp | None = optional("When it was accepted.")
    clientRequestToken: ClientRequestToken | None = optional("The request's token.")
    batchPolicy: BatchPolicy | None = optional("Limits of the batch.")
    failureCode: SimulationJobBatchErrorCode | None = optional("Why it failed; absent if not.")
    failureReason: GenericString | None = optional("Why it failed, in words.")
    failedRequests: FailedCreateSimulationJobRequests | None = optional("Requests that never became jobs.")
    pendingRequests: PendingSimulationJobRequests | None = optional("Requests that wait.")
    createdRequests: SimulationJobSummaries | None = optional("Requests that became jobs.")
    tags: TagMap | None = optional("The batch's tags.")


class DescribeSimulationJobBatchRequest(Shape):
    """Request of `DescribeSimulationJobBatch`: names the batch to describe."""

    batch: Arn = Field(description="ARN of the batch.")


class DescribeSimulationJobBatchResponse(StartSimulationJobBatchResponse):
    """Response of `DescribeSimulationJobBatch`: one batch with its pending, failed and created jobs."""

    lastUpdatedAt: LastUpdatedAt | None = optional("When it last changed.")


class ListSimulationJobBatchesRequest(PageRequest):
    """Request of `ListSimulationJobBatches`: asks for a page of batches, newest first."""

    filters: Filters | None = optional("Filter by `status`; absent: all batches.")


Integer = Annotated[int, ShapeName("Integer")]


class SimulationJobBatchSummary(Shape):
    """Summary of a simulation job batch, as `ListSimulationJobBatches` shows it."""

    arn: Arn | None = optional("ARN of the batch.")
    lastUpdatedAt: LastUpdatedAt | None = optional("When it last changed.")
    createdAt: Timestamp | None = optional("When it was accepted.")
    status: SimulationJobBatchStatus | None = optional("Status of the batch.")
    failedRequestCount: Integer | None = optional("How many requests never became jobs.")
    pendingRequestCount: Integer | None = optional("How many requests wait.")
    createdRequestCount: Integer | None = optional("How many requests became jobs.")


SimulationJobBatchSummaries = Annotated[list[SimulationJobBatchSummary], ShapeName("SimulationJobBatchSummaries")]


class ListSimulationJobBatchesResponse(Shape):
    """Response of `ListSimulationJobBatches`: one page of batches."""

    simulationJobBatchSummaries: SimulationJobBatchSummaries | None = optional("Batches, newest first.")
    nextToken: PaginationToken | None = optional("Token of the next page; absent on the last.")


class CancelSimulationJobBatchRequest(Shape):
    """Request of `CancelSimulationJobBatch`: names the batch to cancel."""

    batch: Arn = Field(description="ARN of the batch.")


class CancelSimulationJobBatchResponse(Shape):
    """Response of `CancelSimulationJobBatch`: empty; the batch and its jobs end soon, or have ended."""


OPERATIONS = (
    OperationShape(
        StartSimulationJobBatchRequest,
        (INVALID, LIMIT, THROTTLED, MISMATCH, INTERNAL),
        "Runs many simulations, so many at a time.",
        is_job=True,
    ),
    OperationShape(
        DescribeSimulationJobBatchRequest,
        (NOT_FOUND, INVALID, INTERNAL),
        "Describes a batch: its progress, and the jobs and failures of its requests.",
    ),
    OperationShape(ListSimulationJobBatchesRequest, (INVALID, INTERNAL), "Lists simulation job batches, newest first."),
    OperationShape(
        CancelSimulationJobBatchRequest,
        READ_ERRORS,
        "Stops a batch: its jobs end, requests that wait never become jobs.",
    ),
)
