"""An endpoint without a server in between."""

from collections.abc import Iterator

import pytest
from helpers.asgi import Client

from prefect_robomaker.deployments.endpoint.application import make_application
from prefect_robomaker.tasks.service.service import Service


@pytest.fixture
def submitted() -> list[str]:
    """ARNs of the jobs that the endpoint stored."""
    return []


@pytest.fixture
def client(service: Service, submitted: list[str]) -> Iterator[Client]:
    """A client of the service's endpoint."""
    client = Client(make_application(service, on_submitted=submitted.append))
    yield client
    client.close()
