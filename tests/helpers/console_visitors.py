"""Visitors of a console without a server."""

import asyncio
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing
from typing import Any

import httpx
import pytest

from prefect_robomaker.deployments.console.console import Console
from prefect_robomaker.deployments.endpoint.application import Endpoint
from prefect_robomaker.deployments.endpoint.calling.access_keys import AccessKey
from prefect_robomaker.deployments.spec_runs.spec_runs import SpecRuns
from prefect_robomaker.tasks.service.service import Service

ADDRESS = "http://127.0.0.1:8057"


class Browser:
    """Asks an application as a browser does: keeps cookies; follows no redirects."""

    def __init__(self, application: Any, address: str) -> None:
        self._runner = asyncio.Runner()
        self._client = httpx.AsyncClient(transport=httpx.ASGITransport(application), base_url=address)

    def get(self, path: str, **more: Any) -> httpx.Response:
        """Reads a page."""
        return self._runner.run(self._client.get(path, **more))

    def post(self, path: str, **more: Any) -> httpx.Response:
        """Sends a form."""
        return self._runner.run(self._client.post(path, **more))

    def close(self) -> None:
        """Ends the loop."""
        self._runner.run(self._client.aclose())
        self._runner.close()


Visitor = Callable[..., Browser]


@pytest.fixture
def visitor(service: Service) -> Iterator[Visitor]:
    """Opens a console, and a client of it that keeps cookies and follows no redirects."""
    with ExitStack() as stack:

        def open_console(
            *keys: AccessKey, address: str = ADDRESS, spec_runs: SpecRuns | None = None, **members: Any
        ) -> Browser:
            by_id = {key.id: key for key in keys} or None
            endpoint = Endpoint(service, access_keys=by_id, **members)
            console = Console(endpoint, service, access_keys=by_id, spec_runs=spec_runs)
            return stack.enter_context(closing(Browser(console, address)))

        yield open_console


@pytest.fixture
def browser(visitor: Visitor) -> Browser:
    """A visitor of a console that asks for no access key."""
    return visitor()
