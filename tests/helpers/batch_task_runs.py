"""The task runs of a batch, read from the Prefect server as its pages do."""

from collections.abc import Sequence

from prefect.client.orchestration import get_client
from prefect.client.schemas.filters import FlowRunFilter, FlowRunFilterName
from prefect.client.schemas.objects import TaskRun

from helpers.processes import wait_for


def task_runs(batch: str) -> Sequence[TaskRun]:
    """The task runs of a batch that a pipeline ran, once the server knows of one and all have ended.

    Args:
        batch: Its ARN; its flow run has the name of its id.
    """
    named = FlowRunFilter(name=FlowRunFilterName(any_=[batch.rsplit("/", 1)[-1]]))
    known: Sequence[TaskRun] = []

    def ended() -> bool:
        nonlocal known
        with get_client(sync_client=True) as client:
            known = client.read_task_runs(flow_run_filter=named)
        return bool(known) and all(run.state is not None and run.state.is_final() for run in known)

    wait_for(ended, "the server to know of the task runs")
    return known
