"""`streamUI` of a job, from the request to its log."""

from collections.abc import Callable
from typing import Any

import pytest

from prefect_robomaker.tasks.service.service import Service

Order = Callable[..., dict[str, Any]]
Simulate = Callable[[dict[str, Any]], dict[str, Any]]


@pytest.mark.parametrize("wanted", [True, pytest.param(False, marks=pytest.mark.deep)])
def test_a_page_is_served_for_who_asks_for_it(service: Service, order: Order, simulate: Simulate, wanted: bool) -> None:
    request = order()
    request["simulationApplications"][0]["launchConfig"]["streamUI"] = wanted
    job = simulate(request)
    assert job["status"] == "Completed"
    outputs = service.catalog.get(job["arn"]).document["outputs"]
    log = service.store.get_bytes(outputs["bucket"], f"{outputs['prefix']}/logs/stdout.log").decode()
    assert ("Live view: http://127.0.0.1:" in log) is wanted
