"""What a job's processes are told of the service, and what they are not."""

from pathlib import Path

import pytest

from prefect_robomaker.schemas.settings import Settings
from prefect_robomaker.tasks.simulations.environment.folders import Sandbox
from prefect_robomaker.tasks.simulations.environment.run_environment import process_variables, service_variables

ENDPOINT = {"AWS_ENDPOINT_URL_ROBOMAKER": "http://127.0.0.1:8057"}


def settings(**variables: str) -> Settings:
    return Settings.from_environment({"ROBOMAKER_HOME": "/srv/robo maker", **variables})


def test_the_endpoint_is_passed_on_with_placeholder_keys() -> None:
    variables = service_variables(settings(), {**ENDPOINT, "AWS_DATA_PATH": "/models", "AWS_SECRET_ACCESS_KEY": "s"})

    assert variables["AWS_ENDPOINT_URL_ROBOMAKER"] == ENDPOINT["AWS_ENDPOINT_URL_ROBOMAKER"]
    assert variables["AWS_DATA_PATH"] == "/models"
    assert variables["AWS_SECRET_ACCESS_KEY"] == "local"


def test_no_keys_are_made_up_where_somebody_checks_them() -> None:
    variables = service_variables(settings(ROBOMAKER_ACCESS_KEYS_FILE="/keys"), ENDPOINT)

    assert "AWS_ACCESS_KEY_ID" not in variables
    assert not any("keys" in value for value in variables.values())


def test_no_endpoint_no_keys() -> None:
    assert "AWS_ACCESS_KEY_ID" not in service_variables(settings(), {})


@pytest.mark.parametrize(
    ("catalog", "passed"),
    [("", True), ("postgresql+psycopg://me:secret@db/robomaker", False), ("sqlite:////elsewhere/catalog.db", False)],
)
def test_the_home_is_passed_on_only_if_the_catalog_is_in_it(catalog: str, passed: bool) -> None:
    variables = service_variables(settings(ROBOMAKER_CATALOG_URL=catalog), {})

    assert ("ROBOMAKER_HOME" in variables) is passed
    assert not any("secret" in value for value in variables.values())


def test_temporary_files_are_the_jobs_own(tmp_path: Path) -> None:
    variables = process_variables(Sandbox(tmp_path), settings(), {"PATH": "/mine"})

    assert variables["TMPDIR"] == str(tmp_path / "tmp")
    assert variables["PATH"].endswith(":/mine")
