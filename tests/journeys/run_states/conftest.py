"""What tests of states ask of Prefect's server."""

import json
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit
from uuid import UUID

import pytest
from helpers.prefect_server import provide_tables
from helpers.processes import wait_for
from helpers.tcp_proxy import TcpProxy

from prefect_robomaker.deployments.prefect_server.local_server import ensure_server, server_status, stop_server
from prefect_robomaker.deployments.prefect_server.secret import auth_string, server_folder
from prefect_robomaker.schemas.settings import Settings


@pytest.fixture
def spec(tmp_path: Path) -> Callable[[dict[str, Any]], Path]:
    """Writes a specification of a name of its own."""

    def write(steps: dict[str, Any]) -> Path:
        path = tmp_path / "spec.yaml"
        path.write_text(json.dumps({"version": 1, "name": "states", "steps": steps}))
        return path

    return write


@pytest.fixture
def flow_run(prefect_server: str) -> Callable[[str], Any]:
    """Waits for the flow run of a name, as the server knows it."""
    from prefect.client.orchestration import get_client
    from prefect.client.schemas.filters import FlowRunFilter, FlowRunFilterName

    def find(name: str) -> Any:
        chosen = FlowRunFilter(name=FlowRunFilterName(any_=[name]))
        with get_client(sync_client=True) as client:
            look = lambda: next(iter(client.read_flow_runs(flow_run_filter=chosen)), None)  # noqa: E731
            return wait_for(look, f"the flow run {name}")

    return find


@pytest.fixture
def state_of(prefect_server: str) -> Callable[..., Any]:
    """Waits for a flow run's final state."""
    from prefect.client.orchestration import get_client

    def ended(run: UUID, timeout_s: float = 120.0) -> Any:
        with get_client(sync_client=True) as client:

            def look() -> Any:
                state = client.read_flow_run(run).state
                return state if state is not None and state.is_final() else None

            return wait_for(look, f"the end of {run}", timeout_s)

    return ended


@pytest.fixture
def cable(prefect_server: str) -> Iterator[TcpProxy]:
    """Relay between a test and the Prefect server: whoever goes through it sees a server that is silent, or dead."""
    port = urlsplit(prefect_server).port
    assert port is not None
    proxy = TcpProxy(port)
    yield proxy
    with suppress(RuntimeError):  # a test may have closed it
        proxy.close()


@pytest.fixture
def own_server(tmp_path: Path) -> Any:
    """Environment variables of a Prefect server that a test may kill, and its process."""
    settings = Settings.from_environment({"ROBOMAKER_HOME": str(tmp_path / "server")})
    provide_tables(server_folder(settings))
    url = ensure_server(settings, {})
    pid = server_status(settings, {}).pid
    try:
        yield {"PREFECT_API_URL": url, "PREFECT_API_AUTH_STRING": auth_string(settings)}, pid
    finally:
        stop_server(settings)
