import urllib.request
from pathlib import Path

import pytest
from prefect_server import server_settings

from prefect_robomaker.deployments.local_server import (
    configured_api_url,
    ensure_server,
    server_status,
    stop_server,
)
from prefect_robomaker.schemas.errors import ConfigurationError
from prefect_robomaker.schemas.settings import Settings


def test_the_server_is_started_once_and_reused(prefect_server: str) -> None:
    status = server_status(server_settings(), {})

    assert ensure_server(server_settings(), {}) == prefect_server == status.api_url
    assert status.running
    assert prefect_server.startswith("http://127.0.0.1:")
    with urllib.request.urlopen(f"{prefect_server}/health") as answer:
        assert answer.status == 200


def test_a_state_file_of_a_dead_server_is_not_believed(settings: Settings) -> None:
    folder = settings.home / "prefect"
    folder.mkdir(parents=True)
    (folder / "server.json").write_text('{"running": true, "api_url": "http://127.0.0.1:1/api", "pid": 1}')

    assert not server_status(settings, {}).running
    assert not stop_server(settings)


def test_a_damaged_state_file_counts_as_no_server(settings: Settings) -> None:
    folder = settings.home / "prefect"
    folder.mkdir(parents=True)
    (folder / "server.json").write_text("{")

    assert not server_status(settings, {}).running


def test_a_configured_server_that_does_not_answer_is_named(settings: Settings) -> None:
    with pytest.raises(ConfigurationError, match="http://127.0.0.1:1/api"):
        ensure_server(settings, {"PREFECT_API_URL": "http://127.0.0.1:1/api"})


def test_the_active_prefect_profile_is_respected(tmp_path: Path) -> None:
    profiles = tmp_path / "profiles.toml"
    profiles.write_text('active = "team"\n[profiles.team]\nPREFECT_API_URL = "https://prefect.example/api"\n')

    assert configured_api_url({"PREFECT_PROFILES_PATH": str(profiles)}) == "https://prefect.example/api"
    assert configured_api_url({"PREFECT_PROFILES_PATH": str(profiles), "PREFECT_PROFILE": "other"}) is None
    assert configured_api_url({"PREFECT_HOME": str(tmp_path / "nowhere")}) is None
