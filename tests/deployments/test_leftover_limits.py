"""Concurrency limits on the server: those of batches that have ended go, those of others stay."""

from collections.abc import Callable
from typing import Any
from uuid import uuid4

from prefect.client.orchestration import get_client

from prefect_robomaker.deployments.dead_run_sweeper import remove_leftover_limits
from prefect_robomaker.tasks.execution.batch_slots import limit_name
from prefect_robomaker.tasks.operations.registry import call
from prefect_robomaker.tasks.service.service import Service


def test_limits_of_batches_that_have_ended_are_removed_and_those_of_others_stay(
    service: Service, order: Callable[..., dict[str, Any]], prefect_server: str
) -> None:
    def batch() -> str:
        members = {"createSimulationJobRequests": [order()]}
        return str(call("StartSimulationJobBatch", members, service)["arn"])

    ended, waiting = batch(), batch()
    call("CancelSimulationJobBatch", {"batch": ended}, service)
    assert service.catalog.get(ended).status == "Canceled"
    of_ended, of_waiting = (limit_name(arn.rpartition("/")[2]) for arn in (ended, waiting))
    foreign = [limit_name(f"batch-{uuid4().hex[:12]}"), f"robomaker-{uuid4().hex[:8]}"]
    with get_client(sync_client=True) as client:
        for name in (of_ended, of_waiting, *foreign):
            client.upsert_global_concurrency_limit_by_name(name, 2)

        assert remove_leftover_limits(client, service.settings) == [of_ended]
        assert remove_leftover_limits(client, service.settings) == []
        for name in (of_waiting, *foreign):
            assert client.read_global_concurrency_limit_by_name(name).limit == 2
            client.delete_global_concurrency_limit_by_name(name)
