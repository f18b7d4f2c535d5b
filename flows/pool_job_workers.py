"""Prefect flow of the job workers that a work pool starts: one flow run for each machine, not for each job.

Starting a flow run takes seconds.
"""

from typing import Any

from prefect import State, flow
from prefect.context import FlowRunContext
from prefect.exceptions import TerminationSignal
from prefect.states import Completed, Failed

from ..schemas.wire.errors import ConfigurationError
from ..tasks.backends.backend import JOB_WORKER_FLOW, MISCONFIGURED
from ..tasks.execution.flow_ends import started_by_worker
from ..tasks.execution.orphans import end_job_worker
from ..tasks.execution.run_watch import beginning_run, watched_run
from ..tasks.jobs.batch_workers import BatchWorker
from ..tasks.service.catalog_wait import once_catalog_answers
from ..tasks.service.service import Service


@flow(name=JOB_WORKER_FLOW)
def RunJobWorker(batch: str) -> State[Any]:
    """Runs a job worker: takes jobs of a simulation job batch from the catalog and runs them, until none is left.

    `ROBOMAKER_BACKEND=workers:POOL` starts one for each machine. If a flow run is cancelled, other job workers continue
    its jobs, and the batch continues.

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
