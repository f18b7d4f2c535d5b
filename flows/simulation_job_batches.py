"""Flows: simulation job batches: many jobs, never more than `maxConcurrency` at once; and their job workers.

One that a work pool starts is a flow run for each machine, not for each job: to start one takes seconds.
"""

from typing import Any

from prefect import State, flow
from prefect.context import FlowRunContext
from prefect.exceptions import TerminationSignal
from prefect.states import Completed, Failed

from ..schemas.operations.simulation_job_batches import BatchPolicy
from ..schemas.operations.simulation_jobs import SimulationJobRequests
from ..schemas.wire.common import Arn, ClientRequestToken, Filters, MaxResults, PaginationToken, TagMap
from ..schemas.wire.errors import ConfigurationError
from ..tasks.backends.backend import JOB_WORKER_FLOW, MISCONFIGURED
from ..tasks.execution.flow_ends import started_by_worker
from ..tasks.execution.orphans import end_job_worker
from ..tasks.execution.run_watch import beginning_run, watched_run
from ..tasks.jobs.batch_workers import BatchWorker
from ..tasks.service.catalog_wait import once_catalog_answers
from ..tasks.service.service import Service
from .steps import carry_out, operation_flow, order, perform_flow, read, record, validate


@operation_flow
def StartSimulationJobBatch(
    *,
    createSimulationJobRequests: SimulationJobRequests,
    clientRequestToken: ClientRequestToken | None = None,
    batchPolicy: BatchPolicy | None = None,
    tags: TagMap | None = None,
) -> dict[str, Any]:
    """Runs many simulations, so many at a time."""
    return order("StartSimulationJobBatch", locals())


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


@flow(name=JOB_WORKER_FLOW)
def RunJobWorker(batch: str) -> State[Any]:
    """Takes jobs of a batch from the catalog and runs them here, until none is left.

    `ROBOMAKER_BACKEND=workers:POOL` starts as many as there are machines. When a run is cancelled, the jobs that it
    runs go on with other job workers; the batch goes on.

    Args:
        batch: ARN of the simulation job batch.
    """
    try:
        with beginning_run():
            service = once_catalog_answers(Service.current)
        worker = BatchWorker(batch, service)
        with watched_run(service.catalog, worker.stop):
            count = worker.run()
    except ConfigurationError as error:
        return Failed(name=MISCONFIGURED, message=str(error))
    except (KeyboardInterrupt, TerminationSignal):
        context = FlowRunContext.get()
        if started_by_worker() and context is not None and context.flow_run is not None:
            end_job_worker(Service.current().catalog, context.flow_run.id)
        raise
    return Completed(message=f"ran {count} {'job' if count == 1 else 'jobs'} of {batch}", data={"jobs": count})
