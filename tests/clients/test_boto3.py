"""boto3: the last one that has the service, with its own model, and today's, with ours."""

import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import boto3
import pytest
from helpers.client_checks import check_cancels, check_errors, check_pages, check_simulations, check_worlds
from helpers.client_environments import run_client

from prefect_robomaker.deployments.cli.main import main

_SCRIPT = str(Path(__file__).parent / "boto3_client.py")

pytestmark = pytest.mark.timeout(900)  # the first to come starts what is served

Client = Callable[[str], dict[str, Any]]


@pytest.fixture(params=[pytest.param("1.40.60", marks=pytest.mark.deep), "today"])
def client(
    request: pytest.FixtureRequest, place: Any, wanted: dict[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Client:
    """Runs a part of the program with one of the two."""
    monkeypatch.setenv("HOME", str(tmp_path))
    if request.param == "today":
        python, version = sys.executable, boto3.__version__
        assert main(["sdk-model", "--install"]) == 0
        waits = {"worlds": 2, "simulations": 2, "cancels": 1, "errors": 0}
    else:
        python, version = str(request.getfixturevalue("old_programs") / "python"), request.param
        waits = {}
    # A zone with half an hour in it: boto3 gives moments in the zone of its machine.
    environ = {**place.environ, "HOME": str(tmp_path), "TZ": "Asia/Kolkata"}

    def run(part: str) -> dict[str, Any]:
        told = json.loads(run_client([python, _SCRIPT, part], environ, json.dumps(wanted)))
        assert told["boto3"] == version
        assert len(told["waiters"]) == (5 if waits else 0)
        assert len(told["waited"]) == waits.get(part, 0)
        return told

    return run


@pytest.mark.deep
def test_worlds_are_made_listed_exported_and_deleted(client: Client, place: Any, wanted: dict[str, Any]) -> None:
    told = client("worlds")

    check_worlds(told, wanted, place.objects)
    check_pages(told, "worlds", "generations", "templates", "exports")


def test_jobs_and_batches_run_to_their_end(client: Client, place: Any, wanted: dict[str, Any]) -> None:
    told = client("simulations")

    check_simulations(told, wanted, place.objects)
    check_pages(told, "jobs", "batches")


def test_jobs_and_batches_are_cancelled(client: Client) -> None:
    check_cancels(client("cancels"))


def test_errors_have_the_classes_that_programs_catch(client: Client) -> None:
    check_errors(client("errors"))


def test_todays_boto3_does_not_know_the_service_by_itself(tmp_path: Path) -> None:
    code = "import boto3\ntry: boto3.client('robomaker', 'us-east-1')\nexcept Exception as e: print(type(e).__name__)"
    assert run_client([sys.executable, "-c", code], {"HOME": str(tmp_path)}) == "UnknownServiceError\n"
