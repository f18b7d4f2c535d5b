"""A night of a deployment whose process died: Prefect takes the order of a flow run that finishes it."""

import uuid
from typing import Any

import pytest

from prefect_robomaker.deployments.worker.continued_runs import Continuing
from prefect_robomaker.schemas.reports.run_record import Order


def order(deployment: Any, **parameters: Any) -> Order:
    return Order(
        run_id=f"flats-{uuid.uuid4().hex[:8]}",
        text="",
        filename="flats.yaml",
        spec_path="flats.yaml",
        command=["true"],
        parameters=parameters,
        deployment=str(deployment),
    )


def test_values_that_prefect_requires_are_those_of_the_order(
    prefect_server: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PREFECT_API_URL", prefect_server)
    from prefect.client.orchestration import get_client
    from prefect.client.schemas.actions import WorkPoolCreate

    name = f"required-{uuid.uuid4().hex[:8]}"
    with get_client(sync_client=True) as client:
        client.create_work_pool(WorkPoolCreate(name=name, type="process"))
        deployment = client.create_deployment(
            client.create_flow_from_name("RunPipeline"),
            name,
            parameter_openapi_schema={
                "type": "object",
                "properties": {"arm": {"type": "string"}, "worlds": {"type": "integer"}},
                "required": ["arm"],
            },
            enforce_parameter_schema=True,
            work_pool_name=name,
        )
        run = order(deployment, arm="b", worlds=20)

        assert Continuing([name]).order(run)

        [ordered] = [each for each in client.read_flow_runs() if each.deployment_id == deployment]
        assert ordered.parameters == {"continues": run.run_id, "arm": "b"}
        assert not Continuing([name]).order(order(deployment)), "a process of the home finishes it"
