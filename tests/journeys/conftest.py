"""Fixtures that journeys share."""

from pathlib import Path

import pytest

from prefect_robomaker.tasks.service.service import Service


@pytest.fixture
def environ(service: Service, prefect_server: str, tmp_path: Path) -> dict[str, str]:
    """Environment variables that lead other processes to the test's service."""
    return {
        "ROBOMAKER_HOME": str(service.settings.home),
        "PREFECT_API_URL": prefect_server,
        "PREFECT_HOME": str(tmp_path / "prefect"),
        "PREFECT_WORKER_QUERY_SECONDS": "1",
        "CI": "true",
    }
