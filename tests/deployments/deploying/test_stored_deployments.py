"""Specifications that Prefect deployments keep, as `robomaker gc` reads them."""

import json
import sqlite3
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

from prefect_robomaker.deployments.deploying.stored_deployments import stored_deployments
from prefect_robomaker.deployments.prefect_database import database_file
from prefect_robomaker.deployments.prefect_server.secret import server_folder
from prefect_robomaker.schemas.settings import Settings
from prefect_robomaker.tasks.retention.stored_specifications import StoredSpecification

SPEC = "{version: 1, name: night, steps: {list: {operation: ListWorlds}}}"


@pytest.fixture
def settings(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Settings:
    """Settings of an empty data home that no Prefect server is configured for."""
    monkeypatch.delenv("PREFECT_API_URL", raising=False)
    monkeypatch.setenv("PREFECT_PROFILES_PATH", str(tmp_path / "profiles.toml"))
    return Settings.from_environment({"ROBOMAKER_HOME": str(tmp_path / "home")})


def test_the_database_of_a_local_server_that_does_not_run_is_read(settings: Settings) -> None:
    path = database_file(settings)
    path.parent.mkdir(parents=True)
    with closing(sqlite3.connect(path)) as database, database:
        database.execute("CREATE TABLE flow (id, name)")
        database.execute("CREATE TABLE deployment (id, flow_id, name, parameters)")
        database.execute("CREATE TABLE deployment_schedule (deployment_id, parameters)")
        database.execute("INSERT INTO flow VALUES ('f', 'RunPipeline')")
        own = json.dumps({"text": SPEC, "house": "flat 1"})
        database.execute("INSERT INTO deployment VALUES ('d', 'f', 'night', ?)", [own])
        database.execute("""INSERT INTO deployment_schedule VALUES ('d', '{"house": "flat 2"}')""")

    found = stored_deployments(settings)

    holder = "the deployment RunPipeline/night"
    assert found == [StoredSpecification(holder, {"text": SPEC, "house": f"flat {number}"}) for number in (1, 2)]


def test_no_server_has_no_deployments_and_a_silent_one_may_have_any(
    settings: Settings, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert stored_deployments(settings) == []
    monkeypatch.setenv("PREFECT_API_URL", "http://127.0.0.1:9/api")

    [why] = stored_deployments(settings)

    assert str(why).startswith("the Prefect server at http://127.0.0.1:9/api does not tell its deployments (")


def test_the_own_server_is_not_asked_where_its_variables_are_set(
    settings: Settings, monkeypatch: pytest.MonkeyPatch
) -> None:
    """`eval "$(robomaker server env)"` outlives the server, and gc then took its deployments for unknown."""
    folder = server_folder(settings)
    (folder / "port").write_text("9")
    monkeypatch.setenv("PREFECT_API_URL", "http://127.0.0.1:9/api")
    assert stored_deployments(settings) == []


def test_a_database_of_another_form_is_told(settings: Settings) -> None:
    path = database_file(settings)
    path.parent.mkdir(parents=True)
    path.write_bytes(b"")

    assert stored_deployments(settings) == [f"the deployments in {path} cannot be read (no such table: deployment)"]


def test_deployments_of_a_configured_server_are_asked_for(
    settings: Settings, prefect_server: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from prefect.client.orchestration import get_client

    monkeypatch.setenv("PREFECT_API_URL", prefect_server)
    name = tmp_path.name
    with get_client(sync_client=True) as client:
        made: Any = client.create_deployment(
            flow_id=client.create_flow_from_name("RunPipeline"), name=name, parameters={"text": SPEC, "house": "flat 1"}
        )
        found = stored_deployments(settings)
        client.delete_deployment(made)

    holder = f"the deployment RunPipeline/{name}"
    own = [each for each in found if isinstance(each, StoredSpecification) and each.holder == holder]
    assert own == [StoredSpecification(holder, {"text": SPEC, "house": "flat 1"})]
