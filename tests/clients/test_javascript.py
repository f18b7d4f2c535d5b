"""The last JavaScript SDK that has the service, under Node."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from helpers.client_checks import (
    check_cancels,
    check_errors,
    check_pages,
    check_refusal,
    check_simulations,
    check_worlds,
)
from helpers.client_environments import node_modules, run_client

_PROJECT = Path(__file__).parent / "node"

pytestmark = pytest.mark.timeout(900)  # the first to come starts what is served

Client = Callable[[str], dict[str, Any]]


@pytest.fixture(scope="session")
def modules(pytestconfig: pytest.Config) -> Path:
    """Where the SDK is."""
    return node_modules(pytestconfig, _PROJECT)


@pytest.fixture
def client(modules: Path, place: Any, wanted: dict[str, Any], tmp_path: Path) -> Client:
    """Runs a part of the program."""
    environ = {**place.environ, "HOME": str(tmp_path), "NODE_PATH": str(modules), "TZ": "Asia/Kolkata"}

    def run(part: str) -> dict[str, Any]:
        told = json.loads(run_client(["node", str(_PROJECT / "client.cjs"), part], environ, json.dumps(wanted)))
        assert told["sdk"] == "3.918.0"
        return told

    return run


@pytest.mark.deep
def test_worlds_are_made_listed_exported_and_deleted(client: Client, place: Any, wanted: dict[str, Any]) -> None:
    told = client("worlds")

    check_worlds(told, wanted, place.objects)
    check_pages(told, "worlds", "generations", "templates", "exports")


@pytest.mark.deep  # the suite has it by boto3
def test_jobs_and_batches_run_to_their_end(client: Client, place: Any, wanted: dict[str, Any]) -> None:
    told = client("simulations")

    check_simulations(told, wanted, place.objects)
    check_pages(told, "jobs", "batches")


@pytest.mark.deep
def test_jobs_and_batches_are_cancelled(client: Client) -> None:
    check_cancels(client("cancels"))


@pytest.mark.deep
def test_errors_have_the_classes_that_programs_catch(client: Client) -> None:
    told = client("errors")

    check_errors(told)
    # boto3 refuses these by itself.
    check_refusal(told["required"], "InvalidParameterException", "world: is missing")
    check_refusal(told["tooShort"], "InvalidParameterException", "worlds: is an empty list")
