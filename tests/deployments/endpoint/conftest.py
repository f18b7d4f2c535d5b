"""An endpoint without a server in between."""

from collections.abc import Iterator

import pytest
from helpers.asgi import Client

from prefect_robomaker.deployments.endpoint.application import Endpoint
from prefect_robomaker.tasks.service.service import Service


@pytest.fixture
def submitted() -> list[str]:
    """ARNs of the jobs that the endpoint stored."""
    return []


@pytest.fixture
def client(service: Service, submitted: list[str]) -> Iterator[Client]:
    """A client of the service's endpoint."""
    client = Client(Endpoint(service, on_submitted=submitted.append))
    yield client
    client.close()
