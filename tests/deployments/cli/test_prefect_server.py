"""The Prefect server of a command's process."""

import os
from collections.abc import Iterator
from pathlib import Path

import pytest
from prefect import context

from prefect_robomaker.deployments.cli import prefect_server
from prefect_robomaker.deployments.prefect_server.local_server import ServerStatus
from prefect_robomaker.schemas.settings import Settings

URL = "http://127.0.0.1:5/api"


@pytest.fixture
def own_environment(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    with monkeypatch.context() as patched:
        patched.setattr(os, "environ", os.environ.copy())
        yield
    context.refresh_global_settings_context()


@pytest.mark.usefixtures("own_environment")
def test_a_prefect_that_is_imported_already_uses_the_server(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    os.environ.pop("PREFECT_API_URL", None)
    monkeypatch.setattr(prefect_server, "server_status", lambda _: ServerStatus(running=True, api_url=URL))
    monkeypatch.setattr(prefect_server, "ensure_server", lambda *_, **__: URL)

    prefect_server.use_server(Settings.from_environment({"ROBOMAKER_HOME": str(tmp_path)}))

    assert context.GLOBAL_SETTINGS_CONTEXT.settings.api.url == URL
