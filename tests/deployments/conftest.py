"""Fixtures that tests of commands share, wherever the commands are."""

import uuid
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import pytest

from prefect_robomaker.deployments.cli import doctor_checks


@pytest.fixture
def without_programs(monkeypatch: pytest.MonkeyPatch) -> None:
    """Leaves out the checks of `doctor` that start programs; `test_a_healthy_machine` has them all."""
    for name, subject in (("check_physics", "physics"), ("check_video", "video"), ("check_extras", "extras")):
        monkeypatch.setattr(doctor_checks, name, partial(doctor_checks.Finding, subject, "ok", "not looked at"))


@pytest.fixture
def client(prefect_server: str, robomaker: Callable[..., Any], monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    """A client of the server that the command uses."""
    from prefect.client.orchestration import get_client

    monkeypatch.setenv("PREFECT_API_URL", prefect_server)
    with get_client(sync_client=True) as made:
        yield made


@pytest.fixture
def pool(client: Any) -> str:
    """A work pool that no other test uses."""
    from prefect.client.schemas.actions import WorkPoolCreate
    from prefect.workers.process import ProcessWorker

    name = f"pool-{uuid.uuid4().hex[:8]}"
    template = ProcessWorker.get_default_base_job_template()
    client.create_work_pool(WorkPoolCreate(name=name, type="process", base_job_template=template))
    return name
